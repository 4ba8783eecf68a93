"""Find the excited lines of a periodic input, and check its period."""

from __future__ import annotations

import logging

import numpy as np

_log = logging.getLogger(__name__)

SHARE_OF_LARGEST = 0.01  # weaker lines are not excited
GAP = 2.0  # ratio of neighbours, lines sorted by size, that separates the excitation from its harmonics
SLOPE = 1.5  # power of the frequency, 30 dB per decade, by which a designed spectrum may rise or fall
SLIP_RANGE = 3  # samples: largest error of the period that is detected
SLIP_REPORTED = 0.005  # samples per period: 0.6 % of a line at a fifth of the sample rate
ABOVE_NOISE = 16.0  # |mean|^2 over its variance; noise alone exceeds it once in exp(16) = 9e6 lines


def excited_lines(U: np.ndarray, n_period: int) -> np.ndarray:
    """Separate the excited lines from the harmonics that a test bench adds.

    A current loop responds to the excited lines with harmonics. They repeat exactly as the lines do, so a
    noise test does not separate them. But a designed spectrum is smooth, and the harmonics are much smaller.
    The lines are sorted by size. The excitation ends at the largest ratio of two neighbours, if this ratio is
    at least 2 and the larger line is above 1 % of the largest. Without such a step every line above 1 %
    counts. The first lines of a spectrum that falls as 1/f also differ by more than 2. The sizes are
    therefore also sorted relative to a slope of up to 30 dB per decade, and the larger of both steps decides.
    In addition, the mean must exceed its noise by 12 dB.

    Parameters
    ----------
    U : (P, K) complex
        Lines 0 .. N/2 of the input, one row per period. A single row is an input without noise.
    n_period : int
        N, samples.

    Returns
    -------
    (K,) bool; never lines 0 and N/2, which have no phase
    """
    return above_noise(U, large_lines(U, n_period))


def large_lines(U: np.ndarray, n_period: int) -> np.ndarray:
    """Select lines by size only: `excited_lines` without the noise test."""
    size = np.abs(U.mean(axis=0))
    size[0] = 0
    size[n_period / 2 == np.arange(len(size))] = 0
    if not size.any():
        return np.zeros(len(size), bool)
    absolute, relative_to_slope = _above_step(size), _above_step(size / _sloped(size))
    return max(absolute, relative_to_slope, key=lambda found: found[0])[1]


def _sloped(size: np.ndarray) -> np.ndarray:
    """Smallest spectrum above all lines that does not rise or fall by more than SLOPE, (K,).

    It is never below the weakest line that counts. Otherwise noise far from the excitation would look like
    its slope.
    """
    k = np.maximum(np.arange(len(size)), 1.0) ** SLOPE
    falling = np.maximum.accumulate(size * k) / k
    rising = np.maximum.accumulate((size / k)[::-1])[::-1] * k
    return np.maximum(np.maximum(falling, rising), SHARE_OF_LARGEST * size.max())


def _above_step(size: np.ndarray) -> tuple[float, np.ndarray]:
    """Largest ratio of neighbours in size, 1 if none reaches GAP, and the lines above it.

    Each ratio is divided by that of an odd spectrum that falls as 1/f, whose lines have the ratios 3, 5/3,
    7/5.
    """
    ordered = np.sort(size)[::-1]
    n_strong = np.count_nonzero(ordered > SHARE_OF_LARGEST * ordered[0])
    twice = 2 * np.arange(1, n_strong + 1)
    step = ordered[:n_strong] / np.maximum(ordered[1 : n_strong + 1], np.finfo(float).tiny)
    step *= (twice - 1) / (twice + 1)
    last = int(np.argmax(step))
    if step[last] < GAP:
        return 1.0, size >= ordered[n_strong - 1]
    return float(step[last]), size >= ordered[last]


def above_noise(U: np.ndarray, large: np.ndarray) -> np.ndarray:
    """Large lines whose mean exceeds its noise, (K,) bool. A single row has no noise."""
    excited = large.copy()
    if len(U) > 1:
        lines = U[:, large]
        variance_of_mean = lines.var(axis=0, ddof=1) / len(U)
        excited[large] = np.abs(lines.mean(axis=0)) ** 2 > ABOVE_NOISE * variance_of_mean
    return excited


def slip(U: np.ndarray, n_period: int) -> tuple[float, float]:
    """Estimate the delay of each period relative to the one before it; 0 if the period is correct.

    A delay of d samples shifts the phase of line k by -2 pi k d/N. The delay is searched up to SLIP_RANGE.
    Its uncertainty follows from the scatter over the pairs of periods.

    Parameters
    ----------
    U : (P, K) complex
        Lines 0 .. K - 1 of each period.
    n_period : int
        N, samples.

    Returns
    -------
    samples, half_width : float
        The delay and half of its 99.9 % interval, which is infinite with fewer than three periods.
    """
    from scipy.special import stdtrit

    turn = 2j * np.pi * np.arange(U.shape[1]) / n_period
    pairs = U[1:] * U[:-1].conj()
    grid = np.linspace(-SLIP_RANGE, SLIP_RANGE, 8 * SLIP_RANGE + 1)
    coarse = grid[np.argmax((np.exp(np.outer(grid, turn)) @ pairs.sum(axis=0)).real)]
    pairs = pairs * np.exp(coarse * turn)
    steepness = np.maximum(np.abs(pairs) @ turn.imag**2, np.finfo(float).tiny)
    late = coarse - np.imag(pairs) @ turn.imag / steepness
    if len(late) < 2:
        return float(late.mean()), np.inf
    return float(late.mean()), float(stdtrit(len(late) - 1, 0.9995) * late.std(ddof=1) / np.sqrt(len(late)))


def warn_of_slip(name: str, U: np.ndarray, n_period: int) -> None:
    """Warn if the period of the input is not the stated one. Leakage then looks like noise but is not.

    Parameters
    ----------
    name : str
        Name of the record.
    U, n_period
        As `slip`.
    """
    if len(U) < 3:
        return
    late, half_width = slip(U, n_period)
    if abs(late) < max(SLIP_REPORTED, half_width):
        return
    nearest = round(n_period + late)
    other = "use a whole number of samples per period and one clock for output and recording"
    if nearest != n_period:
        other = f"give {nearest}, or omit the period to have it determined"
    _log.warning(
        "%s: u repeats every %.6g samples, not %d: the response is biased by more than its uncertainty; %s",
        name or "record",
        n_period + late,
        n_period,
        other,
    )
