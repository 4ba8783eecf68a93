"""A column of times under another name than t_s: it is not used, but its rate and its gaps are compared."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

NAMED_AS_TIMES = re.compile(r"time|zeit|^t([ _[(]|$)", re.IGNORECASE)
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SAME_RATE = 0.01  # relative: clocks agree to 1e-4, and decimal multiples differ by 10
REGULAR = 0.99  # share of the steps near the median from which on a long step is a gap
GAP = 1.5  # steps


def doubts_about_times(columns: Mapping[str, np.ndarray], fs_hz: float) -> list[str]:
    """What columns that are named as times have against the sample rate, one sentence each.

    Parameters
    ----------
    columns : mapping of (n,) ndarray
        Other columns than input and output.
    fs_hz : float
        Sample rate as it was given [Hz].
    """
    found = []
    for name, column in columns.items():
        if NAMED_AS_TIMES.search(name) and len(column) > 2 and np.all(np.isfinite(column)):
            found += _doubts(name, np.diff(column), fs_hz)
    return found


def _doubts(name: str, step: np.ndarray, fs_hz: float) -> list[str]:
    usual, mean = float(np.median(step)), float(np.mean(step))
    if usual <= 0 or mean <= 0:  # no times, or too coarse to show a step
        return []
    in_units = [unit for unit, size in UNITS.items() if _agree(usual * size * fs_hz, mean * size * fs_hz)]
    if not in_units:
        return [
            f"the column {name} has steps of {usual:.6g}, but {fs_hz:g} Hz was given: times in "
            f"{', '.join(UNITS)} would have another step; check --fs"
        ]
    regular = np.abs(step / usual - 1) < GAP - 1
    gaps = np.flatnonzero(step > GAP * usual)
    if not len(gaps) or np.mean(regular) < REGULAR:
        return []
    n_lost = int(np.sum(np.round(step[gaps] / usual) - 1))
    return [
        f"samples are lost: the column {name} lacks {n_lost}, the first after sample {gaps[0]}; insert a row "
        "with valid = 0 for each, since all later samples are shifted"
    ]


def _agree(usual: float, mean: float) -> bool:
    """Whether the usual or the mean step is one sample: gaps change the mean, coarse times the usual one."""
    return min(abs(usual - 1), abs(mean - 1)) < SAME_RATE
