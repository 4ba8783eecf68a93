"""Read the documentation comments of the public C headers.

A header opens with a comment on what it is for. Before a function stands a comment that begins with two
stars: sentences, then `@param[in] name  text` and `@return text`. The comments are the reference, so that
the pages of the site and this module add nothing to them.
"""

import dataclasses
import re
from pathlib import Path

COMMENT = re.compile(r"/\*.*?\*/", re.S)
FUNCTION = re.compile(r"^(?:const )?(?:struct |enum )?\w+[ *]+(gsid_\w+)\([^;{}]*\);", re.M)

TYPE = re.compile(
    r"^(?:typedef (?:struct|enum)(?: \w+)? \{[^}]*\} (\w+);|struct (\w+) \{[^}]*\};)(?: */\*.*\*/)?$", re.M
)


@dataclasses.dataclass(frozen=True)
class Function:
    """One public function: its prototype and its comment."""

    name: str
    prototype: str
    text: str | None  # None: there is no comment
    parameters: tuple[tuple[str, str], ...] = ()  # name with direction, description
    returns: str = ""


@dataclasses.dataclass(frozen=True)
class Header:
    """One public header."""

    name: str  # as it is included
    text: str
    functions: tuple[Function, ...]
    types: tuple[tuple[str, str], ...]  # name, declaration


def plain(comment: str) -> str:
    """The text of a comment, without its stars."""
    body = re.sub(r"^/\*+|\*/$", "", comment)
    return "\n".join(re.sub(r"^\s*\* ?", "", line).rstrip() for line in body.splitlines()).strip()


def function(name: str, prototype: str, comment: str | None) -> Function:
    """Split a comment into its text, parameters and return value."""
    prototype = re.sub(r"\s+", " ", prototype)
    if comment is None:
        return Function(name, prototype, None)
    parts = re.split(r"@(param\[[\w,]+\]|return)\s", plain(comment))
    parameters, returns = [], ""
    for tag, text in zip(parts[1::2], parts[2::2], strict=True):
        if tag == "return":
            returns = text.strip()
        else:
            names, _, description = text.strip().partition("  ")
            parameters.append((f"{names} [{tag[6:-1]}]", description.strip()))
    return Function(name, prototype, parts[0].strip(), tuple(parameters), returns)


def types_of(source: str) -> list[tuple[str, str]]:
    """Public structs and enums with their comments, in the order of the header."""
    found = []
    for match in TYPE.finditer(source):
        before = source[: match.start()]
        comment = before[before.rindex("/*") :] if before.endswith("*/\n") else ""
        found.append((match[1] or match[2], comment + match[0]))
    return found


def read(path: Path, include: Path) -> Header:
    """Read one header."""
    source = path.read_text(encoding="utf-8")
    opening = COMMENT.search(source)
    functions = []
    for match in FUNCTION.finditer(source):
        before = source[: match.start()].rstrip()
        comment = None
        if before.endswith("*/"):
            start = before.rindex("/*")
            comment = before[start:] if before[start:].startswith("/**") else None
        functions.append(function(match[1], match[0].rstrip(";"), comment))
    text = plain(opening[0]) if opening and opening.start() == 0 else ""
    return Header(str(path.relative_to(include)), text, tuple(functions), tuple(types_of(source)))


def headers(include: Path) -> list[Header]:
    """Every public header, those of the core before those of the host."""
    paths = [*sorted(include.glob("gsid/*.h")), *sorted(include.glob("gsid/host/*.h"))]
    return [read(path, include) for path in paths]
