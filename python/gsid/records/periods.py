"""Divide a record into periods: period length, settling time, and periods without lost samples."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.arguments import whole_samples
from gsid.base.errors import InputError, NotPeriodicError
from gsid.records.record import check_range
from gsid.records.turn import ramp, turn_of

if TYPE_CHECKING:
    from gsid.records.record import Record

_log = logging.getLogger(__name__)
MIN_PERIOD = 4  # samples: the shortest period with an excited line below N/2 and a neighbouring line
SHARE_FOUND = 0.75  # share of u's power that must repeat for a detected period to be accepted
SHARE_GIVEN = 0.5  # the same for a period that the user states; unrelated data have a share near 0
N_CANDIDATES = 12  # number of the deepest minima of the lag difference that are examined
ALPHA = 1e-4  # false-alarm rate of one F test below
RATIO_CONTENT = 4.0  # lines below this ratio do not prove a longer period: bench noise comes in bursts


@dataclass(frozen=True, repr=False)
class Periods:
    """The complete periods of a record after settling, without those with lost samples.

    Attributes
    ----------
    u, y : (P, N) float64
        Input and output, one row per period.
    number : (P,) int
        Number of each row's period after settling, from 0.
    n_spoiled : int
        Periods omitted because they have lost samples.
    period_samples, settle_samples : int
    u_repeats : bool
        Whether all periods of the input are identical: the input is then known exactly, without noise.
    turn : float
        What the output gains in each period, as the angle of an axis that turns on and on [y_unit]. It is
        left out of `y` (`gsid.records.turn`); 0 if no such gain was found.
    """

    u: np.ndarray
    y: np.ndarray
    number: np.ndarray
    n_spoiled: int
    period_samples: int
    settle_samples: int
    u_repeats: bool
    turn: float = 0.0

    def __repr__(self) -> str:
        return (
            f"Periods({len(self.u)} of {self.period_samples} samples, {self.n_spoiled} spoiled, "
            f"after settling {self.settle_samples})"
        )


def split_periods(record: Record, *, period: int | None = None, settle: int | None = None) -> Periods:
    """Divide a record into periods.

    Parameters
    ----------
    record : Record
    period, settle : int, optional
        Period and settling [samples]. Default: the values of the record, else found from the data
        (`find_period`, `find_settling`).

    Returns
    -------
    Periods
        Samples after the last complete period are not used. A lost sample excludes only its own period.

    Raises
    ------
    InputError
        u does not repeat, or fewer than two good periods remain after settling.
    TypeError, ValueError
        The period or the settling is not a whole number.
    """
    period = record.period_samples if period is None else whole_samples("period", period)
    settle = record.settle_samples if settle is None else whole_samples("settle", settle)
    label = record.name or "record"
    check_range(record)
    if period is None:
        period = find_period(record.u, valid=record.valid, name=record.name)
        _log.info("%s: period of %d samples found from u", label, period)
    require_period(period, settle, record.name)
    if period > len(record):
        raise _too_few_periods(record, period, settle or 0, 0)
    if settle is None:
        settle = find_settling(record, period)
        if len(record) < 3 * period:
            _log.info("%s: fewer than three periods: settling cannot be checked, all samples are used", label)
        else:
            _log.info("%s: settling of %d samples found from the data", label, settle)
    u, y, good = _rows(record, period, settle)
    n_good = int(np.count_nonzero(good))
    if n_good < 2:
        raise _too_few_periods(record, period, settle, len(good) - n_good)
    n_spoiled = len(good) - n_good
    kept = np.flatnonzero(good)
    if n_spoiled:  # selecting rows copies the record, so do it only if needed
        u, y = u[good], y[good]
    u_repeats = np.array_equal(u[1:], u[:-1])
    share = float(np.ptp(u[0]) > 0) if u_repeats else _share_that_repeats(u)
    if share < SHARE_GIVEN:
        raise InputError(
            f"u does not repeat every {period} samples",
            record.name,
            f"{max(share, 0):.0%} of its power does",
            _other_period(record, period),
        )
    if not np.any(y - y[0, 0]):
        _log.warning("%s: y is constant: nothing was measured", label)
    turn = turn_of(y, kept)
    if turn:
        gain = f"{turn:.4g} {record.y_unit}".rstrip()
        _log.info("%s: y gains %s in each period, which is left out", label, gain)
        y = y - turn * ramp(kept, period)
    return Periods(u, y, kept, n_spoiled, int(period), int(settle), u_repeats, turn)


def require_period(period: int, settle: int | None, name: str) -> None:
    """Refuse a period that is too short, or a negative settling.

    Parameters
    ----------
    period, settle : int
        Samples; the settling may be None.
    name : str
        Name of the record.

    Raises
    ------
    InputError
        The period or the settling is out of range.
    """
    if period < MIN_PERIOD or (settle is not None and settle < 0):
        raise InputError(
            "period or settling is out of range",
            name,
            f"period {period}, settle {settle}",
            f"the period is at least {MIN_PERIOD} samples, the settling at least 0",
        )


def _too_few_periods(record: Record, period: int, settle: int, n_spoiled: int) -> InputError:
    return InputError(
        "fewer than two good periods after settling",
        record.name,
        f"{len(record)} samples, period {period}, settle {settle}, {n_spoiled} spoiled",
        "measure longer, or give a shorter --settle or the right --period",
    )


def _other_period(record: Record, period: int) -> str:
    """Hint for a period that is not that of u."""
    try:
        found = find_period(record.u, valid=record.valid)
    except InputError:
        return "excite with a periodic signal (gsid design), or select the command as input with --u"
    if found == period:
        return "samples may be lost: number them by a column of times, or measure without losses"
    return f"u repeats every {found} samples: omit --period, or give this value"


def _rows(record: Record, period: int, settle: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reshape u and y to (P, N) rows, and mark the rows without lost samples."""
    n_periods = max(0, len(record) - settle) // period
    part = slice(settle, settle + n_periods * period)
    shape = (n_periods, period)
    return (
        record.u[part].reshape(shape),
        record.y[part].reshape(shape),
        record.valid[part].reshape(shape).all(axis=1),
    )


def find_period(u: np.ndarray, *, valid: np.ndarray | None = None, name: str = "") -> int:
    """Find the smallest period of u.

    Candidates are the deepest minima of the power of u[n+N] - u[n] over the lag N. The criterion is the share
    of u's power that repeats. It is computed over the second half of the record (at least two periods), so
    that a transient or a pause at the start does not matter. A candidate is a multiple of the true period,
    and is divided by a prime p, if the lines that are not multiples of p have no more power than the scatter
    between periods explains (F test, and a ratio below 4). If a neighbouring lag explains u equally well, an
    error asks the user to state the period.

    Parameters
    ----------
    u : (n,) array_like
    valid : (n,) array_like of bool, optional
        False for a lost sample.
    name : str
        Name of the record, for the error message.

    Returns
    -------
    int
        Period in samples.

    Raises
    ------
    InputError
        u is constant, does not repeat, is too noisy to distinguish N from N + 1, or the record is shorter
        than two periods.
    """
    u = np.asarray(u, dtype=np.float64)
    valid = np.ones(len(u), bool) if valid is None else np.asarray(valid, bool)
    n = len(u)
    if n < 2 * MIN_PERIOD:
        raise InputError(
            "fewer than two periods: the record is too short", name, f"{n} samples", "measure longer"
        )
    if np.ptp(u[n // 2 :]) == 0:
        raise InputError(
            "u is constant in the second half of the record: it has no period",
            name,
            float(u[-1]),
            "select the excitation with --u",
        )
    difference = _lag_difference(np.where(valid, u - u[valid].mean(), 0.0))
    minima = _local_minima(difference)
    lags = minima[minima <= n // 2][:N_CANDIDATES]
    near = np.unique((lags[:, None] + np.arange(-2, 3)).ravel())
    near = near[(near >= MIN_PERIOD) & (near <= n // 2)]
    scores = {int(lag): _share_at(u, valid, int(lag)) for lag in near}
    if not scores or max(scores.values()) < SHARE_FOUND:
        raise _no_period(n, minima, difference, scores, name)
    period = _smallest_divisor(u, valid, _near_multiple_to_base(scores, n))
    neighbours = {lag: _share_at(u, valid, lag) for lag in (period - 1, period, period + 1) if lag <= n // 2}
    if _tied(neighbours, period, n):
        raise InputError(
            "u is too noisy to determine its period",
            name,
            f"{period} samples or a neighbouring value",
            "give the period with --period, or select the command as input with --u",
        )
    return period


def _lag_difference(x: np.ndarray) -> np.ndarray:
    """Power of x[n+N] - x[n] relative to that of both segments, for each lag N < 0.9 n; 1 if unrelated."""
    from scipy import fft

    n = len(x)
    size = fft.next_fast_len(2 * n, real=True)
    correlation = fft.irfft(np.abs(fft.rfft(x, size)) ** 2, size)[:n]
    energy = np.concatenate(([0.0], np.cumsum(x**2)))
    lag = np.arange(int(0.9 * n))
    both = energy[n - lag] + energy[n] - energy[lag]
    return 1 - 2 * correlation[lag] / np.maximum(both, np.finfo(float).tiny)


def _local_minima(difference: np.ndarray) -> np.ndarray:
    """Lags of the minima, deepest first."""
    middle = difference[1:-1]
    lag = 1 + np.flatnonzero((middle <= difference[:-2]) & (middle <= difference[2:]))
    lag = lag[lag >= MIN_PERIOD]
    return lag[np.argsort(difference[lag], kind="stable")]


def _good_rows(u: np.ndarray, valid: np.ndarray, period: int) -> np.ndarray:
    """Good periods of the second half, counted from the end; all periods if fewer than two are good."""
    n_periods = len(u) // period
    rows = u[len(u) - n_periods * period :].reshape(n_periods, period)
    good = valid[len(u) - n_periods * period :].reshape(n_periods, period).all(axis=1)
    rows = rows[good] if np.count_nonzero(good) >= 2 else rows
    return rows[-max(2, len(rows) // 2) :]


def _share_at(u: np.ndarray, valid: np.ndarray, period: int) -> float:
    return _share_that_repeats(_good_rows(u, valid, period))


def _share_that_repeats(rows: np.ndarray) -> float:
    """Share of the power of (P, N) rows that repeats in every row; unbiased, near 0 for unrelated rows."""
    deviation = rows - rows.mean()
    total = float(np.einsum("pn,pn->", deviation, deviation))
    mean = deviation.mean(axis=0)
    scatter = max(total - len(rows) * float(np.sum(mean**2)), 0.0)
    return 1 - scatter / (rows.size - rows.shape[1]) * rows.size / total if total > 0 else 0.0


def _near_multiple_to_base(scores: dict[int, float], n: int) -> int:
    """Return the best candidate, or an equally good shorter one of which it is nearly a multiple.

    If u is smooth, a neighbour of a long multiple can have the best score by chance. The score of the shorter
    candidate uses more periods.
    """
    best = max(scores, key=scores.get)
    tolerance = _share_tolerance(scores[best], n)
    for lag in sorted(scores):
        k = round(best / lag)
        if k >= 2 and scores[lag] >= scores[best] - tolerance and 0 < abs(best - k * lag) <= 2 * k:
            return max((other for other in scores if abs(other - lag) <= 2), key=scores.get)
    return best


def _share_tolerance(share: float, n: int) -> float:
    """Random difference (3 sigma) of two shares that are estimated from half of n samples."""
    return 3 * (1 - share) * np.sqrt(8 / n) + 1e-12


def _tied(scores: dict[int, float], period: int, n: int) -> bool:
    others = [score for lag, score in scores.items() if lag != period]
    return max(others) > scores[period] - _share_tolerance(scores[period], n)


def _smallest_divisor(u: np.ndarray, valid: np.ndarray, period: int) -> int:
    for p in _prime_factors(period):
        if period // p >= MIN_PERIOD and _repeats_within(_good_rows(u, valid, period), p):
            period //= p
    return period


def _prime_factors(n: int) -> list[int]:
    factors, p = [], 2
    while p * p <= n:
        while n % p == 0:
            factors.append(p)
            n //= p
        p += 1
    return factors + ([n] if n > 1 else [])


def _repeats_within(rows: np.ndarray, p: int) -> bool:
    """Whether each row consists of p equal parts, within the scatter between rows."""
    spectra = np.fft.rfft(rows, axis=1)
    line = np.arange(spectra.shape[1])
    ratio, limit = _excess(spectra.mean(axis=0), spectra, line % p != 0, 1 / len(rows), np.abs(rows).max())
    return ratio <= max(limit, RATIO_CONTENT)


def _excess(
    deviation: np.ndarray, spectra: np.ndarray, lines: np.ndarray, share: float, peak: float
) -> tuple[float, float]:
    """Return an F ratio and its limit: power of `deviation` (K,) over that expected from `spectra` (P, K).

    A deviation that is only noise has `share` times the variance of one period. The number of independent
    lines follows from the distribution of the variance over the lines (Satterthwaite), so that a few noisy
    lines do not count as many.
    """
    from scipy.special import fdtri

    n_periods, n_samples = len(spectra), 2 * spectra.shape[1]
    variance = np.sum(np.abs(spectra - spectra.mean(axis=0)) ** 2, axis=0)[lines] / (n_periods - 1)
    variance = variance + n_samples * (1e-12 * peak) ** 2  # rounding of the numbers and of the transform
    evenness = variance.sum() ** 2 / np.sum(variance**2) * n_periods / (n_periods - 1)
    n_lines = min(max(evenness, 1.0), len(variance))
    ratio = np.sum(np.abs(deviation[lines]) ** 2) / (share * variance.sum())
    return float(ratio), float(fdtri(2 * n_lines, 2 * n_lines * (n_periods - 1), 1 - ALPHA))


def _no_period(
    n: int, minima: np.ndarray, difference: np.ndarray, scores: dict[int, float], name: str
) -> InputError:
    late = minima[:1][(minima[:1] > n // 2) & (difference[minima[:1]] < 1 - SHARE_FOUND)]
    if late.size:
        return InputError(
            "fewer than two periods in the record",
            name,
            f"u repeats after {late[0]} of {n} samples",
            f"measure at least {2 * late[0]} samples, and more for the settling; one period is enough for "
            f"`gsid frf --lpm --period {late[0]}`",
        )
    best = max(scores, key=scores.get, default=None)
    value = (
        "no lag repeats any of it"
        if best is None
        else f"best lag {best}: {max(scores[best], 0):.0%} of the power repeats"
    )
    return NotPeriodicError(
        "u is not periodic",
        name,
        value,
        "excite with a periodic signal (gsid design), or give --period if noise hides the period; of a record"
        " that does not repeat, gsid frf estimates the response",
    )


def find_settling(record: Record, period: int) -> int:
    """Find the settling at the start of a record, in whole periods.

    The second half of the good periods (at least two) is assumed to be settled. Starting with the first
    period, the spectra of u and y are compared with the mean of the settled ones, relative to their scatter.
    The bands are each octave of lines, and each group of octaves from line 1 up, where a decay has most of
    its power (F test, false-alarm rate 1e-4 per band). A period that deviates in any band belongs to the
    settling. The first period that does not deviate ends it. With fewer than three good periods the settling
    cannot be determined, and no period is discarded.

    Parameters
    ----------
    record : Record
    period : int
        Samples.

    Returns
    -------
    int
        Samples to discard: a multiple of the period, at most half of the record.
    """
    u, y, good = _rows(record, period, 0)
    candidates = np.flatnonzero(good)
    n_settled = max(2, len(candidates) // 2)
    settled = candidates[len(candidates) - n_settled :] if len(candidates) > 2 else candidates
    last_bad = -1
    references = [(x, np.fft.rfft(x[settled], axis=1)) for x in (u, y)]
    for row in candidates[: len(candidates) - len(settled)]:
        if not any(_deviates(x[row], spectra) for x, spectra in references):
            break
        last_bad = row
    return int(last_bad + 1) * period


def _deviates(x: np.ndarray, settled: np.ndarray) -> bool:
    """Whether period x deviates from the settled spectra in a band of lines, see `find_settling`."""
    deviation = np.fft.rfft(x) - settled.mean(axis=0)
    if not np.any(deviation):  # a constant channel has no scatter to compare with
        return False
    line = np.arange(len(deviation))
    tops = 2 ** np.arange(1, int(np.log2(len(line))) + 2)
    bands = [(line >= lo) & (line < top) for top in tops for lo in {1, top // 2}]
    share, peak = 1 + 1 / len(settled), np.abs(x).max()
    tests = (_excess(deviation, settled, band, share, peak) for band in bands if band.any())
    return any(ratio > limit for ratio, limit in tests)
