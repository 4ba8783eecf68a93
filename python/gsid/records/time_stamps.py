"""The sample rate of a column of times, which has to be that of equally spaced samples without gaps."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import numpy as np

from gsid.base.errors import InputError
from gsid.records.raw import Raw
from gsid.records.record import LARGEST

_log = logging.getLogger(__name__)
STEP_TOLERANCE = 0.01  # of a step, in addition to the resolution of the written times
GAP = 0.5  # of a step: shift of the mean times that is a lost sample, where the user states the rate
SURE = 5.0  # standard deviations of that shift by jitter alone


def rate_of_times(raw: Raw, name: str, t: np.ndarray, is_stated: bool) -> float:
    """Compute the rate of equally spaced times, rounded to a whole number if their resolution allows it.

    If the user states the rate, jitter of the times is attributed to the clock that wrote them, and so is a
    resolution that is coarser than a step. A gap is an error in any case.

    Parameters
    ----------
    raw : Raw
        For the position of an error.
    name : str
        Of the column.
    t : (n,) ndarray
        Times [s], n >= 2.
    is_stated : bool
        Whether the user states the rate.

    Raises
    ------
    InputError
        The times do not increase, or have gaps or unequal steps.
    """
    resolution = _resolution(t)
    with np.errstate(over="ignore"):  # differences of huge times are checked below
        step = float(t[-1] - t[0]) / (len(t) - 1) if is_stated else float(np.median(np.diff(t)))
    if step <= 0:
        raise _not_increasing(raw.where, name, t, resolution)
    if not 1 / LARGEST < step < LARGEST:
        hint = "write the times in seconds, or omit them and give the rate with --fs"
        raise InputError("the time step is out of range", raw.where(name, 1), f"{step:.3g} s", hint)
    at = (_first_gap if is_stated else _first_unequal)(t, step, resolution)
    if at is not None:
        raise InputError(
            "unequal time steps",
            raw.where(name, at),
            f"{t[at] - t[at - 1]:.6g} s after {step:.6g} s",
            "insert lost samples as rows with valid = 0, or resample to one rate"
            + ("" if is_stated else "; if only the timestamps jitter, give the rate with --fs"),
        )
    rate = (len(t) - 1) / (t[-1] - t[0])
    slack = rate * 2 * resolution / (t[-1] - t[0])
    return float(round(rate)) if abs(rate - round(rate)) <= slack else float(rate)


def _not_increasing(
    where: Callable[[str, int], str], name: str, t: np.ndarray, resolution: float
) -> InputError:
    back = int(np.flatnonzero(np.diff(t) <= 0)[0]) + 1
    is_coarse = t[-1] > t[0] and t[back] == t[back - 1]
    what = "the times are coarser than a sample" if is_coarse else "the times do not increase"
    hint = (
        f"they are rounded to {resolution:g} s: give the rate with --fs"
        if is_coarse
        else "sort the rows by time"
    )
    return InputError(what, where(name, back), t[back], hint)


def _first_unequal(t: np.ndarray, step: float, resolution: float) -> int | None:
    off = np.abs(np.diff(t) - step) > min(STEP_TOLERANCE * step + resolution, 0.5 * step)
    return int(np.flatnonzero(off)[0]) + 1 if off.any() else None


def _first_gap(t: np.ndarray, step: float, resolution: float) -> int | None:
    """Sample from which on all later times are shifted; jitter does not last.

    The mean lateness of the samples after it is compared with that of the samples before it, of so many that
    jitter alone does not reach half a step: a gap nearer to an end of the record does not show. Where no two
    such sides fit into the record, times that never go back are taken as they are, with a warning.
    """
    number = np.arange(len(t))
    late = t - t[0] - step * number
    late = late - np.polyval(np.polyfit(number, late, 1), number)  # the first and last stamp jitter too
    low, high = np.quantile(np.diff(late), (0.05, 0.95))  # of normal jitter: 3.29 standard deviations
    spread = math.hypot((high - low) / 3.29 / math.sqrt(2), resolution / math.sqrt(12))
    n = max(1, math.ceil(2 * (SURE * spread / (GAP * step)) ** 2))
    if 2 * n > len(t):
        return _first_back(t)
    sums = np.concatenate([[0.0], np.cumsum(late)])
    mean = (sums[n:] - sums[:-n]) / n
    shift = np.abs(mean[n:] - mean[:-n])  # at sample n, n + 1, ...
    found = np.flatnonzero(shift > GAP * step)
    if not len(found):
        return None
    return n + int(found[0] + np.argmax(shift[found[0] : found[0] + 2 * n]))


def _first_back(t: np.ndarray) -> int | None:
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        return int(back[0]) + 1
    _log.warning("the times are too coarse to show a lost sample")
    return None


def _resolution(t: np.ndarray) -> float:
    """Resolution of the times: their last decimal digit, or their floating-point rounding."""
    rounding = (
        4 * float(np.abs(t).max()) * np.finfo(np.float32 if np.all(t == t.astype(np.float32)) else float).eps
    )
    some = np.concatenate([t[:500], t[-500:]])  # every n-th may be rounder
    for decimals in range(1, 10):
        if np.all(np.abs(some - np.round(some, decimals)) <= rounding):
            return 10.0**-decimals
    return rounding
