"""Read and write records: CSV, .npz, .mat (v5 and v7.3), .h5, PX4 ULog.

Every reader gives a `_Raw`; `_to_record` checks it and makes the `Record`, the same way for all formats. What
is wrong with a file is an `InputError` that names the line or the sample, the column and the value.
"""

from __future__ import annotations

import contextlib
import difflib
import itertools
import json
import logging
import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsid.errors import InputError
from gsid.record import Record

_log = logging.getLogger("gsid.io")

TIME_NAMES = ("t_s", "t")
KEYS = ("fs_hz", "period_samples", "settle_samples", "u_unit", "y_unit", "hold")
STEP_TOLERANCE = 0.01  # of a step, beyond the resolution the times were written with
JITTER_ULOG = 0.5  # of a step, where the user states the rate: ULog times are those of writing
DAMAGED = "the file is damaged, cut short, or not of this kind"
DAMAGED_HINT = "write or copy it again"


@dataclass
class _Raw:
    """What a file holds, before any of it is checked."""

    columns: dict[str, np.ndarray]
    keys: dict[str, object]
    where: Callable[[str, int], str]  # column, sample -> place in the file
    what: str = "array"  # what the file calls a column
    jitter: float = STEP_TOLERANCE


def read_record(
    path: str | os.PathLike,
    *,
    u: str | None = None,
    y: str | None = None,
    fs_hz: float | None = None,
    period: int | None = None,
    settle: int | None = None,
) -> Record:
    """Read one realisation from a file.

    Parameters
    ----------
    path : path_like
        .csv, .npz, .mat, .h5 or .ulg.
    u, y : str, optional
        Names of the input's and the output's column or array; default "u" and "y". In .h5 a path inside the
        file, in ULog `topic.field`, both in one topic.
    fs_hz : float, optional
        Sample rate [Hz], where the file has neither times nor the rate.
    period, settle : int, optional
        Samples; take the place of what the file states.

    Returns
    -------
    Record

    Raises
    ------
    InputError
        The file cannot be read, or is not a sound record.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            "unknown kind of file",
            str(path),
            path.suffix or "no extension",
            f"records are {', '.join(_READERS)}",
        )
    _check_readable(path)
    u, y = u or "u", y or "y"
    raw = reader(path, u, y, fs_hz)
    _add_keys_from_beside(path, raw, u, y, fs_hz, period)
    record = _to_record(path, raw, u, y, fs_hz)
    record.period_samples = record.period_samples if period is None else period
    record.settle_samples = record.settle_samples if settle is None else settle
    return record


def write_record(path: str | os.PathLike, record: Record) -> None:
    """Write a record, the numbers exactly; the extension decides the format: .csv, .npz, .mat (v5) or .h5.

    Parameters
    ----------
    path : path_like
    record : Record

    Raises
    ------
    InputError
        Another extension.
    OSError
        The file cannot be written; an older one is left as it was.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(
            "cannot write this kind of file",
            str(path),
            path.suffix or "no extension",
            f"records are written as {', '.join(_WRITERS)}",
        )
    write_atomically(path, lambda part: writer(part, record))


def write_atomically(path: str | os.PathLike, write: Callable[[Path], None]) -> None:
    """Let `write` fill a file of a temporary name beside `path`, then rename it: never half a file.

    Parameters
    ----------
    path : path_like
    write : callable
        Given the temporary name, which has the extension of `path`.
    """
    path = Path(path)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        write(part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def choose(name: str, names: Iterable[str]) -> str:
    """Hint for a name that is not among `names`: the nearest one, or the list."""
    names = list(names)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    guess = f"did you mean {near[0]}? " if near else ""
    return f"{guess}there are: {', '.join(names) or 'none'}"


# ---------------------------------------------------------------- checks shared by all formats


def _check_readable(path: Path) -> None:
    try:
        with open(path, "rb") as file:
            empty = not file.read(1)
    except OSError as error:
        raise InputError(
            "cannot read the file", str(path), error.strerror, "check the name and the rights"
        ) from error
    if empty:
        raise InputError("the file is empty", str(path), "0 bytes", DAMAGED_HINT)


def _to_record(path: Path, raw: _Raw, u: str, y: str, fs_hz: float | None) -> Record:
    time_name = next((name for name in TIME_NAMES if name in raw.columns), None)
    length_of = {name: _vector(path, raw, name, option) for name, option in ((u, "--u"), (y, "--y"))}
    n = len(length_of[u])
    if len(length_of[y]) != n:
        raise InputError(
            f"{u} and {y} are of unequal lengths",
            str(path),
            f"{n} and {len(length_of[y])} samples",
            "export them from the same time span",
        )
    if n == 0:
        raise InputError("there are no samples", str(path), None, "measure again, or check the export")
    for name in (time_name, "valid"):
        if name in raw.columns and np.size(raw.columns[name]) != n:
            raise InputError(
                f"{u} and {name} are of unequal lengths",
                str(path),
                f"{n} and {np.size(raw.columns[name])} samples",
                "export them together",
            )
    same_length = {
        name: np.ravel(c) for name, c in raw.columns.items() if np.size(c) == n and np.ndim(c) <= 2
    }
    for name in {u, y, time_name, "valid"} & same_length.keys():
        _check_finite(raw, name, same_length[name])
    t = same_length.pop(time_name, None)
    valid = same_length.pop("valid", np.ones(n)).astype(bool)
    text = {key: str(raw.keys[key]) for key in ("u_unit", "y_unit", "hold") if key in raw.keys}
    return Record(
        u=same_length[u],
        y=same_length[y],
        fs_hz=_sample_rate(path, raw, t, fs_hz),
        period_samples=_key_number(path, raw, "period_samples", int),
        settle_samples=_key_number(path, raw, "settle_samples", int),
        valid=valid,
        name=path.name,
        columns={name: c.astype(np.float64) for name, c in same_length.items() if name not in (u, y)},
        meta={key: str(value) for key, value in raw.keys.items() if key not in KEYS},
        **text,
    )


def _vector(path: Path, raw: _Raw, name: str, option: str) -> np.ndarray:
    if name not in raw.columns:
        raise InputError(
            f"no {raw.what} named {name}",
            str(path),
            None,
            f"{choose(name, raw.columns)}; name it with {option}",
        )
    values = np.asarray(raw.columns[name])
    if values.dtype.kind not in "fiub":
        raise InputError(
            f"{name} does not hold real numbers", str(path), f"type {values.dtype}", f"pick with {option}"
        )
    if values.size != max(values.shape, default=1):
        raise InputError(
            f"{raw.what} {name} is not one row of samples",
            str(path),
            f"shape {values.shape}",
            "pick one channel and one realisation, and save them as a vector",
        )
    return values.ravel()


def _check_finite(raw: _Raw, name: str, column: np.ndarray) -> None:
    if column.dtype.kind != "f":
        return
    bad = np.flatnonzero(~np.isfinite(column))
    if bad.size:
        raise InputError(
            "a number is not finite",
            raw.where(name, int(bad[0])),
            column[bad[0]],
            "repair it, or mark the sample as lost: valid = 0 and any finite number",
        )


def _sample_rate(path: Path, raw: _Raw, t: np.ndarray | None, fs_hz: float | None) -> float:
    stated = fs_hz if fs_hz is not None else _key_number(path, raw, "fs_hz", float)
    if stated is not None and not (np.isfinite(stated) and stated > 0):
        raise InputError(
            "the sample rate is not a positive number", str(path), stated, "give it with --fs [Hz]"
        )
    if t is None or len(t) < 2:
        if stated is None:
            raise InputError(
                "the sample rate is not known",
                str(path),
                None,
                "give it with --fs [Hz], or add a column t_s or a line `# fs_hz: ...`",
            )
        return float(stated)
    measured = _rate_of_times(raw, np.asarray(t, np.float64))
    if stated is not None and abs(measured - stated) > 1e-3 * stated:
        raise InputError(
            "the sample rate given is not that of the times",
            str(path),
            f"{stated:g} Hz given, {measured:g} Hz in the file",
            "correct --fs or the times",
        )
    return float(measured if stated is None else stated)


def _rate_of_times(raw: _Raw, t: np.ndarray) -> float:
    """Rate of equally spaced times; rounded to a whole number where the times' resolution allows that."""
    step = float(np.median(np.diff(t)))
    if step <= 0:
        back = int(np.flatnonzero(np.diff(t) <= 0)[0]) + 1
        raise InputError(
            "the times do not increase", raw.where("t_s", back), t[back], "sort the rows by time"
        )
    resolution = _resolution(t)
    off = np.abs(np.diff(t) - step) > min(raw.jitter * step + resolution, 0.5 * step)
    if off.any():
        at = int(np.flatnonzero(off)[0]) + 1
        raise InputError(
            "unequal time steps",
            raw.where("t_s", at),
            f"{t[at] - t[at - 1]:.6g} s after {step:.6g} s",
            "put lost samples in as rows with valid = 0, or resample to one rate",
        )
    rate = (len(t) - 1) / (t[-1] - t[0])
    slack = rate * 2 * resolution / (t[-1] - t[0])
    return float(round(rate)) if abs(rate - round(rate)) <= slack else float(rate)


def _resolution(t: np.ndarray) -> float:
    """Step of the last decimal that the times use, or the rounding of their floating point."""
    rounding = (
        4 * float(np.abs(t).max()) * np.finfo(np.float32 if np.all(t == t.astype(np.float32)) else float).eps
    )
    some = t[:: max(1, len(t) // 1000)]
    for decimals in range(1, 10):
        if np.all(np.abs(some - np.round(some, decimals)) <= rounding):
            return 10.0**-decimals
    return rounding


def _key_number(path: Path, raw: _Raw, key: str, kind: type) -> float | int | None:
    if key not in raw.keys:
        return None
    try:
        value = float(raw.keys[key])
        if kind is float:
            return value
        if value != int(value) or value < 0:
            raise ValueError
        return int(value)
    except (TypeError, ValueError, OverflowError):
        expected = "a number" if kind is float else "a whole number of samples"
        raise InputError(
            f"{key} is not {expected}", str(path), raw.keys[key], f"write `# {key}: ...` anew"
        ) from None


def _add_keys_from_beside(
    path: Path, raw: _Raw, u: str, y: str, fs_hz: float | None, period: int | None
) -> None:
    """Take rate, period and units from a meta.json in the same folder where it names this file."""
    try:
        beside = json.loads((path.parent / "meta.json").read_text(encoding="utf-8"))
        if path.name not in beside["files"]:
            return
    except (OSError, ValueError, KeyError, TypeError):
        return
    has_time = any(name in raw.columns for name in TIME_NAMES)
    for key, given in (("fs_hz", fs_hz is not None or has_time), ("period_samples", period is not None)):
        if key in beside and key not in raw.keys and not given:
            raw.keys[key] = beside[key]
            _log.info("%s: %s = %s from meta.json beside it", path.name, key, beside[key])
    units = {c.get("name"): c.get("unit", "") for c in beside.get("channels", []) if isinstance(c, dict)}
    for key, name in (("u_unit", u), ("y_unit", y)):
        if name in units:
            raw.keys.setdefault(key, units[name])


# ---------------------------------------------------------------- CSV


def _read_csv(path: Path, u: str, y: str, fs_hz: float | None) -> _Raw:
    def where(column: str, sample: int) -> str:
        return f"{path} line {_line_of_sample(path, sample)}, column {column}"

    try:
        with open(path, encoding="utf-8-sig") as file:
            keys, names = _read_head(path, file)
            missing = [name for name in (u, y) if name not in names]
            if missing:
                raise InputError(
                    f"no column named {missing[0]}", str(path), None, _columns_hint(missing[0], u, names)
                )
            table, kept = _read_rows(path, file, names, {u, y, *TIME_NAMES, "valid"})
    except UnicodeDecodeError as error:
        raise InputError("the file is not text", str(path), None, "is it really CSV?") from error
    return _Raw(dict(zip(kept, table.T, strict=True)), keys, where, "column")


def _columns_hint(missing: str, u: str, names: list[str]) -> str:
    if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
        return "separate the columns with commas"
    return f"{choose(missing, names)}; name it with {'--u' if missing == u else '--y'}"


def _read_head(path: Path, file: Iterable[str]) -> tuple[dict[str, object], list[str]]:
    """`# key: value` lines, then the names of the columns."""
    keys: dict[str, object] = {}
    for line in file:
        if line.startswith("#"):
            key, colon, value = line[1:].partition(":")
            if colon:
                keys[key.strip()] = value.strip()
        elif line.strip():
            names = [name.strip().strip('"') for name in line.split(",")]
            if _is_number(names[0]):
                raise InputError(
                    "no header row", str(path), line.strip()[:60], "name the columns first: t_s,u,y"
                )
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise InputError("two columns have the same name", str(path), twice, "rename one of them")
            return keys, names
    raise InputError("there are no samples", str(path), None, "measure again, or check the export")


def _read_rows(
    path: Path, file: Iterable[str], names: list[str], needed: set[str]
) -> tuple[np.ndarray, list[str]]:
    first = next((line for line in file if line.strip()), None)
    if first is None:
        raise InputError("there are no samples", str(path), None, "measure again, or check the export")
    fields = [field.strip() for field in first.split(",")]
    texts = {
        i
        for i, field in enumerate(fields[: len(names)])
        if names[i] not in needed and field and not _is_number(field)
    }
    if texts:
        _log.info("%s: left out, not numbers: %s", path.name, ", ".join(names[i] for i in sorted(texts)))
    columns = [i for i in range(len(names)) if i not in texts]
    try:
        table = np.loadtxt(
            itertools.chain([first], file),
            delimiter=",",
            comments=None,
            ndmin=2,
            usecols=columns if texts else None,
        )
        if table.shape[1] != len(columns):
            raise ValueError
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        raise _fault_in_rows(path, names, columns) from error
    return table, [names[i] for i in columns]


def _data_lines(path: Path) -> Iterable[tuple[int, str]]:
    """Line number and text of the rows, as the fast reader counts them: without blank lines."""
    with open(path, encoding="utf-8-sig") as file:
        lines = ((number, line) for number, line in enumerate(file, 1) if line.strip())
        rows = itertools.dropwhile(lambda item: item[1].startswith("#"), lines)
        next(rows)
        yield from rows


def _line_of_sample(path: Path, sample: int) -> int:
    return next(itertools.islice(_data_lines(path), sample, None))[0]


def _fault_in_rows(path: Path, names: list[str], columns: list[int]) -> InputError:
    """Find what the fast reader stumbled over."""
    for number, line in _data_lines(path):
        place, fields = f"{path} line {number}", line.rstrip("\r\n").split(",")
        if len(fields) != len(names):
            hint = "repair the row" if line.endswith("\n") else "the file was cut short: delete its last row"
            return InputError(
                f"the row has {len(fields)} columns, the header {len(names)}", place, line.strip(), hint
            )
        for i in columns:
            if not _is_number(fields[i]):
                return InputError(
                    "not a number",
                    f"{place}, column {names[i]}",
                    fields[i].strip() or "nothing",
                    "write numbers with a point; mark a lost sample with valid = 0",
                )
    return InputError(DAMAGED, str(path), None, DAMAGED_HINT)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def _write_csv(path: Path, record: Record) -> None:
    columns = {"t_s": record.t_s, "u": record.u, "y": record.y, **record.columns}
    keys = _keys_of(record) | record.meta
    # repr of a Python float is the shortest text that reads back as the same number
    texts = [map(repr, np.asarray(c, np.float64).tolist()) for c in columns.values()]
    names = list(columns)
    if not record.valid.all():
        names.append("valid")
        texts.append(map(str, record.valid.astype(int).tolist()))
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {key}: {value}\n" for key, value in keys.items())
        file.write(",".join(names) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _keys_of(record: Record) -> dict[str, object]:
    keys = {key: getattr(record, key) for key in KEYS}
    return {key: value for key, value in keys.items() if value not in (None, "")}


# ---------------------------------------------------------------- files of arrays


def _raw_arrays(path: Path, entries: dict[str, object]) -> _Raw:
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
    return _Raw(columns, keys, lambda column, sample: f"{path} sample {sample}, array {column}")


def _arrays_of(record: Record) -> dict[str, object]:
    arrays: dict[str, object] = {"u": record.u, "y": record.y, **record.columns, **_keys_of(record)}
    if not record.valid.all():
        arrays["valid"] = record.valid
    if record.meta:
        arrays["meta"] = json.dumps(record.meta)
    return arrays


def _read_npz(path: Path, u: str, y: str, fs_hz: float | None) -> _Raw:
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


def _write_npz(path: Path, record: Record) -> None:
    np.savez(path, **_arrays_of(record))


def _read_mat(path: Path, u: str, y: str, fs_hz: float | None) -> _Raw:
    from scipy.io import loadmat

    try:
        entries = loadmat(path, squeeze_me=True)
    except NotImplementedError:  # v7.3 is HDF5
        return _read_h5(path, u, y, fs_hz)
    except Exception as error:  # on damaged files the readers raise what they will
        raise InputError(DAMAGED, str(path), None, DAMAGED_HINT) from error
    return _raw_arrays(path, {name: value for name, value in entries.items() if not name.startswith("__")})


def _write_mat(path: Path, record: Record) -> None:
    from scipy.io import savemat

    savemat(path, _arrays_of(record), oned_as="column")


def _read_h5(path: Path, u: str, y: str, fs_hz: float | None) -> _Raw:
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


def _write_h5(path: Path, record: Record) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, value in _arrays_of(record).items():
            if np.ndim(value):
                file[name] = value
            else:
                file.attrs[name] = value


# ---------------------------------------------------------------- PX4 ULog


def _read_ulog(path: Path, u: str, y: str, fs_hz: float | None) -> _Raw:
    topics = {name.partition(".")[0] for name in (u, y)}
    if not all("." in name for name in (u, y)):
        raise InputError(
            "a ULog field is named topic.field",
            str(path),
            f"u {u}, y {y}",
            "for example --u vehicle_torque_setpoint.xyz[2] --y vehicle_torque_setpoint.xyz[0]",
        )
    if len(topics) > 1:
        raise InputError(
            "u and y are in two topics, each with its own times",
            str(path),
            " and ".join(sorted(topics)),
            "log both in one topic, or resample them to one rate and save them as CSV",
        )
    data = _ulog_topic(path, topics.pop())
    topic = u.partition(".")[0]
    clock = next((name for name in ("timestamp_sample", "timestamp") if name in data), None)
    if clock is None:
        raise InputError(f"topic {topic} has no times", str(path), None, DAMAGED_HINT)
    columns = {f"{topic}.{name}": values for name, values in data.items() if not name.startswith("timestamp")}
    columns["t_s"] = (data[clock] - data[clock][0]) * 1e-6
    raw = _Raw(columns, {}, lambda column, sample: f"{path} sample {sample}, {column}", "field")
    raw.jitter = JITTER_ULOG if fs_hz is not None else STEP_TOLERANCE
    return raw


def _ulog_topic(path: Path, topic: str) -> dict[str, np.ndarray]:
    from pyulog import ULog

    try:
        with contextlib.redirect_stdout(sys.stderr):  # pyulog warns on stdout, where our data go
            log = ULog(str(path))
    except Exception as error:  # as above
        raise InputError(DAMAGED, str(path), None, DAMAGED_HINT) from error
    data = next((d.data for d in log.data_list if d.name == topic and d.multi_id == 0), None)
    if data is None:
        raise InputError(
            f"no topic named {topic}", str(path), None, choose(topic, sorted({d.name for d in log.data_list}))
        )
    return data


_READERS = {
    ".csv": _read_csv,
    ".npz": _read_npz,
    ".mat": _read_mat,
    ".h5": _read_h5,
    ".hdf5": _read_h5,
    ".ulg": _read_ulog,
}
_WRITERS = {".csv": _write_csv, ".npz": _write_npz, ".mat": _write_mat, ".h5": _write_h5}
