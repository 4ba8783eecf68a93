"""An output that gains the same in each period: the angle of an axis that turns on and on, or a steady drift.

Such an output is periodic but for a straight line. This line leaks into every line of the spectrum, by the
same in each period, so that it looks like a part of the response.
"""

from __future__ import annotations

import numpy as np

ALPHA = 1e-4  # false-alarm rate, as of the settling
CLEAR = 3.0  # standard deviations of the change of a sample, for two periods, which have no scatter of means


def line_through_means(number: np.ndarray, means: np.ndarray) -> tuple[float, float]:
    """Least-squares line through the means of periods.

    Parameters
    ----------
    number : (P,) int
        Number of each period.
    means : (P,) float64

    Returns
    -------
    slope, error : float
        Per period, and its standard error; NaN for two periods.
    """
    centred = number - number.mean()
    power = float(centred @ centred)
    slope = float(centred @ means) / power
    rest = means - means.mean() - slope * centred
    n_dof = len(number) - 2
    variance = float(rest @ rest) / n_dof / power if n_dof else np.nan
    return slope, float(np.sqrt(variance))


def turn_of(y: np.ndarray, number: np.ndarray) -> float:
    """What an output gains in each period (FRF-7); 0 if this is not significant.

    The slope of a line through the means of the periods, by a t test (false-alarm rate 1e-4). With two
    periods: their difference, if it exceeds three times the scatter of that of single samples.

    Parameters
    ----------
    y : (P, N) float64
        Output, one row per period.
    number : (P,) int
        Number of each period.
    """
    from scipy.special import stdtr

    slope, error = line_through_means(number.astype(float), y.mean(axis=1))
    if len(y) == 2:
        scatter = float(np.std(y[1] - y[0])) / float(number[1] - number[0])
        return slope if abs(slope) > CLEAR * scatter else 0.0
    rounding = np.finfo(float).eps * float(np.max(np.abs(y)))
    is_clear = abs(slope) > rounding and 2 * stdtr(len(y) - 2, -abs(slope) / max(error, rounding)) < ALPHA
    return slope if is_clear else 0.0


def ramp(number: np.ndarray, period_samples: int) -> np.ndarray:
    """The straight line that gains 1 in each period, without mean in period 0, (P, N) float64.

    Parameters
    ----------
    number : (P,) int
        Number of each period.
    period_samples : int
        N.
    """
    n = period_samples
    return number[:, None] + (np.arange(n) - (n - 1) / 2) / n
