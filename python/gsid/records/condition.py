"""What can be wrong with a measured output before any model: its mean drifts, or it has spikes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid.records.periods import Periods

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
        than 8 times their scatter, from the begin of the record.
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
    means = periods.y.mean(axis=1)
    drift, error = _drift(periods.number.astype(float), means)
    level = np.median(periods.y - periods.y[0], axis=1, keepdims=True)  # not a mean, which a spike shifts
    rest = periods.y - level
    rest -= np.median(rest, axis=0)
    begin = periods.settle_samples + periods.number * periods.period_samples
    samples = begin[:, None] + np.arange(periods.period_samples)
    return Condition(drift, error, _runs(samples[_beyond_scatter(rest)]))


def _drift(k: np.ndarray, means: np.ndarray) -> tuple[float, float]:
    """Least-squares line through the means of the periods, over the span of their numbers."""
    centred = k - k.mean()
    power = float(centred @ centred)
    slope = float(centred @ means) / power
    rest = means - means.mean() - slope * centred
    n_dof = len(k) - 2
    variance = float(rest @ rest) / n_dof / power if n_dof else np.nan
    span = float(np.ptp(k))
    return slope * span, float(np.sqrt(variance)) * span


def _beyond_scatter(rest: np.ndarray) -> np.ndarray:
    """Mask of the deviations beyond the limit; where most are 0, the smallest step is the scatter."""
    size = np.abs(rest)
    scatter = ROBUST * float(np.median(size))
    if scatter == 0.0:
        scatter = float(np.min(size[size > 0], initial=np.inf))
    return size > SPIKE * scatter


def _runs(samples: np.ndarray) -> np.ndarray:
    """First of each run of neighbours."""
    return samples[np.diff(samples, prepend=-2) > 1]
