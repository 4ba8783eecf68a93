"""Removes results that no plan of the folder needs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gsid.fleet.plan import PLANS, read_plan
from gsid.fleet.store import Store


@dataclass
class Size:
    """Number of files and their size."""

    files: int = 0
    bytes: int = 0

    def add(self, path: Path) -> None:
        """Count a file."""
        self.files += 1
        self.bytes += path.stat().st_size

    def __str__(self) -> str:
        return f"{self.files} results, {self.bytes / 1e6:.1f} MB"


@dataclass(frozen=True)
class Sizes:
    """What a plan needs, and what may be removed."""

    kept: Size
    removable: Size


def sizes(folder: str | Path, *, everything: bool = False) -> Sizes:
    """Sizes of the results of a fleet, with and without use."""
    found = Sizes(Size(), Size())
    for path, is_needed in _results(folder, everything):
        (found.kept if is_needed else found.removable).add(path)
    return found


def remove(folder: str | Path, *, everything: bool = False) -> None:
    """Remove the results without use."""
    for path, is_needed in _results(folder, everything):
        if not is_needed:
            path.unlink(missing_ok=True)


def _results(folder: str | Path, everything: bool) -> Iterator[tuple[Path, bool]]:
    plans = [] if everything else sorted(Path(folder).glob(PLANS))
    needed = {planned.job.key for path in plans for planned in read_plan(path)}
    for path in Store(folder).files():
        yield path, path.suffix == ".json" and path.stem in needed
