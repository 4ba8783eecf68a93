"""Tables that benchmarks put into the docs: between `<!-- NAME -->` and `<!-- end NAME -->`."""

import re
from pathlib import Path


def table(head: list[str], rows: list[list[str]], left: int = 1) -> str:
    """Return a table in Markdown, the first columns (`left`) as text, the others aligned as numbers."""
    rule = ["---" if i < left else "---:" for i in range(len(head))]
    return "".join(f"| {' | '.join(row)} |\n" for row in [head, rule, *rows])


def put(page: str, name: str, text: str) -> None:
    """Replace what stands between the marks of a name.

    Raises
    ------
    ValueError
        The page has no such marks.
    """
    old = Path(page).read_text(encoding="utf-8")
    begin, end = f"<!-- {name} -->\n", f"<!-- end {name} -->"
    new, n = re.subn(
        f"{re.escape(begin)}.*?{re.escape(end)}", lambda _: begin + text + end, old, flags=re.DOTALL
    )
    if n != 1:
        raise ValueError(f"{page} has no place for {name}")
    Path(page).write_text(new, encoding="utf-8")
