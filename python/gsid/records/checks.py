"""Make a record from the contents of a file, with the same checks for every format."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np

from gsid.base.arguments import real_number
from gsid.base.errors import InputError, choose
from gsid.base.json_files import read_json
from gsid.records.clock import doubts_about_times
from gsid.records.raw import KEYS, TIME_NAMES, Raw
from gsid.records.record import Record
from gsid.records.time_stamps import rate_of_times

_log = logging.getLogger(__name__)
MIN_SAMPLES = {"period_samples": 1, "settle_samples": 0}
SLOW_HZ = 10.0  # a servo axis is not sampled so slowly, but milliseconds read as seconds are
MAX_SAMPLES = 2**53  # a double does not represent every larger integer


def to_record(path: Path, raw: Raw, u: str, y: str, fs_hz: float | None) -> Record:
    """Check the contents of a file, and make the record."""
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
        if name not in raw.columns:
            continue
        _check_real(path, name, np.asarray(raw.columns[name]), "save it as an array of numbers")
        if np.size(raw.columns[name]) != n:
            raise InputError(
                f"{u} and {name} are of unequal lengths",
                str(path),
                f"{n} and {np.size(raw.columns[name])} samples",
                "export them together",
            )
    same_length = {
        name: np.ravel(c) for name, c in raw.columns.items() if np.size(c) == n and np.ndim(c) <= 2
    }
    for name in {time_name, "valid"} & same_length.keys():
        _check_finite(raw, name, same_length[name])
    t = same_length.pop(time_name, None)
    valid = same_length.pop("valid", np.ones(n)).astype(bool)
    for name in {u, y}:
        _check_finite(raw, name, np.where(valid, same_length[name], 0))
    rate_hz = _sample_rate(path, raw, time_name or "", t, fs_hz)
    if time_name == "t" and fs_hz is None and rate_hz < SLOW_HZ:
        hint = "if it is in milliseconds, give --fs and name it t_ms"
        _log.warning("%s: the column t in seconds gives %g Hz; %s", path.name, rate_hz, hint)
    if t is None:
        _warn_of_times(path, {name: c for name, c in same_length.items() if name not in (u, y)}, rate_hz)
    text = {"u_unit": _unit_in(u), "y_unit": _unit_in(y)}
    text |= {key: str(raw.keys[key]) for key in ("u_unit", "y_unit", "hold") if key in raw.keys}
    return Record(
        u=same_length[u],
        y=same_length[y],
        fs_hz=rate_hz,
        period_samples=_key_number(path, raw, "period_samples", int),
        settle_samples=_key_number(path, raw, "settle_samples", int),
        valid=valid,
        name=path.name,
        columns={
            name: c.astype(np.float64)
            for name, c in same_length.items()
            if name not in (u, y) and c.dtype.kind in "fiub"
        },
        meta={key: str(value) for key, value in raw.keys.items() if key not in KEYS},
        **text,
    )


def _unit_in(name: str) -> str:
    """Return the unit at the end of a column's name, as in "gyro [deg/s]"; "" if it has none."""
    found = re.search(r"\[([^][]+)\]$", name)
    return found[1].strip() if found else ""


def _vector(path: Path, raw: Raw, name: str, option: str) -> np.ndarray:
    if name not in raw.columns:
        raise InputError(
            f"no {raw.what} named {name}",
            str(path),
            None,
            f"{choose(name, raw.listed or raw.columns)}; select it with {option}",
        )
    values = np.asarray(raw.columns[name])
    _check_real(path, name, values, f"select an array of numbers with {option}")
    if values.size != max(values.shape, default=1):
        raise InputError(
            f"{raw.what} {name} is not one row of samples",
            str(path),
            f"shape {values.shape}",
            "select one channel and one realisation, and save them as a vector",
        )
    return values.ravel()


def _check_real(path: Path, name: str, values: np.ndarray, hint: str) -> None:
    if values.dtype.kind not in "fiub":
        raise InputError(f"{name} does not hold real numbers", str(path), f"type {values.dtype}", hint)


def _check_finite(raw: Raw, name: str, column: np.ndarray) -> None:
    if column.dtype.kind != "f":
        return
    bad = np.flatnonzero(~np.isfinite(column))
    if bad.size:
        raise InputError(
            "a number is not finite",
            raw.where(name, int(bad[0])),
            column[bad[0]],
            "repair it, or mark the sample as lost: valid = 0",
        )


def _sample_rate(path: Path, raw: Raw, name: str, t: np.ndarray | None, fs_hz: float | None) -> float:
    stated = fs_hz if fs_hz is not None else _key_number(path, raw, "fs_hz", float)
    stated = None if stated is None else real_number("fs_hz", stated, "Hz")
    if stated is not None and not (np.isfinite(stated) and stated > 0):
        raise InputError(
            "the sample rate is not a positive number", str(path), stated, "give it with --fs [Hz]"
        )
    if t is None or len(t) < 2:
        if stated is None:
            raise InputError("the sample rate is unknown", str(path), None, _hint_of_rate(raw))
        return float(stated)
    measured = rate_of_times(raw, name, np.asarray(t, np.float64), fs_hz is not None)
    if stated is not None and abs(measured - stated) > 1e-3 * stated:
        raise InputError(
            "the given sample rate does not match the times",
            str(path),
            f"{stated:g} Hz given, {measured:g} Hz in the file",
            "correct --fs or the times",
        )
    return float(measured if stated is None else stated)


def _warn_of_times(path: Path, others: dict[str, np.ndarray], fs_hz: float) -> None:
    """Compare the rate with columns that are named as times, though they are not used."""
    numbers = {name: column for name, column in others.items() if column.dtype.kind in "fiu"}
    for doubt in doubts_about_times(numbers, fs_hz):
        _log.warning("%s: %s", path.name, doubt)


def _hint_of_rate(raw: Raw) -> str:
    """What to do without a rate; a column that may have the times in another unit is named, not used."""
    hint = "give it with --fs [Hz], or add a column t_s or a line `# fs_hz: ...`"
    times = next((name for name in (*raw.listed, *raw.columns) if "time" in name.lower()), None)
    return hint if times is None else f"{hint}; if {times} has the times in seconds, name it t_s"


def _key_number(path: Path, raw: Raw, key: str, kind: type) -> float | int | None:
    if key not in raw.keys:
        return None
    try:
        value = float(raw.keys[key])
        if kind is float:
            return value
        if value != int(value) or not MIN_SAMPLES[key] <= value <= MAX_SAMPLES:
            raise ValueError
        return int(value)
    except (TypeError, ValueError, OverflowError):
        expected = "a number" if kind is float else f"a whole number of samples, {MIN_SAMPLES[key]} or more"
        raise InputError(
            f"{key} is not {expected}", str(path), raw.keys[key], f"correct the line `# {key}: ...`"
        ) from None


def add_keys_from_meta_file(
    path: Path, raw: Raw, u: str, y: str, fs_hz: float | None, period: int | None
) -> None:
    """Read rate, period and units from a meta.json in the same folder if it lists this file."""
    place = path.parent / "meta.json"
    try:
        meta = read_json(place)
        if path.name not in meta["files"]:
            return
    except (OSError, ValueError, KeyError, TypeError):
        return  # there is no such file, or it has another purpose
    has_time = any(name in raw.columns for name in TIME_NAMES)
    for key, given in (("fs_hz", fs_hz is not None or has_time), ("period_samples", period is not None)):
        if key in meta and key not in raw.keys and not given:
            raw.keys[key] = meta[key]
            _log.info("%s: %s = %s from meta.json in its folder", path.name, key, meta[key])
    units = _units_of(meta.get("channels", []), str(place))
    for key, name in (("u_unit", u), ("y_unit", y)):
        if name in units:
            raw.keys.setdefault(key, units[name])


def _units_of(channels: object, place: str) -> dict[str, str]:
    """Return the units of the channels by name."""
    units = {}
    for channel in channels if isinstance(channels, list) else [channels]:
        name, unit = (
            (channel.get("name"), channel.get("unit", "")) if isinstance(channel, dict) else (None, "")
        )
        if not isinstance(name, str) or not isinstance(unit, str):
            hint = 'write "channels": [{"name": "u", "unit": "A"}, ...], or omit it'
            raise InputError("channels is not a list of names and units", place, repr(channel)[:60], hint)
        units[name] = unit
    return units
