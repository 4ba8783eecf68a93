"""Which lines an excitation has, and whether its period is the one that is thought."""

from __future__ import annotations

import logging

import numpy as np

_log = logging.getLogger(__name__)

SHARE_OF_LARGEST = 0.01  # weaker lines than this are not excited
GAP = 2.0  # ratio between neighbours, lines sorted by size, that parts excitation from by-products
SLOPE = 1.5  # power of the frequency, 30 dB per decade, by which a designed spectrum may rise or fall
SLIP_RANGE = 3  # samples by which a period that is given or found may be wrong, and is told
SLIP_SAID = 0.005  # samples per period that are worth a word: 0.6 % of a line at a fifth of the sample rate
ABOVE_NOISE = 16.0  # |mean|^2 over its variance; noise alone exceeds it once in exp(16) = 9e6 lines


def excited_lines(U: np.ndarray, n_period: int) -> np.ndarray:
    """Tell the excited lines from what a bench adds to them.

    A current loop answers the excited lines with harmonics that repeat as well as the lines do, so that noise
    alone does not tell them apart. But a designed spectrum is smooth and its by-products lie a step below:
    lines are sorted by size, and the excitation ends where two neighbours are most apart, the upper above 1 %
    of the largest and by a factor of 2 at least. Without such a step every line above 1 % counts. Where the
    step is larger between sizes that are taken relative to a slope of up to 30 dB per decade, those are
    sorted instead: the first lines of a spectrum that falls as 1/f differ by more than 2, too. The mean must
    stand 12 dB out of its own noise besides.

    Parameters
    ----------
    U : (P, K) complex
        Lines 0 .. N/2 of the input, one row per period; a single row is an input without noise.
    n_period : int
        N, samples.

    Returns
    -------
    (K,) bool; never lines 0 and N/2, which have no phase
    """
    return above_noise(U, large_lines(U, n_period))


def large_lines(U: np.ndarray, n_period: int) -> np.ndarray:
    """The first half of `excited_lines`: by size alone, without a look at the noise."""
    size = np.abs(U.mean(axis=0))
    size[0] = 0
    size[n_period / 2 == np.arange(len(size))] = 0
    if not size.any():
        return np.zeros(len(size), bool)
    as_it_is, beside_slope = _above_step(size), _above_step(size / _sloped(size))
    return max(as_it_is, beside_slope, key=lambda found: found[0])[1]


def _sloped(size: np.ndarray) -> np.ndarray:
    """Least spectrum above all lines that nowhere rises or falls by more than SLOPE, (K,).

    No lower than the weakest line that counts: noise far from the excitation would pass for its slope.
    """
    k = np.maximum(np.arange(len(size)), 1.0) ** SLOPE
    falling = np.maximum.accumulate(size * k) / k
    rising = np.maximum.accumulate((size / k)[::-1])[::-1] * k
    return np.maximum(np.maximum(falling, rising), SHARE_OF_LARGEST * size.max())


def _above_step(size: np.ndarray) -> tuple[float, np.ndarray]:
    """The largest step between neighbours in size, 1 where none reaches GAP, and the lines above it.

    A step counts as so many times that of an odd spectrum that falls as 1/f: its first lines are 3, 5/3,
    7/5 apart.
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
    """Large lines whose mean stands out of its own noise, (K,) bool; one row has none."""
    excited = large.copy()
    if len(U) > 1:
        lines = U[:, large]
        variance_of_mean = lines.var(axis=0, ddof=1) / len(U)
        excited[large] = np.abs(lines.mean(axis=0)) ** 2 > ABOVE_NOISE * variance_of_mean
    return excited


def slip(U: np.ndarray, n_period: int) -> tuple[float, float]:
    """By how many samples each period comes later than the one before it: 0 where the period is right.

    A delay of d samples turns line k by -2 pi k d/N. The turn from period to period is looked for up to
    SLIP_RANGE; the scatter over the pairs of periods tells how well it is known.

    Parameters
    ----------
    U : (P, K) complex
        Lines 0 .. K - 1 of each period.
    n_period : int
        N, samples.

    Returns
    -------
    samples, half_width : float
        The slip and half of its 99.9 % interval, which is infinite with less than three periods.
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


def say_slip(name: str, U: np.ndarray, n_period: int) -> None:
    """Warn where the input's period is not so many samples: what leaks looks like noise, and is not.

    Parameters
    ----------
    name : str
        Of the record.
    U, n_period
        As `slip`.
    """
    if len(U) < 3:
        return
    late, half_width = slip(U, n_period)
    if abs(late) < max(SLIP_SAID, half_width):
        return
    nearest = round(n_period + late)
    other = "let it be a whole number of them, and one clock make and measure it"
    if nearest != n_period:
        other = f"give {nearest}, or no period, which finds it"
    _log.warning(
        "%s: u repeats every %.6g samples, not %d: the response is biased by more than it shows; %s",
        name or "record",
        n_period + late,
        n_period,
        other,
    )
