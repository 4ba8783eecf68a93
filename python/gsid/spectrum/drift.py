"""Drift of an output, as of a gyro's zero or of an integrated angle: found in spectra, and subtracted.

From its first to its last sample the output changes by an amount that is no part of the periodic response.
In the mean of the periods it is a ramp, which is in all lines with one common factor: no independent noise,
and no part of the model. The bins between the lines (FRF-6) contain the same ramp, and noise only beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from gsid.spectrum.lines import bins_of_record, lines_of, phase_factors
from gsid.spectrum.spectra import ROUNDING, Spectra

SIGNIFICANT = 3.0  # standard deviations: a smaller drift costs a fit at most 9 / (P - 1)
SAME = 3.0  # standard deviations between two halves of the bins: the end of a transient is no ramp
WIDTH = 31  # bins over which the noise is averaged; of white noise the lowest ones get too small a weight
FEWEST = 3 * WIDTH  # bins


def find_drift(one: Spectra) -> float:
    """Drift of the output over a period, from the bins between the lines.  Eq: NOI-6

    Parameters
    ----------
    one : Spectra

    Returns
    -------
    float
        In units of y. 0 if it is not significant, or rounding; if the bins do not agree on it; if a period
        was lost; or if the input differs between the periods: in a closed loop it contains the drift too.
    """
    rounding = ROUNDING * float(np.max(np.abs(one.Y)))
    if one.n_periods < 2 or one.n_spoiled or not one.input_repeats or rounding == 0:
        return 0.0
    n_all = one.n_periods * one.period_samples
    bins = np.arange(1, (n_all + 1) // 2)
    bins = bins[bins % one.n_periods > 0]
    if len(bins) < FEWEST:
        return 0.0
    measured = bins_of_record(one.Y, one.period_samples, one.settle_samples)[bins]
    # Divided by that of the ramp, a bin shows the drift in its real part, and as much noise in both parts.
    ratio = measured / np.fft.rfft(_ramp(n_all))[bins] / one.n_periods
    noise = uniform_filter1d(ratio.imag**2, WIDTH, mode="nearest")
    weight = 1 / np.maximum(noise, rounding**2)
    drift, std = _weighted_mean(ratio.real, weight)
    before = np.cumsum(weight) - weight
    low = before < np.sum(weight) / 2
    (a, std_a), (b, std_b) = (_weighted_mean(ratio.real[part], weight[part]) for part in (low, ~low))
    agree = abs(a - b) <= SAME * np.hypot(std_a, std_b)
    return drift if agree and abs(drift) > max(SIGNIFICANT * std, rounding) else 0.0


def without_drift(one: Spectra, drift: float) -> Spectra:
    """Subtract a drift from the output; its mean stays.

    Parameters
    ----------
    one : Spectra
    drift : float
        Over a period, as `find_drift`.
    """
    n, periods = one.period_samples, np.arange(one.n_periods)
    lines = lines_of(_ramp(n)) * phase_factors(one.line, one.settle_samples, n)
    part = np.tile(lines, (one.n_periods, 1))
    part[:, 0] = periods - periods.mean()
    return replace(one, Y=one.Y - drift * part)


def _ramp(n: int) -> np.ndarray:
    """From -1/2 to 1/2, without mean."""
    return (np.arange(n) - (n - 1) / 2) / n


def _weighted_mean(x: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Mean and its standard deviation, for weights that are one over the variance."""
    whole = np.sum(weight)
    return float(weight @ x / whole), float(1 / np.sqrt(whole))
