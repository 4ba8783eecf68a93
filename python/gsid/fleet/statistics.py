"""Parameters over units and time: random effects, drift, outliers and groups.

A measurement of unit i at time t has the value  y = mu + b_i + d_i t + s + e,  with the unit's deviation b_i,
its drift d_i, the scatter s of repeated measurements beyond their own standard deviations, and the error e of
the fit, whose standard deviation is known. The variances of b and s are found from the medians of sums of
squares, so that the few units that differ do not enlarge them (FLT-1, FLT-2).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import optimize, stats

LEAST_UNITS = 10  # below, the variance between units is not known well enough for a test
EFFICIENCY = 0.37  # of a variance from the median of squares beside that from their mean, for normal values
LARGEST_RELATIVE_STD = 0.3  # up to which the logarithm of a value is nearly normal


@dataclass(frozen=True)
class Values:
    """One parameter of a fleet, one entry for each measurement.

    Attributes
    ----------
    unit : (n,) int
        Number of the unit, from 0.
    y, std : (n,) float
        Finite, std > 0.
    t : (n,) float
        Time; NaN if it is not known.
    """

    unit: np.ndarray
    y: np.ndarray
    std: np.ndarray
    t: np.ndarray

    @property
    def is_log(self) -> bool:
        """Whether changes are relative: all values are positive and known well enough."""
        return bool(np.all(self.y > 0) and np.all(self.std < LARGEST_RELATIVE_STD * self.y))

    def scaled(self) -> Values:
        """Logarithms with their standard deviations, if `is_log`, else the values."""
        return Values(self.unit, np.log(self.y), self.std / self.y, self.t) if self.is_log else self


@dataclass(frozen=True)
class Tested:
    """A test for each unit.

    Attributes
    ----------
    estimate, std : (m,) float
        NaN where the unit has too few measurements.
    p : (m,) float
        Two-sided; NaN as before.
    """

    estimate: np.ndarray
    std: np.ndarray
    p: np.ndarray


@dataclass(frozen=True)
class Population:
    """One parameter over the fleet.

    Attributes
    ----------
    mean, mean_std : float
        Of the units, and its standard error.
    between, within : float
        Standard deviation between units, and between measurements of a unit beyond their own.
    is_log : bool
        Whether these and the tests are of logarithms: relative changes.
    outlier, drift : Tested
        Deviation of each unit from the mean; change of each unit from its first to its last measurement,
        less that of the median unit.
    common_drift : float
        Change of the median unit.
    """

    mean: float
    mean_std: float
    between: float
    within: float
    is_log: bool
    outlier: Tested
    drift: Tested
    common_drift: float


def population(values: Values, n_units: int) -> Population:
    """Describe one parameter over the fleet, and test each unit.

    Parameters
    ----------
    values : Values
    n_units : int
        m.
    """
    scaled = values.scaled()
    within = _within(scaled, n_units)
    variance = scaled.std**2 + within**2
    change, change_std, common = _changes(scaled, variance, n_units)
    drift = _tested(change - common, change_std, _dof_within(scaled, n_units))
    mean, mean_std = _weighted(scaled.unit, scaled.y, 1 / variance, n_units)
    known = np.isfinite(mean)
    between = robust_std(mean[known], mean_std[known])
    total = np.hypot(mean_std, between)
    centre, centre_std = _centre(mean[known], total[known])
    outlier = _tested(mean - centre, total, EFFICIENCY * (np.count_nonzero(known) - 1))
    return Population(centre, centre_std, between, within, values.is_log, outlier, drift, common)


# ---- variances ------------------------------------------------------------------------------------------


def robust_std(y: np.ndarray, std: np.ndarray) -> float:
    """Standard deviation beyond that of the values, which is positive (FLT-1).

    With it half of the squares (y - mean)^2 / (std^2 + result^2) lie below the median of chi-square with one
    degree of freedom. 0 if they do so without.
    """
    if len(y) < 2:
        return 0.0

    def excess(extra: float) -> float:
        total = np.hypot(std, extra)
        centre, _ = _centre(y, total)
        share = (len(y) - 1) / len(y)  # the centre is estimated
        return float(np.median(((y - centre) / total) ** 2) / share - stats.chi2.ppf(0.5, 1))

    return _root(excess, np.ptp(y))


def _within(values: Values, n_units: int) -> float:
    """The same within units: from the sums of squares of units that were measured several times (FLT-2)."""
    count = np.bincount(values.unit, minlength=n_units)
    several = count > 1
    if np.count_nonzero(several) < LEAST_UNITS:
        return 0.0

    def excess(extra: float) -> float:
        weight = 1 / (values.std**2 + extra**2)
        mean, _ = _weighted(values.unit, values.y, weight, n_units)
        squares = np.bincount(values.unit, weight * (values.y - mean[values.unit]) ** 2, minlength=n_units)
        return float(np.median(stats.chi2.cdf(squares[several], count[several] - 1)) - 0.5)

    return _root(excess, np.ptp(values.y))


def _root(excess, largest: float) -> float:
    """Where a falling function is 0; 0 if it is not positive there."""
    if largest <= 0 or excess(0.0) <= 0:
        return 0.0
    return float(optimize.brentq(excess, 0.0, 2 * largest, rtol=1e-6))


def _dof_within(values: Values, n_units: int) -> float:
    count = np.bincount(values.unit, minlength=n_units)
    return EFFICIENCY * float(np.sum(np.maximum(count - 1, 0)))


# ---- estimates of units -----------------------------------------------------------------------------------


def _weighted(
    unit: np.ndarray, y: np.ndarray, weight: np.ndarray, n_units: int
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean of each unit and its standard deviation; NaN without a value."""
    total = np.bincount(unit, weight, minlength=n_units)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.bincount(unit, weight * y, minlength=n_units) / total, np.where(
            total > 0, total**-0.5, np.nan
        )


def _centre(y: np.ndarray, total: np.ndarray) -> tuple[float, float]:
    """Weighted median, which outliers do not move, with its standard error for normal values."""
    order = np.argsort(y)
    weight = 1 / np.maximum(total, np.finfo(float).tiny)[order] ** 2
    cumulated = np.cumsum(weight) - weight / 2
    centre = float(np.interp(cumulated[-1] / 2 + weight[-1] / 4, cumulated, y[order]))
    return centre, float(np.sqrt(np.pi / 2 / np.sum(weight)))


def _changes(values: Values, variance: np.ndarray, n_units: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Change of each unit between its first and last time by its weighted line, and the median change."""
    known = np.isfinite(values.t)
    unit, y, t, weight = values.unit[known], values.y[known], values.t[known], 1 / variance[known]
    middle, _ = _weighted(unit, t, weight, n_units)
    apart = t - middle[unit]
    spread = np.bincount(unit, weight * apart**2, minlength=n_units)
    first, last = np.full(n_units, np.inf), np.full(n_units, -np.inf)
    np.minimum.at(first, unit, t)
    np.maximum.at(last, unit, t)
    with np.errstate(divide="ignore", invalid="ignore"):
        span = np.where(spread > 0, last - first, np.nan)
        change = span * np.bincount(unit, weight * apart * y, minlength=n_units) / spread
        std = span / np.sqrt(spread)
    moved = change[np.isfinite(change)]
    common = float(np.median(moved)) if len(moved) >= LEAST_UNITS else 0.0
    return change, std, common


def _tested(estimate: np.ndarray, std: np.ndarray, dof: float) -> Tested:
    """Two-sided t tests; without enough units there is no test."""
    if dof < EFFICIENCY * (LEAST_UNITS - 1):
        return Tested(estimate, std, np.full(len(estimate), np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        return Tested(estimate, std, 2 * stats.t.sf(np.abs(estimate / std), dof))


# ---- several parameters -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Discoveries:
    """Units that differ, at a false discovery rate.

    Attributes
    ----------
    units : list of int
        The smallest p-value first.
    parameter : list of int
        Of each, the parameter with the smallest p-value.
    q : list of float
        Smallest rate at which each is reported.
    """

    units: list[int] = field(default_factory=list)
    parameter: list[int] = field(default_factory=list)
    q: list[float] = field(default_factory=list)


def discoveries(p: np.ndarray, rate: float) -> Discoveries:
    """Units whose parameters differ (FLT-3).

    The p-value of a unit is the smallest of its parameters times their number, valid however they depend on
    each other; those of different units are independent, so that the rate of Benjamini and Hochberg holds for
    units.

    Parameters
    ----------
    p : (parameters, units) float
        NaN where there is no test.
    rate : float
    """
    tests = np.count_nonzero(np.isfinite(p), axis=0)
    used = np.flatnonzero(tests)
    if not len(used):
        return Discoveries()
    some = np.where(np.isfinite(p[:, used]), p[:, used], np.inf)
    of_unit = np.minimum(1.0, some.min(axis=0) * tests[used])
    q = stats.false_discovery_control(of_unit, method="bh")
    chosen = [i for i in np.argsort(of_unit, kind="stable") if q[i] <= rate]
    return Discoveries(
        [int(used[i]) for i in chosen],
        [int(np.argmin(some[:, i])) for i in chosen],
        [float(q[i]) for i in chosen],
    )


def group_p(mean: np.ndarray, total: np.ndarray, group: np.ndarray) -> float:
    """p-value of equal means of groups, for units with these means and standard deviations (FLT-4).

    NaN with fewer than two groups of `LEAST_UNITS`.
    """
    names, count = np.unique(group, return_counts=True)
    large = names[count >= LEAST_UNITS]
    if len(large) < 2:
        return float("nan")
    scores, weights = [], []
    for name in large:
        weight = total[group == name] ** -2.0
        weights.append(weight.sum())
        scores.append(np.sum(weight * mean[group == name]) / weight.sum())
    centre = np.average(scores, weights=weights)
    square = float(np.sum(np.array(weights) * (np.array(scores) - centre) ** 2))
    return float(stats.chi2.sf(square, len(large) - 1))
