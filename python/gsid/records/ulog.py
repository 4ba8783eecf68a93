"""Read records from PX4 ULog files, by topic."""

from __future__ import annotations

from pathlib import Path

from gsid.base.errors import InputError
from gsid.records.foreign import read_foreign
from gsid.records.raw import DAMAGED_HINT, Raw


def read_ulog(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
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
    topic = topics.pop()
    entries, _ = read_foreign("ulg", path, u, y)
    data = {name.partition(".")[2]: values for name, values in entries.items()}
    clock = next((name for name in ("timestamp_sample", "timestamp") if name in data), None)
    if clock is None:
        raise InputError(f"topic {topic} has no times", str(path), None, DAMAGED_HINT)
    columns = {f"{topic}.{name}": values for name, values in data.items() if not name.startswith("timestamp")}
    columns["t_s"] = (data[clock] - data[clock][0]) * 1e-6
    return Raw(columns, {}, lambda column, sample: f"{path} sample {sample}, {column}", "field")
