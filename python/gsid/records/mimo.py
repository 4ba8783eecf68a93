"""Records of several inputs and outputs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gsid.base.errors import InputError, choose
from gsid.base.files import kind_of, write_atomically
from gsid.records.files import read_record
from gsid.records.record import Record


@dataclass(repr=False)
class MimoRecord:
    """Samples of one experiment with several inputs and outputs.

    Parameters
    ----------
    u : (n, n_u) array_like
        Inputs.
    y : (n, n_y) array_like
        Outputs.
    fs_hz : float
        Sample rate [Hz].
    inputs, outputs : list of str, optional
        Names; default u1, u2, ... and y1, y2, ...
    settle_samples : int, optional
        Default: until no channel deviates from its later periods (`gsid.records.periods.find_settling`).
    u_units, y_units : list of str, optional
        Unit of each input and output; default: no unit.
    period_samples, valid, hold, name
        As in `gsid.Record`.

    Raises
    ------
    InputError
        As `gsid.Record`.
    """

    u: np.ndarray
    y: np.ndarray
    fs_hz: float
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    period_samples: int | None = None
    settle_samples: int | None = None
    valid: np.ndarray | None = None
    u_units: list[str] = field(default_factory=list)
    y_units: list[str] = field(default_factory=list)
    hold: str | None = None
    name: str = ""

    def __post_init__(self) -> None:
        self.u, self.y = (np.asarray(x, dtype=float) for x in (self.u, self.y))
        for label, samples in (("u", self.u), ("y", self.y)):
            if samples.ndim != 2 or samples.shape[1] == 0:
                hint = "one row per sample, one column per channel"
                raise InputError(f"{label} is not a table of samples", self.name, samples.shape, hint)
        self.inputs = self.inputs or [f"u{i + 1}" for i in range(self.u.shape[1])]
        self.outputs = self.outputs or [f"y{i + 1}" for i in range(self.y.shape[1])]
        if len(self.inputs) != self.u.shape[1] or len(self.outputs) != self.y.shape[1]:
            raise InputError("names and channels differ in number", self.name, self.inputs + self.outputs)
        self.u_units = self.u_units or [""] * len(self.inputs)
        self.y_units = self.y_units or [""] * len(self.outputs)
        if len(self.u_units) != len(self.inputs) or len(self.y_units) != len(self.outputs):
            raise InputError("units and channels differ in number", self.name, self.u_units + self.y_units)
        self.pairs()

    def pairs(self) -> list[Record]:
        """Return pairs of input and output as records; each channel occurs at least once."""
        n_u, n_y = len(self.inputs), len(self.outputs)
        return [self.pair(min(i, n_u - 1), min(i, n_y - 1)) for i in range(max(n_u, n_y))]

    def pair(self, i: int, j: int) -> Record:
        """Return input i and output j as a record."""
        return Record(
            self.u[:, i],
            self.y[:, j],
            self.fs_hz,
            period_samples=self.period_samples,
            settle_samples=self.settle_samples,
            valid=self.valid,
            u_unit=self.u_units[i],
            y_unit=self.y_units[j],
            hold=self.hold,
            name=self.name,
        )

    def __repr__(self) -> str:
        names = f"{', '.join(self.inputs)} -> {', '.join(self.outputs)}"
        return f"MimoRecord({self.name or 'unnamed'}: {names}, {len(self.u)} samples at {self.fs_hz:g} Hz)"


def read_mimo_record(
    path: str | os.PathLike,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    fs_hz: float | None = None,
    period: int | None = None,
    settle: int | None = None,
    hold: str | None = None,
    units: Mapping[str, str] | None = None,
    factors: Mapping[str, float] | None = None,
) -> MimoRecord:
    """Read one experiment from a file that has a column or array for each channel.

    Parameters
    ----------
    path : path_like
        As `gsid.read_record`.
    inputs, outputs : sequence of str
        Names of the columns or arrays.
    fs_hz : float, optional
        Sample rate [Hz]. Required if the file states neither times nor a rate.
    period, settle : int, optional
        Period and settling [samples]; these replace the values in the file.
    hold : {"zoh", "none"}, optional
        As `gsid.read_record`.
    units : mapping of str, optional
    factors : mapping of float, optional
        As `gsid.read_record`, for inputs and outputs.

    Returns
    -------
    MimoRecord

    Raises
    ------
    InputError
        As `gsid.read_record`.
    """
    how = {"fs_hz": fs_hz, "period": period, "settle": settle, "hold": hold}

    def one(u: str, y: str) -> Record:
        own = {} if units is None else {name: unit for name, unit in units.items() if name in (u, y)}
        return read_record(path, u=u, y=y, units=own, factors=factors, **how)

    unknown = [name for name in units or {} if name not in (*inputs, *outputs)]
    if unknown:
        hint = choose(unknown[0], [*inputs, *outputs])
        raise InputError("units are kept of inputs and outputs only", str(path), unknown[0], hint)
    us = [one(name, outputs[0]) for name in inputs]
    ys = [us[0]] + [one(inputs[0], name) for name in outputs[1:]]
    first = us[0]
    return MimoRecord(
        np.column_stack([record.u for record in us]),
        np.column_stack([record.y for record in ys]),
        first.fs_hz,
        inputs=list(inputs),
        outputs=list(outputs),
        period_samples=first.period_samples,
        settle_samples=first.settle_samples,
        valid=np.logical_and.reduce([record.valid for record in us + ys]),
        u_units=[record.u_unit for record in us],
        y_units=[record.y_unit for record in ys],
        hold=first.hold,
        name=first.name,
    )


def write_mimo_record(path: str | os.PathLike, record: MimoRecord) -> None:
    """Write one experiment as .csv or .npz, one column or array for each channel.

    Parameters
    ----------
    path : path_like
    record : MimoRecord
        All inputs have one unit, and all outputs.

    Raises
    ------
    InputError
        The extension is unknown, or the inputs or the outputs have several units.
    OSError
        The file cannot be written. An existing file is unchanged.
    """
    kind = kind_of(path)
    if kind not in (".csv", ".npz"):
        hint = "experiments are written as .csv or .npz"
        raise InputError("cannot write this kind of file", str(path), kind or "no extension", hint)
    if len(set(record.u_units)) > 1 or len(set(record.y_units)) > 1:
        units = f"{record.u_units} and {record.y_units}"
        raise InputError("a file keeps one unit of the inputs and one of the outputs", str(path), units)
    keys = {"fs_hz": record.fs_hz, "period_samples": record.period_samples, "hold": record.hold}
    keys |= {"settle_samples": record.settle_samples}
    keys |= {"u_unit": record.u_units[0], "y_unit": record.y_units[0]}
    keys = {key: value for key, value in keys.items() if value not in (None, "")}
    columns = dict(zip(record.inputs, record.u.T, strict=True))
    columns |= dict(zip(record.outputs, record.y.T, strict=True))
    if record.valid is not None and not np.all(record.valid):
        columns["valid"] = np.asarray(record.valid, float)
    if kind == ".npz":
        write_atomically(path, lambda part: np.savez(part, **keys, **columns))
    else:
        write_atomically(path, lambda part: _write_csv(part, keys, columns))


def _write_csv(path: Path, keys: Mapping[str, object], columns: Mapping[str, np.ndarray]) -> None:
    texts = [map(repr, column.tolist()) for column in columns.values()]
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {key}: {value}\n" for key, value in keys.items())
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))
