"""Rate at which a sensor is refreshed that a controller reads more often, from samples that repeat."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gsid.records.record import Record

CHANGES = 50
"""Least number of changes: the misfit of changes at random times grows with the root of their number."""
WITHIN = 2.0
"""Largest distance of the changes from regular ones [samples]: 1 by rounding up to samples, 1 by jitter."""
SHARE = 0.99
"""Share of the changes within it: a spike or a lost sample is one more change."""
LEAST_HOLD = 1.05
"""Least samples between two refreshes: ties of a coarse output, which is read at its own rate, give 1."""
SAME_STEP = 2.0
"""Least ratio of the median step to the smallest. A steady ramp of a coarse output changes as regularly as
a refreshed one, but always by the same step."""
LONGEST = 3.0
"""Longest run [refreshes] used for the first estimate of the rate: a few values repeat by chance."""


def refresh_rate_hz(record: Record) -> float | None:
    """Rate of the refreshes of y [Hz]; None if its values do not repeat in this way.

    A sensor that is filtered or resampled after its refreshes has no values that repeat: its rate is not
    found.

    Parameters
    ----------
    record : Record
    """
    step = np.diff(record.y)
    changed = (step != 0) & record.valid[1:] & record.valid[:-1]
    at = np.flatnonzero(changed)
    if len(at) < CHANGES or len(at) * LEAST_HOLD > len(step):
        return None
    size = np.abs(step[at])
    hold = _regular_hold(at)
    if hold is None or np.median(size) < SAME_STEP * np.min(size):
        return None
    return record.fs_hz / hold


def _regular_hold(at: np.ndarray) -> float | None:
    """Samples between refreshes, of which these are the changes; None if the changes are not regular."""
    run = np.diff(at)
    shortest = np.quantile(run, 0.05)
    hold = np.mean(run[run <= shortest + 1])
    short = run[run < LONGEST * hold]
    hold = np.sum(short) / np.sum(np.round(short / hold))
    number = np.concatenate([[0.0], np.cumsum(np.round(run / hold))])
    hold, first = np.polyfit(number, at, 1)
    low, high = np.quantile(at - hold * number - first, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return float(hold) if hold >= LEAST_HOLD and high - low <= WITHIN else None
