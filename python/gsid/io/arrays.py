"""Records as files of arrays: .npz, .mat (v5 and v7.3), .h5."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import numpy as np

from gsid.errors import InputError
from gsid.io.raw import DAMAGED, DAMAGED_HINT, KEYS, Raw, keys_of
from gsid.record import Record


def _raw_arrays(path: Path, entries: dict[str, object]) -> Raw:
    """Sort what a file of arrays holds into columns (arrays) and keys (single numbers and texts)."""
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
    with contextlib.suppress(AttributeError, TypeError, ValueError):  # someone else's entry called meta
        keys.update({str(key): str(value) for key, value in json.loads(keys.get("meta", "")).items()})
        del keys["meta"]
    return Raw(columns, keys, lambda column, sample: f"{path} sample {sample}, array {column}")


def _arrays_of(record: Record) -> dict[str, object]:
    arrays: dict[str, object] = {"u": record.u, "y": record.y, **record.columns, **keys_of(record)}
    if not record.valid.all():
        arrays["valid"] = record.valid
    if record.meta:
        arrays["meta"] = json.dumps(record.meta)
    return arrays


def read_npz(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
    entries: dict[str, object] = {}
    try:
        with np.load(path, allow_pickle=False) as file:
            for name in file.files:
                try:
                    entries[name] = file[name]
                except ValueError as error:
                    # an array of Python objects would run code when read: it is left alone
                    if "pickle" not in str(error).lower():
                        raise
    except Exception as error:  # on damaged files the readers raise what they will
        raise InputError(DAMAGED, str(path), None, DAMAGED_HINT) from error
    return _raw_arrays(path, entries)


def write_npz(path: Path, record: Record) -> None:
    np.savez(path, **_arrays_of(record))


def read_mat(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
    from scipy.io import loadmat

    try:
        entries = loadmat(path, squeeze_me=True)
    except NotImplementedError:  # v7.3 is HDF5
        return read_h5(path, u, y, fs_hz)
    except Exception as error:  # on damaged files the readers raise what they will
        raise InputError(DAMAGED, str(path), None, DAMAGED_HINT) from error
    return _raw_arrays(path, {name: value for name, value in entries.items() if not name.startswith("__")})


def write_mat(path: Path, record: Record) -> None:
    from scipy.io import savemat

    savemat(path, _arrays_of(record), oned_as="column")


def read_h5(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            entries: dict[str, object] = dict(file.attrs)
            file.visititems(lambda name, node: entries.update(_h5_entry(name, node)))
    except Exception as error:  # on damaged files the readers raise what they will
        raise InputError(DAMAGED, str(path), None, DAMAGED_HINT) from error
    return _raw_arrays(path, entries)


def _h5_entry(name: str, node: object) -> dict[str, object]:
    import h5py

    if not isinstance(node, h5py.Dataset) or name.startswith("#"):
        return {}
    if node.attrs.get("MATLAB_class") == b"char":
        return {name: "".join(map(chr, np.ravel(node[()])))}
    if h5py.check_string_dtype(node.dtype) and node.shape == ():
        return {name: node.asstr()[()]}
    return {name: node[()]} if node.dtype.kind in "fiubc" else {}


def write_h5(path: Path, record: Record) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, value in _arrays_of(record).items():
            if np.ndim(value):
                file[name] = value
            else:
                file.attrs[name] = value
