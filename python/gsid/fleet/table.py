"""The tables of a fleet, merged from plans and results as a stream into Parquet files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.fleet.extra import require
from gsid.fleet.plan import PLANS, Planned, read_header, read_plan
from gsid.fleet.store import Store
from gsid.fleet.unit import DONE, FAILED

MISSING = "missing"  # status of a planned unit without a result
PARAMETERS, UNITS = "parameters.parquet", "units.parquet"
BATCH = 4096  # rows held in memory
TEXTS = ("unit", "time", "group", "key", "status", "verdict")
PARAMETER_COLUMNS = dict.fromkeys((*TEXTS, "effect", "parameter"), "string") | {
    "value": "float64",
    "std": "float64",
    "version": "string",
}
UNIT_COLUMNS = dict.fromkeys((*TEXTS, "missing", "failure", "host"), "string") | {
    "seconds": "float64",
    "peak_memory_mb": "float64",
    "seed": "int64",
    "version": "string",
}


@dataclass
class Merged:
    """What a merge has counted.

    Attributes
    ----------
    status : dict of int
        Units by status: done, failed, missing.
    failed : list of (str, str)
        The first failed units, and why.
    """

    status: dict[str, int] = field(default_factory=lambda: {DONE: 0, FAILED: 0, MISSING: 0})
    failed: list[tuple[str, str]] = field(default_factory=list)


def merge(folders: Sequence[str | Path], output: str | Path) -> Merged:
    """Merge the plans and results of folders into the tables of `output`.

    Parameters
    ----------
    folders : sequence of path
        Folders of fleets, which together have all shards of one recipe.
    output : path
        Folder of the tables.

    Raises
    ------
    InputError
        There is no plan, shards are missing or are of different recipes, or pyarrow is not installed.
    """
    require("pyarrow")
    plans = plans_of(folders)
    stores = [Store(folder) for folder in folders]
    merged = Merged()
    Path(output).mkdir(parents=True, exist_ok=True)

    def write_both(units_part: Path) -> None:
        def write_parameters(parameters_part: Path) -> None:
            with (
                _Writer(units_part, UNIT_COLUMNS) as units,
                _Writer(parameters_part, PARAMETER_COLUMNS) as rows,
            ):
                for planned, result in _results(plans, stores):
                    _count(merged, planned, result)
                    units.add(unit_row(planned, result))
                    for row in parameter_rows(planned, result):
                        rows.add(row)

        write_atomically(Path(output) / PARAMETERS, write_parameters)

    write_atomically(Path(output) / UNITS, write_both)
    return merged


def plans_of(folders: Sequence[str | Path]) -> list[Path]:
    """Plans of folders, which together have to be all shards of one recipe.

    Raises
    ------
    InputError
        There is none, a shard is missing, or they are of different recipes.
    """
    found = [path for folder in folders for path in sorted(Path(folder).glob(PLANS))]
    if not found:
        raise InputError(
            "there is no plan", str(folders[0]), None, "run `gsid fleet RECIPE.toml REC...` first"
        )
    headers = [read_header(path) for path in found]
    alike = {json.dumps({**header, "shard": None}, sort_keys=True) for header in headers}
    if len(alike) > 1:
        hint = "merge the folders of one recipe and one version of gsid only"
        raise InputError("the plans are of different recipes or versions", str(found[0]), None, hint)
    counts = {header["shard"][1] for header in headers}
    if len(counts) > 1:
        text = " and ".join(map(str, sorted(counts)))
        raise InputError(
            "the shards do not belong together", str(found[0]), f"{text} parts", "run them again"
        )
    absent = sorted(set(range(1, counts.pop() + 1)) - {header["shard"][0] for header in headers})
    if absent:
        text = ", ".join(map(str, absent))
        raise InputError("shards are missing", str(found[0]), text, "run them, and name their folders too")
    return found


def _results(plans: list[Path], stores: list[Store]) -> Iterator[tuple[Planned, dict[str, Any] | None]]:
    """Each planned unit once, with its result."""
    known: set[bytes] = set()
    for path in plans:
        for planned in read_plan(path):
            if planned.unit.mark in known:  # in two folders: the same shard was run twice
                continue
            known.add(planned.unit.mark)
            yield planned, next(filter(None, (store.read(planned.job.key) for store in stores)), None)


def _count(merged: Merged, planned: Planned, result: dict[str, Any] | None) -> None:
    status = MISSING if result is None else result["status"]
    merged.status[status] += 1
    if status == FAILED and len(merged.failed) < 20:
        merged.failed.append((planned.unit.name, failure_text(result)))


def failure_text(result: dict[str, Any]) -> str:
    """Why a unit failed, in one line."""
    failure = result.get("failure") or {}
    return f"{failure.get('kind', 'unknown')}: {failure.get('text', '')}".partition("\n")[0]


def _shared(planned: Planned, result: dict[str, Any] | None) -> dict[str, Any]:
    unit, answer = planned.unit, (result or {}).get("answer") or {}
    named = {"unit": unit.name, "time": unit.time, "group": unit.group, "key": planned.job.key}
    status = MISSING if result is None else result["status"]
    verdict = answer.get("verdict")
    return named | {"status": status, "verdict": None if verdict is None else str(verdict)}


def unit_row(planned: Planned, result: dict[str, Any] | None) -> dict[str, Any]:
    """Row of `units.parquet`."""
    found = result or {}
    effects = [name for name in (found.get("answer") or {}).get("effects") or [] if isinstance(name, str)]
    more = {name: found.get(name) for name in ("host", "seconds", "peak_memory_mb", "seed", "version")}
    failure = failure_text(found) if found.get("status") == FAILED else None
    return _shared(planned, result) | {"missing": " or ".join(effects) or None, "failure": failure} | more


def parameter_rows(planned: Planned, result: dict[str, Any] | None) -> Iterator[dict[str, Any]]:
    """Rows of `parameters.parquet`: one for each parameter, or one without a parameter."""
    shared = _shared(planned, result) | {"version": (result or {}).get("version")}
    found = list(parameters((result or {}).get("answer") or {}))
    for effect, name, value, std in found or [(None, None, None, None)]:
        yield shared | {"effect": effect, "parameter": name, "value": value, "std": std}


def parameters(answer: dict[str, Any]) -> Iterator[tuple[str, str, float, float | None]]:
    """Effect, parameter, value and std in the answer of a verb that finds a stack of effects.

    `diagnose` has it in its model, `fit` has it beside its own figures. The second effect of a name is
    numbered: "mode 2".
    """
    model = answer.get("model")
    effects = model.get("effects", []) if isinstance(model, dict) else answer.get("effects") or []
    seen: dict[str, int] = {}
    for effect in (one for one in effects if isinstance(one, dict)):
        name = effect["effect"]
        seen[name] = seen.get(name, 0) + 1
        label = name if seen[name] == 1 else f"{name} {seen[name]}"
        for parameter, found in effect["params"].items():
            yield label, parameter, found["value"], found.get("std")


class _Writer:
    """Parquet file that is written in batches."""

    def __init__(self, path: Path, columns: dict[str, str]) -> None:
        import pyarrow
        import pyarrow.parquet

        types = {"string": pyarrow.string(), "float64": pyarrow.float64(), "int64": pyarrow.int64()}
        self._schema = pyarrow.schema([(name, types[kind]) for name, kind in columns.items()])
        self._table: Callable = pyarrow.Table.from_pylist
        self._file = pyarrow.parquet.ParquetWriter(path, self._schema)
        self._rows: list[dict[str, Any]] = []

    def add(self, row: dict[str, Any]) -> None:
        self._rows.append(row)
        if len(self._rows) == BATCH:
            self._flush()

    def _flush(self) -> None:
        if self._rows:
            self._file.write_table(self._table(self._rows, schema=self._schema))
            self._rows = []

    def __enter__(self) -> _Writer:
        return self

    def __exit__(self, *error: object) -> None:
        if error == (None, None, None):
            self._flush()
        self._file.close()
