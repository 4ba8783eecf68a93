"""fit() recovers what made the data: simulated responses with known truth, and a real motor bench."""

import contextlib
import dataclasses

import numpy as np
import pytest
from scipy import stats

from gsid.base.errors import GsidError
from gsid.fitting.rational import METHODS, fit, initial_delay, parse_order
from gsid.models.rational import RationalModel
from gsid.records.files import read_record
from gsid.response.estimate import frf
from gsid.response.frf import Frf
from measured import BENCH, needs_bench

SEED = 20260302
TRUTH = RationalModel([40.0, 900.0], [1.0, 30.0, 2000.0], 0.0042)
F = np.arange(1, 241) * 0.5


def measured(truth=TRUTH, *, rng, periods=20, noise=0.01, f=F, hold="none"):
    """An Frf as `periods` periods with white output noise would give it, sample variances included."""
    g = truth.response(f)
    sigma = noise * np.max(np.abs(g))
    normal = rng.standard_normal((2, periods, len(f))) * sigma / np.sqrt(2)
    each = g + normal[0] + 1j * normal[1]
    var = np.var(each, axis=0, ddof=1)
    n = len(f)
    return Frf(
        line=np.arange(1, n + 1),
        f_hz=f,
        g=each.mean(0),
        var_g=var / periods,
        u=np.ones(n, complex),
        y=g,
        var_u=np.zeros(n),
        var_y=var,
        cov_yu=np.zeros(n, complex),
        n_periods=periods,
        n_realisations=1,
        n_spoiled=0,
        settle_samples=0,
        period_samples=6000,
        fs_hz=3000.0,
        hold=hold,
        u_unit="V",
        y_unit="deg/s",
        name="simulated",
    )


def test_intervals_of_every_parameter_cover_the_truth():
    """95 % intervals over 200 repeats; the binomial 99.8 % range of coverage is 0.895 to 0.985."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    truth = np.concatenate([TRUTH.den[1:], TRUTH.num, [TRUTH.delay_s]])
    inside, n = np.zeros(5), 200
    for _ in range(n):
        model = fit(measured(rng=rng), "2/1")
        estimate = np.concatenate([model.den[1:], model.num, [model.delay_s]])
        inside += np.abs(estimate - truth) < 1.96 * np.sqrt(np.diag(model.cov))
    lo, hi = stats.binom.interval(0.998, n, 0.95)
    assert np.all((inside >= lo) & (inside <= hi)), inside / n


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_the_plant_without_a_starting_value(method):
    model = fit(measured(rng=np.random.default_rng(SEED), noise=1e-4), "2/1", method=method)
    assert model.stable
    assert model.delay_s == pytest.approx(TRUTH.delay_s, abs=2e-5)
    np.testing.assert_allclose(model.den, TRUTH.den, rtol=0.02)
    assert np.all(np.isfinite(model.cov))
    assert (model.cost_expected is not None) == (method in ("ml", "ml-io"))


@pytest.mark.parametrize("method", ["nls", "nls-output", "log", "ml", "ml-io"])
def test_nlopt_finds_what_gauss_and_newton_find(method):
    response = measured(rng=np.random.default_rng(SEED))
    one, other = (fit(response, "2/1", method=method, solver=solver) for solver in ("gauss-newton", "nlopt"))
    # Both settle within 0.005 of a V of about 240; a standard deviation is worth 0.5.
    assert other.cost == pytest.approx(one.cost, rel=1e-3)
    assert abs(one.delay_s - other.delay_s) < 0.1 * one.std_delay_s


def test_a_start_may_be_given():
    response = measured(rng=np.random.default_rng(SEED), noise=1e-4)
    near = RationalModel(TRUTH.num * 1.1, TRUTH.den, TRUTH.delay_s + 2e-4)
    assert fit(response, "2/1", start=near).delay_s == pytest.approx(TRUTH.delay_s, abs=1e-5)


def test_a_least_delay_is_kept():
    """Without delay the noise makes it negative about every other time."""
    truth = RationalModel(TRUTH.num, TRUTH.den, 0.0)
    rng = np.random.default_rng(SEED)
    responses = [measured(truth, rng=rng) for _ in range(6)]
    assert min(fit(response, "2/1").delay_s for response in responses) < 0
    assert all(fit(response, "2/1", min_delay_s=0.0).delay_s >= 0 for response in responses)


def test_the_slope_of_the_phase_is_the_delay_of_a_pure_delay():
    response = measured(RationalModel([2.0], [1.0], 0.0042), rng=np.random.default_rng(SEED), noise=1e-9)
    assert initial_delay(response) == pytest.approx(0.0042, rel=1e-6)
    with pytest.raises(ValueError, match="two lines"):
        initial_delay(response, (1.0, 1.0))


def noisy_input(rng, periods=40, noise=0.05):
    """Records of a plant whose input is measured with noise, and as much of it in the output."""
    from gsid.records.record import Record

    n, fs = 600, 600.0
    line = np.arange(1, 121)
    u = (
        np.fft.irfft(np.concatenate([[0], np.exp(1j * rng.uniform(0, 2 * np.pi, 120)), np.zeros(180)]))
        * n
        / 2
    )
    lines = np.fft.rfft(u)
    lines[line] *= TRUTH.response(line * fs / n)
    y = np.fft.irfft(lines)
    errors = rng.standard_normal((2, periods * n)) * noise * [[np.std(u)], [np.std(y)]]
    return Record(np.tile(u, periods) + errors[0], np.tile(y, periods) + errors[1], fs, n, 0, name="noisy")


def test_maximum_likelihood_with_a_noisy_input_is_eq_7_24():
    """V of the model found, by the equation errors and their variance as the source has them."""
    response = frf([noisy_input(np.random.default_rng(SEED))])
    model = fit(response, "2/1", method="ml-io")
    s = 2j * np.pi * response.f_hz
    a, b = np.polyval(model.den, s), np.polyval(model.num, s) * np.exp(-s * model.delay_s)
    error = a * response.y - b * response.u
    variance = response.var_y * abs(a) ** 2 + response.var_u * abs(b) ** 2
    variance = (variance - 2 * (response.cov_yu * a * b.conj()).real) / response.n_periods
    assert model.cost == pytest.approx(np.sum(abs(error) ** 2 / variance), rel=1e-9)
    assert abs(model.delay_s - TRUTH.delay_s) < 4 * model.std_delay_s
    assert model.cost == pytest.approx(model.cost_expected, rel=0.3)  # 120 lines: sigma 9 %


def test_cost_is_what_noise_leaves():
    """V / expected over 50 repeats: mean 1 within its standard error (about 1/sqrt(240 * 50))."""
    rng = np.random.default_rng(SEED)
    ratios = [(m := fit(measured(rng=rng), "2/1")).cost / m.cost_expected for _ in range(50)]
    assert np.mean(ratios) == pytest.approx(1, abs=5 * np.std(ratios) / np.sqrt(50))


def test_a_held_input_is_taken_out_exactly():
    """The delay does not contain the hold's half sample (0.167 ms), nor do the images bias the fit."""
    truth = RationalModel(TRUTH.num, TRUTH.den, TRUTH.delay_s, fs_hz=3000.0, hold="zoh")
    response = measured(truth, rng=np.random.default_rng(SEED), noise=1e-7, hold="zoh")
    model = fit(response, "2/1")
    assert model.hold == "zoh"
    assert model.delay_s == pytest.approx(TRUTH.delay_s, abs=1e-9)
    np.testing.assert_allclose(model.den, TRUTH.den, rtol=1e-5)
    without = fit(response, "2/1", hold="none")
    assert without.delay_s == pytest.approx(TRUTH.delay_s + 0.5 / 3000, abs=1e-5)


def test_delay_none_and_given():
    response = measured(rng=np.random.default_rng(SEED), noise=1e-5)
    assert fit(response, "2/1", delay="none").delay_s == 0
    given = fit(response, "2/1", delay=0.0042)
    assert given.delay_s == 0.0042
    assert given.std_delay_s == 0
    assert given.cov.shape == (4, 4)


def test_domain_z():
    truth = RationalModel([0.0, 0.02, 0.01], [1.0, -1.8, 0.83], 0.0, "z", 3000.0)
    model = fit(measured(truth, rng=np.random.default_rng(SEED), noise=1e-6), "2/2", domain="z", delay="none")
    np.testing.assert_allclose(model.den, truth.den, atol=1e-4)
    np.testing.assert_allclose(model.num, truth.num, atol=1e-4)


def test_an_unstable_model_is_never_returned_without_request():
    truth = RationalModel([100.0], [1.0, -5.0], 0.001)
    response = measured(truth, rng=np.random.default_rng(SEED), noise=1e-4)
    for method in ("ls", "iwls", "ml"):
        with contextlib.suppress(GsidError):  # "no stable model was found" is an answer too
            assert fit(response, "1/0", method=method).stable
    free = fit(response, "1/0", allow_unstable=True)
    assert not free.stable
    np.testing.assert_allclose(free.poles, [5.0], rtol=1e-2)


def test_two_periods_are_enough_for_a_fit_with_pooled_variances():
    model = fit(measured(rng=np.random.default_rng(SEED), periods=2, noise=1e-3), "2/1")
    assert abs(model.delay_s - TRUTH.delay_s) < 5 * model.std_delay_s


@pytest.mark.parametrize("order", ["4", "4/3/2", "a/b", "-1/2", "99/1", None])
def test_a_bad_order_is_refused(order):
    with pytest.raises(ValueError, match=r"order|poles"):
        parse_order(order)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"method": "magic"}, "method"),
        ({"domain": "w"}, "domain"),
        ({"solver": "luck"}, "solver"),
        ({"start": RationalModel([1.0], [1.0, 2.0])}, "start"),
        ({"delay": "soon"}, "delay"),
        ({"hold": "foh"}, "hold"),
        ({"band": (500, 600)}, "no line"),
        ({"order": "9/8", "band": (1.0, 2.0)}, "lines"),
        ({"order": "1/2", "hold": "zoh"}, "zeros"),
    ],
)
def test_misuse_is_a_value_error(arguments, what):
    with pytest.raises(ValueError, match=what):
        fit(measured(rng=np.random.default_rng(SEED)), **{"order": "2/1", **arguments})


def test_one_period_has_no_variance():
    response = dataclasses.replace(measured(rng=np.random.default_rng(SEED)), n_periods=1, n_dof=None)
    with pytest.raises(ValueError, match="at least 2"):
        fit(response, "2/1")


@needs_bench
def test_motor_bench_resonances():
    """The bench's anti-resonance is at 54 Hz and its resonance at 76 Hz (meta.json of the set)."""
    path = BENCH / "multisine_A.npz"
    model = fit(
        frf(read_record(path, u="iq", y="omega_motor", period=2500, settle=2500)), "4/3", band=(11, 250)
    )
    assert model.stable

    def resonances(roots):
        return np.abs(roots[roots.imag > 0]) / (2 * np.pi)

    assert np.min(np.abs(resonances(model.zeros) - 54)) < 1
    assert np.min(np.abs(resonances(model.poles) - 76)) < 1
    assert np.all(model.std_den[1:] > 0)
    assert np.all(np.isfinite(model.cov))


def test_a_response_measured_elsewhere_is_fitted_with_its_variance_as_known():
    rng = np.random.default_rng(SEED)
    sigma = 1e-3 * np.abs(TRUTH.response(F))
    g = TRUTH.response(F) + sigma * (
        rng.standard_normal(len(F)) + 1j * rng.standard_normal(len(F))
    ) / np.sqrt(2)
    model = fit(Frf.from_arrays(F, g, sigma**2, fs_hz=3000.0), "2/1")
    assert abs(model.delay_s - TRUTH.delay_s) < 4 * model.std_delay_s
    assert model.cost_expected == pytest.approx(len(F) - 5 / 2)
    with pytest.raises(ValueError, match="variance"):
        fit(Frf.from_arrays(F, g), "2/1")
    with pytest.raises(ValueError, match="shapes"):
        Frf.from_arrays(F, g[:-1])
    frame = Frf.from_arrays(F, g, sigma**2).to_pandas()
    np.testing.assert_allclose(Frf.from_pandas(frame).var_g, sigma**2)


def test_a_start_behind_a_hold_is_not_lost_to_a_fast_pole():
    """A pole of 2.5 / T: the first round left out what the hold folds back, and lost the very truth."""
    fs_hz, pole = 4000.0, 10000.0
    truth = RationalModel([pole], [1, pole], delay_s=0.0, fs_hz=fs_hz, hold="zoh")
    f_hz = np.arange(10.0, 1000.0, 4.0)
    rng = np.random.default_rng(6)
    noise = 1e-3 * (rng.standard_normal(len(f_hz)) + 1j * rng.standard_normal(len(f_hz)))
    response = Frf.from_arrays(f_hz, truth.response(f_hz) + noise, np.full(len(f_hz), 2e-6), fs_hz=fs_hz)
    near = fit(response, "1/0", hold="zoh", delay=0)
    found = fit(response, "1/0", hold="zoh", start=near)
    assert found.cost <= near.cost * (1 + 1e-6)
    assert abs(found.delay_s) < 4 * found.std_delay_s


@pytest.mark.parametrize("poles_per_sample", [2.0, 2.5, 4.0, 6.0])
@pytest.mark.parametrize("order", ["1/0", "3/2"])
def test_bug_a_held_lag_faster_than_a_sample_was_taken_for_a_delay(order, poles_per_sample):
    """From 2.5 / T on the default fit ended in a minimum of up to 2500 times the cost, and had converged."""
    fs_hz = 4000.0
    num, den = [poles_per_sample * fs_hz], [1, poles_per_sample * fs_hz]
    if order == "3/2":
        wa, wr = 2 * np.pi * 300, 2 * np.pi * 500
        num, den = np.polymul(num, [1, 0.06 * wa, wa**2]), np.polymul(den, [1, 0.04 * wr, wr**2])
    f_hz = np.arange(10.0, 1000.0, 4.0)
    for i, samples in enumerate((0, 0.3, 0.5, 1, 1.4, 2.7)):
        truth = RationalModel(num, den, delay_s=samples / fs_hz, fs_hz=fs_hz, hold="zoh")
        g, rng = truth.response(f_hz), np.random.default_rng(i)
        sigma = 1e-3 * np.abs(g).max()
        errors = sigma * (rng.standard_normal(len(g)) + 1j * rng.standard_normal(len(g)))
        response = Frf.from_arrays(f_hz, g + errors, np.full(len(g), 2 * sigma**2), fs_hz=fs_hz)
        found = fit(response, order, hold="zoh")
        assert found.cost <= 1.001 * fit(response, order, hold="zoh", start=truth).cost, samples


def relative_noise(truth, f_hz, rng, share=1e-3):
    """A response whose errors have the same share of |g| at every line."""
    g = truth.response(f_hz)
    errors = share * np.abs(g) * (rng.standard_normal(len(g)) + 1j * rng.standard_normal(len(g))) / np.sqrt(2)
    return Frf.from_arrays(f_hz, g + errors, (share * np.abs(g)) ** 2, fs_hz=3000.0)


@pytest.mark.parametrize("hold", ["none", "zoh"])
@pytest.mark.parametrize("step_hz", [0.5, 1.0, 4.0])
def test_bug_a_damped_axis_was_fitted_with_poles_that_stand_in_for_the_delay(hold, step_hz):
    """The default fit ended at up to a thousand times the least cost, and had converged."""
    f_hz = np.arange(4.0, 600.1, step_hz)
    for seed, delay_s in enumerate((0.0, 0.7e-3, 2e-3, 3.33e-3, 5.17e-3, 9.9e-3)):
        truth = RationalModel([200, 9000], [1, 40, 900], delay_s, hold=hold, fs_hz=3000.0)
        response = relative_noise(truth, f_hz, np.random.default_rng(seed))
        found = fit(response, "2/1", hold=hold)
        assert found.cost <= 1.001 * fit(response, "2/1", hold=hold, start=truth).cost, delay_s
