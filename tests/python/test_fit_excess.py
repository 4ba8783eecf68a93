"""Fits that leave more than noise: reported whatever the cause, and right fits no more often than stated."""

import dataclasses
import logging

import numpy as np
import pytest
from damped_axes import FAMILIES, HOLDS, ending, random_axis, with_noise
from scipy import stats
from scipy.signal import chirp, lfilter

from gsid.fitting.estimators import fit_all
from gsid.fitting.excess import ALPHA, excess
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.frf import Frf

TRUTH = RationalModel([200, 9000], [1, 40, 900], 2e-3)
F = np.arange(1, 151) * 4.0


def excess_warnings(model):
    return [warning for warning in model.warnings if warning.what == "excess_cost"]


def sampled(seed, n_periods, share=0.01):
    """A response of so many periods, its variances as uncertain as those are."""
    rng = np.random.default_rng([20261122, seed, n_periods])
    response = with_noise(TRUTH, F, rng, share)
    dof = n_periods - 1
    scatter = rng.chisquare(2 * dof, len(F)) / (2 * dof)
    return dataclasses.replace(response, var_g=response.var_g * scatter, n_dof=float(dof))


# ---- right fits ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "n_periods", "n_seeds"),
    [("ml", 2, 400), ("ml", 4, 400), ("ml", 9, 400), ("ml", 40, 400), ("nls", 9, 200), ("log", 9, 200)],
)
def test_right_fits_are_reported_no_more_often_than_stated(method, n_periods, n_seeds):
    """Shares of p below 5 %, 1 % and the level of the warning, each in its 99.9 % binomial range."""
    p_values = []
    for seed in range(n_seeds):
        response = sampled(seed, n_periods)
        model = fit(response, "2/1", method=method, start=TRUTH, quiet=True)
        p_values.append(excess(model, response)[1])
        assert bool(excess_warnings(model)) == (p_values[-1] < ALPHA)
    found = {level: int(np.sum(np.array(p_values) < level)) for level in (0.05, 0.01, ALPHA)}
    print(f"{method}, {n_periods} periods: below {found} of {n_seeds}")
    for level, n_below in found.items():
        low, high = stats.binom.interval(0.999, n_seeds, level)
        assert low <= n_below <= high, (level, n_below)


def test_errors_far_below_the_response_are_no_reason_for_a_warning():
    """Records without noise, exact or rounded to seven digits: their periods do not differ."""
    n, fs_hz = 1000, 1000.0
    lines = np.zeros(n // 2 + 1, complex)
    lines[1:201] = np.exp(2j * np.pi * np.random.default_rng(3).uniform(size=200)) * n / 2
    y = np.tile(np.fft.irfft(lines * TRUTH.response(np.arange(len(lines)) * fs_hz / n)), 4)
    u = np.tile(np.fft.irfft(lines), 4)
    for output in (y, y.astype(np.float32).astype(float)):
        response = frf(Record(u, output, fs_hz, n, 0, hold="none"), band=(1, 200))
        assert not excess_warnings(fit(response, "2/1", quiet=True))


def test_variances_that_neighbouring_lines_share_are_not_judged():
    response = dataclasses.replace(sampled(0, 9), method="lpm")
    assert not excess_warnings(fit(response, "1/0", quiet=True))


# ---- whatever the cause ----------------------------------------------------------------------------------


def test_bug_a_wrong_minimum_came_without_a_word():
    """Begun with poles where the axis has none the fit converges to many times the least cost."""
    response = with_noise(TRUTH, F, np.random.default_rng(1), 1e-3)
    start = RationalModel([1, 2e4], [1, 6e3, 2e7], TRUTH.delay_s - 1e-3)
    model = fit(response, "2/1", start=start, quiet=True)
    assert model.converged
    assert model.cost > 10 * fit(response, "2/1", start=TRUTH, quiet=True).cost
    (warning,) = excess_warnings(model)
    assert warning.cost_per_dof == pytest.approx(model.cost / model.cost_expected, rel=1e-5)
    assert warning.p_value < 1e-12
    for words in ("order", "not linear", "a local minimum", "--method ga", "--delay SECONDS"):
        assert words in warning.text


@pytest.mark.parametrize("method", ["ml", "nls", "log", "iwls", "ls"])
def test_an_order_too_low_is_reported_by_every_method(method):
    assert excess_warnings(fit(sampled(0, 9), "1/0", method=method, quiet=True))
    found = fit(sampled(0, 9, 1e-4 if method == "ls" else 0.01), "2/1", method=method, quiet=True)
    assert not excess_warnings(found)


def test_distortion_that_repeats_with_the_period_is_reported():
    response = sampled(0, 9)
    distortion = (
        0.03 * np.abs(response.g) * np.exp(2j * np.pi * np.random.default_rng(2).uniform(size=len(F)))
    )
    assert excess_warnings(fit(dataclasses.replace(response, g=response.g + distortion), "2/1", quiet=True))


def test_errors_in_the_input_are_counted_by_ml_io():
    """A right fit of a noisy input leaves what var_u adds at the model's own gain."""
    rng, n, fs_hz = np.random.default_rng(4), 600, 600.0
    lines = np.zeros(n // 2 + 1, complex)
    lines[1:121] = np.exp(2j * np.pi * rng.uniform(size=120)) * n / 2
    f_hz = np.arange(len(lines)) * fs_hz / n
    u, y = np.tile(np.fft.irfft(lines), 10), np.tile(np.fft.irfft(lines * TRUTH.response(f_hz)), 10)
    u, y = (x + 0.3 * np.std(x) * rng.standard_normal(len(x)) for x in (u, y))
    response = frf(Record(u, y, fs_hz, n, 0, hold="none"), band=(1, 120))
    right = fit(response, "2/1", method="ml-io", quiet=True)
    assert not excess_warnings(right)
    assert excess(right, response)[1] > ALPHA
    assert excess_warnings(fit(response, "1/0", method="ml-io", quiet=True))


# ---- where it is reported --------------------------------------------------------------------------------


def test_the_warning_is_logged_kept_in_the_file_and_shown_in_tables(caplog, tmp_path):
    response = sampled(0, 9)
    with caplog.at_level(logging.WARNING, logger="gsid"):
        model = fit(response, "1/0")
    (warning,) = excess_warnings(model)
    assert warning.text in [record.getMessage() for record in caplog.records]
    model.save(tmp_path / "m.json")
    assert RationalModel.load(tmp_path / "m.json").warnings == model.warnings
    assert "warning: this ml fit leaves" in repr(model)
    assert "times that of noise: try another order" in repr(fit_all(response, "1/0", methods=["ml", "nls"]))


# ---- random damped axes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("family", FAMILIES)
def test_random_damped_axes_end_in_the_least_minimum_or_report_it(family, hold):
    """Ten axes of each family and hold, outside any grid of the search (`make minima-study` takes 80)."""
    found = [ending(seed, family, hold, n_starts=3) for seed in range(10)]
    wrong = [one for one in found if one.wrong]
    print(f"{family}, hold {hold}: wrong {wrong}")
    assert len(wrong) <= 1
    assert all(one.reported for one in wrong if one.per_line > 1.5)


def test_the_truth_of_a_random_axis_costs_what_noise_leaves():
    """Each of 40, and their sum, within the 99.9 % range of chi-square of two for each line."""
    costs, n_lines = [], []
    for seed in range(40):
        axis = random_axis(seed, FAMILIES[seed % 2], HOLDS[seed // 2 % 2])
        costs.append(2 * axis.true_cost)
        n_lines.append(len(axis.response.f_hz))
    low, high = stats.chi2.interval(1 - 0.001 / 40, 2 * np.array(n_lines))
    assert np.all((costs > low) & (costs < high))
    low, high = stats.chi2.interval(0.999, 2 * sum(n_lines))
    assert low < sum(costs) < high


def test_frf_of_known_variance_is_judged_by_chi_square():
    g = TRUTH.response(F)
    response = Frf.from_arrays(F, g * 1.001, np.abs(g * 1e-3) ** 2, fs_hz=3000)
    ratio, p_value = excess(dataclasses.replace(TRUTH, method="ml", cov=np.eye(4)), response)
    assert ratio == pytest.approx(len(F) / (len(F) - 2), rel=1e-3)
    assert p_value == pytest.approx(stats.chi2.sf(2 * len(F), 2 * len(F) - 4), rel=1e-2)


# ---- responses by windows --------------------------------------------------------------------------------


def by_windows(u, y):
    return frf(Record(u, y, 1000.0, hold="none"), window=1024)


def test_noise_in_windows_is_reported_no_more_often_than_stated():
    """A gain without a memory has no leakage. Neighbouring lines under a Hann window are not independent."""
    alarms = 0
    for seed in range(100):
        rng = np.random.default_rng([20261123, seed])
        u = rng.standard_normal(20000)
        y = u + 0.1 * rng.standard_normal(len(u))
        alarms += len(excess_warnings(fit(by_windows(u, y), "0/0", delay="none", quiet=True)))
    print("alarms of 100:", alarms)
    assert alarms <= stats.binom.ppf(0.9999, 100, ALPHA)


def test_bug_leakage_of_windows_left_the_intervals_of_noise():
    """A chirp through a lag of 1 s: the pole was nine standard deviations off, and nothing was reported."""
    rng = np.random.default_rng(20261123)
    t = np.arange(20000) / 1000.0
    u = chirp(t, 0.3, t[-1], 100.0, method="log")
    y = lfilter([1 - np.exp(-1e-3)], [1, -np.exp(-1e-3)], u)
    model = fit(by_windows(u, y + 2e-4 * rng.standard_normal(len(y))), "1/0", delay="none", quiet=True)
    (warning,) = excess_warnings(model)
    assert "leakage of the windows biases the response" in warning.text
    assert model.cov_noise is not None
    assert model.std_den[-1] > 2 * model.noise_only().std_den[-1]
