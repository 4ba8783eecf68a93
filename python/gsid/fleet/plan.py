"""The plan of a fleet: one line for each unit, written and read as a stream."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.base.json_files import parse_json
from gsid.fleet.recipe import Recipe
from gsid.fleet.unit import Job
from gsid.records.files import KINDS

FORMAT = 1
PLANS = "plan*.jsonl"


@dataclass(frozen=True)
class Unit:
    """A unit, or one of its measurements if it was measured at several times.

    Attributes
    ----------
    name : str
    records : tuple of str
    time, group : str or None
        As the pattern finds them in the names.
    """

    name: str
    records: tuple[str, ...]
    time: str | None = None
    group: str | None = None

    @property
    def mark(self) -> bytes:
        """Eight bytes that stand for name and time, where a set of the names would grow too large."""
        return hashlib.blake2b(repr((self.name, self.time)).encode(), digest_size=8).digest()


@dataclass(frozen=True)
class Planned:
    """A unit and what is run on it."""

    unit: Unit
    job: Job


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count`, from 1. A unit belongs to a shard by its address, wherever it is planned."""

    index: int = 1
    count: int = 1

    def has(self, key: str) -> bool:
        """Whether the unit with this address belongs to it."""
        return int(key[:15], 16) % self.count == self.index - 1

    @property
    def plan_name(self) -> str:
        """Name of the file of its plan."""
        return "plan.jsonl" if self.count == 1 else f"plan-{self.index}-of-{self.count}.jsonl"


# ---------------------------------------------------------------- units


def units_of(paths: Sequence[str], recipe: Recipe) -> Iterator[Unit]:
    """Units of files and folders, one after the other.

    With a pattern, it decides which files belong together, and other files are left out. Without one, the
    files of each folder are a unit, and a file given itself is a unit of its own.

    Raises
    ------
    InputError
        No record, a path that does not exist, or a unit whose records are apart.
    """
    known: set[bytes] = set()
    for unit in _grouped(paths, recipe):
        if unit.mark in known:
            hint = (
                "put them into one folder, or let the pattern of unit find the time of each measurement too"
            )
            raise InputError("a unit has records in several folders", unit.records[0], unit.name, hint)
        known.add(unit.mark)
        yield unit
    if not known:
        named = ", ".join(paths[:3])
        hint = f"name files or folders with records ({' '.join(KINDS)})"
        raise InputError("no record was found that belongs to a unit", named, None, hint)


def _grouped(paths: Sequence[str], recipe: Recipe) -> Iterator[Unit]:
    for folder, files in _folders(paths):
        found = [(_named(folder, file, recipe), file) for file in files]
        marked = sorted((one for one in found if one[0]), key=lambda one: (tuple(map(str, one[0])), one[1]))
        for (name, time, group), several in itertools.groupby(marked, key=lambda one: one[0]):
            yield Unit(name, tuple(file for _, file in several), time, group)


def _folders(paths: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Files by folder: of the files given themselves, then of each folder given and those below it."""
    alone = [path for path in paths if not os.path.isdir(path)]
    for path in alone:
        if not os.path.exists(path):
            raise InputError("no such file or folder", path, None, "check the name")
    if alone:
        yield "", alone
    for top in (path for path in paths if os.path.isdir(path)):
        for folder, below, files in os.walk(top):
            below.sort()
            records = [os.path.join(folder, file) for file in files if file.lower().endswith(KINDS)]
            if records:
                yield top, records


def _named(top: str, file: str, recipe: Recipe) -> tuple[str, str | None, str | None] | None:
    path = Path(file)
    if recipe.pattern is None:
        if not top:
            return path.stem, None, None
        below = path.parent.relative_to(top).as_posix()
        return (path.parent.absolute().name if below == "." else below), None, None
    match = recipe.pattern.search(path.as_posix())
    if match is None or not match["unit"]:
        return None
    found = match.groupdict()
    return found["unit"], found.get("time"), found.get("group")


# ---------------------------------------------------------------- files


def write_plan(
    folder: Path, shard: Shard, header: dict[str, Any], units: Iterable[Unit], job_of: Callable[[Unit], Job]
) -> Path:
    """Write the plan of a shard, a line at a time.

    Parameters
    ----------
    folder : Path
        Folder of the fleet.
    shard : Shard
    header : dict
        First line: what all units share.
    units : iterable of Unit
    job_of : callable

    Returns
    -------
    Path
    """

    def write(part: Path) -> None:
        with part.open("w", encoding="utf-8") as file:
            _write_line(file, {"gsid_fleet": FORMAT, "shard": [shard.index, shard.count], **header})
            for unit in units:
                job = job_of(unit)
                if shard.has(job.key):
                    _write_line(file, {"unit": asdict(unit), "job": job.to_dict()})

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / shard.plan_name
    for old in folder.glob(PLANS):  # with shards of another number no merge would be complete
        if read_header(old)["shard"][1] != shard.count:
            old.unlink()
    write_atomically(path, write)
    return path


def _write_line(file: IO[str], values: dict[str, Any]) -> None:
    file.write(json.dumps(values, allow_nan=False) + "\n")


def read_header(path: Path) -> dict[str, Any]:
    """First line of a plan.

    Raises
    ------
    InputError
        The file is not a plan of this version.
    """
    with path.open(encoding="utf-8") as file:
        return _parsed(path, 1, file.readline(), "gsid_fleet")


def read_plan(path: Path) -> Iterator[Planned]:
    """Units of a plan, read a line at a time.

    Raises
    ------
    InputError
        As `read_header`.
    """
    with path.open(encoding="utf-8") as file:
        _parsed(path, 1, file.readline(), "gsid_fleet")
        for number, line in enumerate(file, 2):
            found = _parsed(path, number, line, "job")
            unit = found["unit"]
            yield Planned(Unit(**unit | {"records": tuple(unit["records"])}), Job(**found["job"]))


def _parsed(path: Path, number: int, line: str, key: str) -> dict[str, Any]:
    hint = "run `gsid fleet` again: it writes the plan anew, and keeps the results"
    try:
        found = parse_json(line)
    except ValueError as error:
        raise InputError("the plan is damaged", f"{path}: line {number}", str(error), hint) from None
    if not isinstance(found, dict) or key not in found or found.get("gsid_fleet", FORMAT) != FORMAT:
        raise InputError("this is not a plan of this version", f"{path}: line {number}", None, hint)
    return found
