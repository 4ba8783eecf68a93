"""One small change of one source file, and what the tests made of it."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Mutant:
    """A source file with one change.

    Attributes
    ----------
    file : str
        Path in the repository.
    line : int
        Where the change begins, from 1.
    operator : str
        Kind of the change.
    before, after : str
        The lines that differ.
    text : str
        The whole file with the change.
    number : int
        Which of the equal changes of equal lines of the file, from 1.
    """

    file: str
    line: int
    operator: str
    before: str
    after: str
    text: str = field(repr=False, compare=False)
    number: int = 1

    @classmethod
    def of(cls, file: str, line: int, operator: str, old: str, new: str) -> Mutant:
        """From the text of the file before and after the change."""
        changes = list(difflib.unified_diff(old.splitlines(), new.splitlines(), n=0, lineterm=""))[3:]
        before, after = (
            " ".join(one[1:].strip() for one in changes if one.startswith(sign)) for sign in ("-", "+")
        )
        return cls(file, line, operator, before, after, new)

    @property
    def key(self) -> str:
        """What it is known by as long as the line stays as it is, wherever it stands."""
        return f"{Path(self.file).name}: {self.before} => {self.after}"

    @property
    def name(self) -> str:
        """Unique, and the same as long as the line stays as it is."""
        return f"{self.file}: {self.before} => {self.after} ({self.number})"
