"""Read and write records as files of arrays: .npz, .mat (v5 and v7.3), .h5."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import numpy as np

from gsid.records.foreign import read_foreign
from gsid.records.raw import KEYS, Raw, keys_of
from gsid.records.record import Record


def _raw_arrays(path: Path, entries: dict[str, object], names: list[str]) -> Raw:
    """Sort the entries of a file into columns (arrays) and keys (single numbers and texts)."""
    columns: dict[str, np.ndarray] = {}
    keys: dict[str, object] = {}
    for name, value in entries.items():
        array = np.asarray(value)
        if array.dtype.kind in "US" and array.size == 1:
            text = array.item()
            keys[name] = text.decode() if isinstance(text, bytes) else text
        elif array.dtype.kind in "fiub" and name in KEYS and array.size == 1:
            keys[name] = array.item()
        elif array.ndim:
            columns[name] = array
        elif array.dtype.kind in "fiub":
            keys[name] = array.item()
    with contextlib.suppress(AttributeError, TypeError, ValueError):  # an entry named meta of another program
        keys.update({str(key): str(value) for key, value in json.loads(keys.get("meta", "")).items()})
        del keys["meta"]
    listed = [name for name in names if name not in (*KEYS, "meta")]
    return Raw(columns, keys, lambda column, sample: f"{path} sample {sample}, array {column}", listed=listed)


def _arrays_of(record: Record) -> dict[str, object]:
    arrays: dict[str, object] = {"u": record.u, "y": record.y, **record.columns, **keys_of(record)}
    if not record.valid.all():
        arrays["valid"] = record.valid
    if record.meta:
        arrays["meta"] = json.dumps(record.meta)
    return arrays


def read_npz(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
    return _raw_arrays(path, *read_foreign("npz", path, u, y))


def write_npz(path: Path, record: Record) -> None:
    np.savez(path, **_arrays_of(record))


def read_mat(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
    return _raw_arrays(path, *read_foreign("mat", path, u, y))


def write_mat(path: Path, record: Record) -> None:
    from scipy.io import savemat

    savemat(path, _arrays_of(record), oned_as="column")


def read_h5(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
    return _raw_arrays(path, *read_foreign("h5", path, u, y))


def write_h5(path: Path, record: Record) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, value in _arrays_of(record).items():
            if np.ndim(value):
                file[name] = value
            else:
                file.attrs[name] = value
