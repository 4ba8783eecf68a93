"""What can be wrong with a measured output before any model: its mean drifts, or it has spikes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from gsid.records.periods import Periods
from gsid.records.turn import line_through_means

SPIKE = 8.0  # robust standard deviations: normal noise exceeds it once in 1e15 samples
ROBUST = 1.4826  # standard deviation of normal noise in units of its median absolute deviation


@dataclass(frozen=True)
class Condition:
    """Drift and spikes of the output of a record.

    Attributes
    ----------
    drift : float
        Change of the mean output from the first to the last period, of a straight line through the means of
        the periods [y_unit].
    drift_error : float
        Its standard error [y_unit]; NaN for two periods.
    spikes : (n,) int
        First sample of each run of samples that differ from the same samples of the other periods by more
        than 8 times their scatter, from the begin of the record. An output that a sensor holds may change up
        to one hold earlier or later than in the other periods.
    """

    drift: float
    drift_error: float
    spikes: np.ndarray

    @property
    def drifts(self) -> bool:
        """Whether the drift exceeds three standard errors."""
        return bool(abs(self.drift) > 3 * self.drift_error)


def condition_of(periods: Periods) -> Condition:
    """Drift and spikes of the output, from its periods.

    Parameters
    ----------
    periods : Periods
    """
    number = periods.number.astype(float)
    slope, error = line_through_means(number, periods.y.mean(axis=1))
    span = float(np.ptp(number))
    level = np.median(periods.y - periods.y[0], axis=1, keepdims=True)  # not a mean, which a spike shifts
    rest = periods.y - level
    usual = np.median(rest, axis=0)
    begin = periods.settle_samples + periods.number * periods.period_samples
    samples = begin[:, None] + np.arange(periods.period_samples)
    spikes = _runs(samples[_beyond_scatter(rest, usual)])
    return Condition((slope + periods.turn) * span, error * span, spikes)


def _beyond_scatter(rest: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """Mask of the deviations beyond the limit; where most are 0, the smallest step is the scatter."""
    size = np.abs(rest - usual)
    is_odd = len(size) % 2  # then the median is a sample of its own, which deviates by 0
    scatter = ROBUST * float(np.median(np.sort(size, axis=0)[is_odd:]))
    if scatter == 0.0:
        scatter = float(np.min(size[size > 0], initial=np.inf))
    held = 2 * _hold_of(rest) + 1
    low, high = (extreme(usual, held, mode="wrap") for extreme in (minimum_filter1d, maximum_filter1d))
    return np.maximum(low - rest, rest - high) > SPIKE * scatter


def _hold_of(y: np.ndarray) -> int:
    """Samples for which a sensor holds its output, (P, N); 0 if most samples differ from the one before."""
    changes = float(np.mean(np.diff(y, axis=1) != 0))
    return math.ceil(1 / changes) if 0 < changes < 0.5 else 0


def _runs(samples: np.ndarray) -> np.ndarray:
    """First of each run of neighbours."""
    return samples[np.diff(samples, prepend=-2) > 1]
