"""Read and write records: CSV, .npz, .mat (v5 and v7.3), .h5, PX4 ULog.

Every reader returns a `Raw`. `to_record` checks it and makes the `Record`, in the same way for all formats.
An error in a file is an `InputError` that names the line or the sample, the column and the value.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gsid.base.errors import InputError
from gsid.base.files import kind_of, write_atomically
from gsid.records.arrays import read_h5, read_mat, read_npz, write_h5, write_mat, write_npz
from gsid.records.checks import add_keys_from_meta_file, to_record
from gsid.records.csv import csv_columns, read_csv, write_csv
from gsid.records.foreign import names_in
from gsid.records.raw import DAMAGED_HINT, KEYS
from gsid.records.record import Record
from gsid.records.ulog import read_ulog
from gsid.records.units import in_units

_READERS = {
    ".csv": read_csv,
    ".npz": read_npz,
    ".mat": read_mat,
    ".h5": read_h5,
    ".hdf5": read_h5,
    ".ulg": read_ulog,
}
FOREIGN = {".npz": "npz", ".mat": "mat", ".h5": "h5", ".hdf5": "h5"}  # kinds of `names_in`
KINDS = tuple(_READERS)  # extensions that are read
_WRITERS = {".csv": write_csv, ".npz": write_npz, ".mat": write_mat, ".h5": write_h5}


def read_record(
    path: str | os.PathLike,
    *,
    u: str | None = None,
    y: str | None = None,
    fs_hz: float | None = None,
    period: int | None = None,
    settle: int | None = None,
    hold: str | None = None,
    units: Mapping[str, str] | None = None,
    factors: Mapping[str, float] | None = None,
    zero_input: bool = False,
) -> Record:
    """Read one realisation from a file.

    Binary files are read in a separate process (docs/reference/conventions.md, "Input files").
    Arrays as long as u become columns of the record.

    Parameters
    ----------
    path : path_like
        .csv, .npz, .mat, .h5 or .ulg.
    u, y : str, optional
        Names of the columns or arrays of input and output; default "u" and "y". In .h5, a path inside the
        file. In ULog, `topic.field`, both in one topic.
    fs_hz : float, optional
        Sample rate [Hz]. Required if the file states neither times nor a rate, or if its times
        jitter or are rounded more coarsely than a step.
    period, settle : int, optional
        Period and settling [samples]; these replace the values in the file.
    hold : {"zoh", "none"}, optional
        Whether the input was held over each sample. It replaces the value in the file. The hold is unknown
        (None) if neither is given.
    units : mapping of str, optional
        Units of the columns u and y, after the conversion; these replace the units in the file.
    factors : mapping of float, optional
        Factors by which columns are multiplied, for example {"gyro": 57.29578} for deg/s of a column in
        rad/s. Those of u and y need a unit.
    zero_input : bool
        Whether a file without an input is read with zero input. If False, the input is required.

    Returns
    -------
    Record

    Raises
    ------
    InputError
        The file cannot be read, or is not a valid record.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise _unknown_kind(path)
    _check_readable(path)
    is_optional, u, y = zero_input and u is None, u or "u", y or "y"
    raw = reader(path, y if is_optional else u, y, fs_hz)
    if is_optional and u not in raw.columns and u in raw.listed:  # u exists, but not as long as y: an error
        raw = reader(path, u, y, fs_hz)
    if is_optional and u not in raw.columns and y in raw.columns:
        raw.columns[u] = np.zeros(np.size(raw.columns[y]))
    add_keys_from_meta_file(path, raw, u, y, fs_hz, period)
    if hold is not None:
        raw.keys["hold"] = hold
    record = to_record(path, raw, u, y, fs_hz)
    record.period_samples = record.period_samples if period is None else period
    record.settle_samples = record.settle_samples if settle is None else settle
    return in_units(record, u, y, units or {}, factors or {}) if units or factors else record


def columns_of(path: str | os.PathLike) -> list[str]:
    """Names of the columns or arrays of a file, from which u and y are chosen.

    Parameters
    ----------
    path : path_like
        .csv, .npz, .mat, .h5 or .ulg.

    Returns
    -------
    list of str
        At most 200. Empty for ULog, whose fields are `topic.field`.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in _READERS:
        raise _unknown_kind(path)
    _check_readable(path)
    if kind == ".csv":
        return csv_columns(path)
    if kind == ".ulg":
        return []
    return [name for name in names_in(FOREIGN[kind], path) if name not in (*KEYS, "meta")]


def write_record(path: str | os.PathLike, record: Record) -> None:
    """Write a record without loss of precision as .csv, .npz, .mat (v5) or .h5, by the extension.

    Parameters
    ----------
    path : path_like
        "-" is the standard output, as CSV.
    record : Record

    Raises
    ------
    InputError
        The extension is unknown, or the path exists and is not a regular file.
    OSError
        The file cannot be written. An existing file is unchanged.
    """
    path = Path(path)
    writer = _WRITERS.get(kind_of(path, stream=".csv"))
    if writer is None:
        raise InputError(
            "cannot write this kind of file",
            str(path),
            path.suffix or "no extension",
            f"records are written as {', '.join(_WRITERS)}",
        )
    write_atomically(path, lambda part: writer(part, record))


def _unknown_kind(path: Path) -> InputError:
    kind = path.suffix or "no extension"
    return InputError("unknown kind of file", str(path), kind, f"records are {', '.join(KINDS)}")


def _check_readable(path: Path) -> None:
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise OSError(0, "not a regular file")
        with open(path, "rb") as file:
            empty = not file.read(1)
    except OSError as error:
        raise InputError(
            "cannot read the file", str(path), error.strerror, "check the name and the permissions"
        ) from error
    if empty:
        raise InputError("the file is empty", str(path), "0 bytes", DAMAGED_HINT)
