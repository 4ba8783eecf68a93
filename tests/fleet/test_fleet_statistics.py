"""Statistics of a fleet against closed forms, independent estimates and simulated fleets."""

import numpy as np
import pytest
from drift_study import DRIFTED, RISE, findings_of
from scipy import stats

from gsid.fleet.findings import times_of
from gsid.fleet.statistics import Values, discoveries, group_p, population, robust_std


def values_of(rng, n, times, between, within, std):
    unit = np.repeat(np.arange(n), times)
    y = 3.0 + np.repeat(rng.normal(0, between, n), times) + rng.normal(0, within, n * times)
    errors = std * rng.uniform(0.5, 2, n * times)
    return Values(unit, y + rng.normal(0, errors) - 3.0, errors, np.tile(np.arange(times, dtype=float), n))


def test_standard_deviations_are_those_of_the_simulation():
    """Standard errors of both are 3 % and 5 % by FLT-1; 5 of them."""
    rng = np.random.default_rng(8)
    found = population(values_of(rng, 1000, 3, 0.5, 0.2, 0.1), 1000)
    assert found.between == pytest.approx(0.5, rel=0.2)
    assert found.within == pytest.approx(0.2, rel=0.2)
    assert not found.is_log


def test_the_mean_is_covered():
    """Of 200 fleets 95 % hold the truth: 5 standard deviations of the binomial are 7.7 %."""
    held = 0
    for seed in range(200):
        found = population(values_of(np.random.default_rng([9, seed]), 60, 1, 0.5, 0.0, 0.1), 60)
        held += abs(found.mean) < 1.96 * found.mean_std
    assert abs(held / 200 - 0.95) < 0.077


def test_few_units_that_differ_do_not_enlarge_the_spread():
    rng = np.random.default_rng(3)
    y = rng.normal(0, 1, 300)
    with_outliers = np.r_[y, np.full(15, 50.0)]
    assert robust_std(with_outliers, np.full(315, 0.01)) < 1.2 * robust_std(y, np.full(300, 0.01))
    assert np.std(with_outliers) > 5


def test_without_a_spread_it_is_zero():
    assert robust_std(np.array([1.0, 1.1, 0.9]), np.ones(3)) == 0
    assert robust_std(np.array([2.0]), np.ones(1)) == 0


def test_the_change_is_that_of_a_weighted_line():
    rng = np.random.default_rng(4)
    values = values_of(rng, 30, 4, 0.5, 0.0, 0.1)
    found = population(values, 30)
    own = values.unit == 7
    weight = 1 / np.hypot(values.std[own], found.within)
    slope = np.polyfit(values.t[own], values.y[own], 1, w=weight)[0]
    assert found.drift.estimate[7] + found.common_drift == pytest.approx(3 * slope, rel=1e-9)


def test_units_without_two_times_are_not_tested():
    values = values_of(np.random.default_rng(5), 40, 1, 0.5, 0.0, 0.1)
    found = population(values, 41)  # one unit has no value
    assert np.isnan(found.drift.p).all()
    assert np.isnan(found.outlier.p[40])
    assert np.isfinite(found.outlier.p[:40]).all()
    assert np.isnan(population(values_of(np.random.default_rng(5), 5, 2, 0.5, 0.1, 0.1), 5).outlier.p).all()


def test_discoveries_are_those_of_benjamini_and_hochberg_on_units():
    p = np.array([[1e-6, 0.5, np.nan, 0.4], [0.5, 2e-3, np.nan, 0.6]])
    found = discoveries(p, 0.01)
    assert (found.units, found.parameter) == ([0, 1], [0, 1])
    assert found.q == pytest.approx([2e-6 * 3, 4e-3 * 3 / 2])
    assert discoveries(np.full((2, 3), np.nan), 0.5).units == []


def test_groups_with_equal_means_have_uniform_p_values():
    rng = np.random.default_rng(6)
    group = np.array(list("ab") * 50)
    p = [group_p(rng.normal(0, 1, 100), np.ones(100), group) for _ in range(300)]
    assert stats.kstest(p, "uniform").pvalue > 1e-4
    assert group_p(rng.normal(0, 1, 100) + (group == "a"), np.ones(100), group) < 1e-3
    assert np.isnan(group_p(np.zeros(3), np.ones(3), np.array(["a", "a", "b"])))


def test_a_drift_is_found_and_named_and_nothing_else():
    """Short form of `make fleet-study`."""
    found = findings_of(1, n=300, n_times=3, drifts=True)
    assert [flag.unit for flag in found.drifted] == [DRIFTED]
    flag = found.drifted[0]
    assert flag.parameter == "spring stiffness"
    assert abs(flag.change - (RISE - 1)) < 5 * flag.std
    assert str(flag).startswith(f"unit {DRIFTED}: spring stiffness +")
    assert findings_of(1, n=300, n_times=3, drifts=False).drifted == []


def test_times_are_dates_or_numbers():
    found = times_of(["2026-01-02", "2026-01-01", "3.5", "inf", "soon", None])
    assert found[0] - found[1] == 1
    assert found[2] == 3.5
    assert np.isnan(found[3:]).all()
