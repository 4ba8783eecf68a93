"""A table of text: as aligned columns, as Markdown and as HTML."""

from __future__ import annotations

import functools
import html
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import jinja2


@dataclass(frozen=True)
class Table:
    """Rows of text under headings.

    Attributes
    ----------
    head : sequence of str
        Names of the columns with their units. Empty, for `html` only, if the first cell of each row names it.
    rows : sequence of sequences of str
    left : sequence of str
        Columns of text; the others are numbers, aligned to the right.
    title, note : str
        What stands above and below the table on a page.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    left: Sequence[str] = ()
    title: str = ""
    note: str = ""

    def text(self) -> str:
        """Return aligned columns, two spaces apart."""
        lines = [self.head, *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return "\n".join("  ".join(map(self._aligned, self.head, line, widths)).rstrip() for line in lines)

    def _aligned(self, name: str, cell: str, width: int) -> str:
        return cell.ljust(width) if name in self.left else cell.rjust(width)

    def markdown(self) -> str:
        """Return the table in Markdown; a bar in a cell is escaped."""
        rule = "|".join("---" if name in self.left else "---:" for name in self.head)
        lines = [[cell.replace("|", r"\|") for cell in line] for line in [self.head, *self.rows]]
        head, *rows = (f"| {' | '.join(line)} |" for line in lines)
        return "\n".join([head, f"|{rule}|", *rows])

    def without_empty(self, names: Sequence[str]) -> Table:
        """Return the table less the columns with these names that are empty in all rows."""
        columns = enumerate(self.head)
        keep = [i for i, name in columns if name not in names or any(row[i] for row in self.rows)]
        rows = [[row[i] for i in keep] for row in self.rows]
        return replace(self, head=[self.head[i] for i in keep], rows=rows)

    def html(self) -> str:
        """Return the table in HTML, with its title as the caption."""
        return templates().get_template("table.html").render(t=self, caption=self.title)

    _repr_html_ = html


def paragraphs(*texts: str) -> str:
    """Return sentences in HTML, a paragraph each; empty ones are left out.

    Parameters
    ----------
    *texts : str
    """
    return "".join(f"<p>{html.escape(text)}</p>" for text in texts if text)


@functools.cache
def templates() -> jinja2.Environment:
    """The templates of pages and tables: text in them is escaped."""
    import jinja2  # when a table is drawn: it takes longer to load than all of this package

    loader = jinja2.PackageLoader("gsid", "templates")
    return jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
