"""Records out of PX4 ULog, by topic."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import numpy as np

from gsid.errors import InputError, choose
from gsid.io.raw import DAMAGED, DAMAGED_HINT, Raw


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
    data = _ulog_topic(path, topics.pop())
    topic = u.partition(".")[0]
    clock = next((name for name in ("timestamp_sample", "timestamp") if name in data), None)
    if clock is None:
        raise InputError(f"topic {topic} has no times", str(path), None, DAMAGED_HINT)
    columns = {f"{topic}.{name}": values for name, values in data.items() if not name.startswith("timestamp")}
    columns["t_s"] = (data[clock] - data[clock][0]) * 1e-6
    return Raw(columns, {}, lambda column, sample: f"{path} sample {sample}, {column}", "field")


def _ulog_topic(path: Path, topic: str) -> dict[str, np.ndarray]:
    from pyulog import ULog

    try:
        with contextlib.redirect_stdout(sys.stderr):  # pyulog warns on stdout, where our data go
            log = ULog(str(path))
    except Exception as error:  # on damaged files the reader raises what it will
        raise InputError(DAMAGED, str(path), None, DAMAGED_HINT) from error
    data = next((d.data for d in log.data_list if d.name == topic and d.multi_id == 0), None)
    if data is None:
        raise InputError(
            f"no topic named {topic}", str(path), None, choose(topic, sorted({d.name for d in log.data_list}))
        )
    return data
