"""The adequacy test: its false-alarm rate, its power, and whether it says where."""

import copy
import dataclasses

import numpy as np
import pytest
from plants import FS_HZ, axis_period, plant
from scipy import stats

from gsid.base.errors import InputError
from gsid.comparison import compare
from gsid.excitation.multisine import Multisine
from gsid.fitting.rational import fit
from gsid.greybox.fit import fit_plant
from gsid.models.piecewise import PiecewiseModel
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.response.estimate import frf
from gsid.spectrum.lines import lines_of
from gsid.spectrum.spectra import Spectra

SEED = 20260303
MODEL = RationalModel([900.0], [1.0, 30.0, 900.0], 0.003)
N, FS = 600, 300.0


def measured(rng, *, periods, truth=MODEL, extra=None, noise=0.01, odd_only=False, u_noise=0.0):
    """Multisine over lines 1..60 (all or odd), white output noise; `extra` is added to the output."""
    line = np.arange(N // 2 + 1)
    excited = (line >= 1) & (line <= 60) & ((line % 2 == 1) | (not odd_only))
    f = line * FS / N

    def normal():
        return (
            rng.standard_normal((periods, len(line))) + 1j * rng.standard_normal((periods, len(line)))
        ) / np.sqrt(2)

    U0 = np.where(excited, np.exp(1j * np.pi * line**2 / 60), 0)
    Y0 = np.zeros(len(line), complex)
    Y0[1:-1] = truth.response(f[1:-1]) * U0[1:-1]
    if extra is not None:
        Y0 = Y0 + extra
    return Spectra(
        fs_hz=FS,
        period_samples=N,
        line=line,
        U=U0 + u_noise * normal(),
        Y=Y0 + noise * normal(),
        n_spoiled=0,
        settle_samples=0,
        excited=excited,
        y_unit="deg/s",
        name="simulated",
    )


@pytest.mark.parametrize("periods", [2, 3, 4, 8])
@pytest.mark.parametrize("u_noise", [0.0, 0.02])
def test_false_alarm_rate_is_kept_with_few_periods(periods, u_noise):
    """5 % of 1000 right models are rejected (binomial 99.9 % range); bands, taken together, too."""
    print("seed", SEED, periods)
    rng = np.random.default_rng([SEED, periods])
    results = [compare(MODEL, measured(rng, periods=periods, u_noise=u_noise)) for _ in range(1000)]
    lo, hi = stats.binom.interval(0.999, 1000, 0.05)
    assert lo <= sum(not r.adequate for r in results) <= hi
    assert sum(bool(r.where) for r in results) <= hi
    assert stats.kstest([r.p_value for r in results], "uniform").pvalue > 1e-3


def test_cost_per_dof_is_one_for_a_right_model():
    rng = np.random.default_rng(SEED)
    for periods in (2, 4, 10):
        costs = [compare(MODEL, measured(rng, periods=periods)).cost_per_dof for _ in range(200)]
        assert np.median(costs) == pytest.approx(1, abs=0.12), periods  # T has heavy tails with 4 periods


HELD = RationalModel(MODEL.num, MODEL.den, MODEL.delay_s, fs_hz=FS, hold="zoh")


def test_a_held_model_is_compared_at_the_rate_of_the_record():
    """Bug: it answered at the rate that it was fitted at, a shift of half the difference of the samples."""
    rng = np.random.default_rng(SEED)
    record = dataclasses.replace(measured(rng, periods=6, truth=HELD, noise=1e-3), hold="zoh")
    fitted_elsewhere = dataclasses.replace(HELD, fs_hz=4 * FS)
    assert compare(fitted_elsewhere, record).p_value == compare(HELD, record).p_value
    assert compare(fitted_elsewhere, record).p_value > 1e-4  # 0 with the hold of the rate fitted at
    pieces = tuple(dataclasses.replace(fitted_elsewhere, band_hz=band) for band in ((0, 10), (10, 40)))
    assert compare(PiecewiseModel(pieces, (10.0,)), record).p_value == compare(HELD, record).p_value


def test_a_model_in_z_is_not_compared_at_another_rate():
    """Bug: it was evaluated with its own rate, so that its poles stood elsewhere."""
    model = RationalModel([0.1], [1, -0.9], domain="z", fs_hz=2 * FS)
    with pytest.raises(InputError, match=r"300 and 600 Hz") as refused:
        compare(model, measured(np.random.default_rng(SEED), periods=3))
    assert "--domain s" in refused.value.hint


@pytest.mark.parametrize(
    ("model", "hold", "words"),
    [
        (HELD, "none", "simulated does not state a hold"),
        (MODEL, "zoh", "the model has no hold"),
        (HELD, "zoh", None),
        (MODEL, "none", None),
        (RationalModel([0.1], [1, -0.9], domain="z", fs_hz=FS), "zoh", None),
        (RationalModel([0.1], [1, -0.9], domain="z", fs_hz=FS), "none", None),
    ],
)
def test_half_a_sample_between_model_and_record_is_reported(caplog, model, hold, words):
    """Bug: a model of a held input was compared with one that was not, or the reverse, in silence."""
    record = dataclasses.replace(measured(np.random.default_rng(SEED), periods=3), hold=hold)
    compare(model, record)
    said = [one.getMessage() for one in caplog.records]
    assert len(said) == (words is not None)
    assert words is None or words in said[0]


def test_a_p_value_that_underflows_is_not_a_bare_zero():
    far = dataclasses.replace(MODEL, num=[1800.0])
    found = compare(far, measured(np.random.default_rng(SEED), periods=40, noise=1e-4))
    assert (found.p_value, found.where[0]["p_value"]) == (0, 0)
    assert -1e5 < found.log10_p_value < found.where[0]["log10_p_value"] < -330
    assert found.to_dict()["log10_p_value"] == found.log10_p_value


def test_a_wrong_delay_is_rejected_where_it_matters():
    truth = RationalModel(MODEL.num, MODEL.den, MODEL.delay_s + 0.002)
    result = compare(MODEL, measured(np.random.default_rng(SEED), periods=6, truth=truth, noise=1e-3))
    assert not result.adequate
    assert result.cost_per_dof > 10
    assert result.where[0]["lines"] == "excited"
    assert sum(band["share"] for band in result.where) > 0.9
    assert result.rms_error > 3 * result.noise_floor_rms
    assert "Not adequate" in repr(result)
    assert "<table>" in result._repr_html_()


def test_distortion_on_detection_lines_is_named_by_its_kind():
    extra = np.zeros(N // 2 + 1, complex)
    extra[[10, 12, 14]] = 0.3
    result = compare(MODEL, measured(np.random.default_rng(SEED), periods=6, extra=extra, odd_only=True))
    assert not result.adequate
    assert {band["lines"] for band in result.where} == {"even"}
    band = result.where[0]
    assert band["f_lo_hz"] <= 5.0
    assert band["f_hi_hz"] >= 7.0
    assert band["share"] > 0.9
    f, even = result.f_hz, result.kind == "even"
    nearby = (f >= band["f_lo_hz"]) & (f <= band["f_hi_hz"])
    power = np.sum(np.abs(result.error[nearby & even]) ** 2) / np.sum(np.abs(result.y[nearby]) ** 2)
    assert band["db"] == pytest.approx(10 * np.log10(power), abs=1e-9)  # of the response of all its lines
    kinds = dict(zip(result.line.tolist(), result.kind.tolist(), strict=True))
    assert kinds[10] == "even"
    assert kinds[11] == "excited"


def test_the_verdict_names_the_band_of_the_largest_share():
    extra = np.zeros(N // 2 + 1, complex)
    extra[[10, 20]], extra[31] = 0.03, 0.3
    result = compare(MODEL, measured(np.random.default_rng(SEED), periods=6, extra=extra, odd_only=True))
    shares = [band["share"] for band in result.where]
    assert len(shares) == 3
    assert shares == sorted(shares, reverse=True)
    assert f"{100 * shares[0]:.0f} % of the excess lies at 14.5 to 17.5 Hz on excited lines" in result.verdict


def test_band_and_several_records():
    rng = np.random.default_rng(SEED)
    records = [measured(rng, periods=4) for _ in range(3)]
    result = compare(MODEL, records, band=(5, 20))
    assert result.n_records == 3
    assert result.n_periods == 12
    assert result.f_hz[0] >= 5
    assert result.f_hz[-1] <= 20
    keys = {"adequate", "p_value", "cost_per_dof", "rms_error", "noise_floor_rms", "where"}
    assert keys <= set(result.to_dict())


def test_rms_error_is_that_of_the_time_signal():
    """Parseval: rms of the mean output's error, computed here from its samples."""
    extra = np.zeros(N // 2 + 1, complex)
    extra[[3, 20]] = [0.5, 0.2j]
    result = compare(MODEL, measured(np.random.default_rng(SEED), periods=4, extra=extra, noise=1e-6))
    n = np.arange(N)
    signal = 0.5 * np.cos(2 * np.pi * 3 * n / N) + (0.2j * np.exp(2j * np.pi * 20 * n / N)).real
    assert result.rms_error == pytest.approx(np.sqrt(np.mean(signal**2)), rel=1e-4)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [({"alpha": 0}, "alpha"), ({"alpha": 1.5}, "alpha"), ({"band": (1000, 2000)}, "no line")],
)
def test_misuse_is_a_value_error(arguments, what):
    with pytest.raises(ValueError, match=what):
        compare(MODEL, measured(np.random.default_rng(SEED), periods=3), **arguments)
    with pytest.raises(ValueError, match="no record"):
        compare(MODEL, [])


@pytest.mark.parametrize("kind", ["s", "z", "zoh", "pieces"])
def test_a_fitted_model_is_allowed_its_covariance_on_new_records(kind):
    """A bug: the noise of the fit was left out, and most right models of 4 periods rejected by 40."""
    print("seed", SEED, kind)
    rng, n = np.random.default_rng([SEED, len(kind)]), 60
    p_values, as_known, costs = [], [], []
    truth, hold = MODEL, "zoh" if kind == "zoh" else "none"
    if kind == "z":
        truth = RationalModel([0.1, 0.05], [1, -1.6, 0.7], domain="z", fs_hz=FS)
    elif kind == "zoh":
        truth = HELD
    for _ in range(n):
        ours, new = (dataclasses.replace(measured(rng, periods=p, truth=truth), hold=hold) for p in (4, 40))
        options = {"domain": "z", "delay": "none"} if kind == "z" else {}
        if kind == "pieces":
            bands = (0.0, 12.0), (12.0, 40.0)
            model = PiecewiseModel(tuple(fit(frf(ours), "2/0", band=band) for band in bands), (12.0,))
            bare = PiecewiseModel(tuple(dataclasses.replace(m, cov=None) for m in model.pieces), (12.0,))
        else:
            model = fit(frf(ours), "2/1" if kind == "z" else "2/0", **options)
            bare = dataclasses.replace(model, cov=None)
        result = compare(model, new)
        assert result.model_uncertainty == "included"
        p_values.append(result.p_value)
        costs.append(result.cost_per_dof)
        as_known.append(compare(bare, new).p_value)
    assert np.sum(np.array(p_values) < 0.05) <= stats.binom.interval(0.999, n, 0.05)[1]
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    assert np.mean(costs) == pytest.approx(1, abs=0.07)  # of 60 lines with a scatter of 0.13
    assert np.mean(np.array(as_known) < 0.05) > 0.5


def test_what_the_model_is_allowed_is_reported():
    """The rms that its covariance adds is what its error has beyond the noise of the record."""
    rng = np.random.default_rng(SEED)
    ours, new = measured(rng, periods=4), measured(rng, periods=40)
    model = fit(frf(ours), "2/0")
    included = compare(model, new)
    bare = compare(dataclasses.replace(model, cov=None), new)
    of_fit = compare(model, ours, fitted=True)
    assert [r.model_uncertainty for r in (included, bare, of_fit)] == ["included", "none", "fitted"]
    assert included.to_dict()["model_uncertainty"] == "included"
    assert included.model_uncertainty_rms > 0 == bare.model_uncertainty_rms == of_fit.model_uncertainty_rms
    assert included.noise_floor_rms == bare.noise_floor_rms
    assert "the model's uncertainty" in included.verdict
    assert ["no covariance" in r.verdict for r in (included, bare, of_fit)] == [False, True, False]
    expected = np.hypot(included.noise_floor_rms, included.model_uncertainty_rms)
    rms = [
        compare(fit(frf(measured(rng, periods=4)), "2/0"), measured(rng, periods=40)).rms_error
        for _ in range(30)
    ]
    assert np.sqrt(np.mean(np.square(rms))) == pytest.approx(expected, rel=0.15)
    np.testing.assert_allclose(included.sigma**2 - included.sigma_model**2, bare.sigma**2, rtol=1e-9)


def test_bands_do_not_fail_within_the_covariance():
    """A gain off by two standard deviations fails nowhere, one off by twenty at every line that shows it."""
    rng = np.random.default_rng(SEED)
    cov = np.zeros((3, 3))
    cov[2, 2] = 9.0**2
    new = measured(rng, periods=40)
    for off, adequate in ((18.0, True), (180.0, False)):
        model = RationalModel([900.0 + off], MODEL.den, MODEL.delay_s, cov=cov)
        result = compare(model, new)
        assert result.adequate == adequate
        assert bool(result.where) == (not adequate)
        assert not compare(dataclasses.replace(model, cov=None), new).adequate


# ---- plants ---------------------------------------------------------------------------------------------

STACK = {
    "rigid_body": {"gain": 7.4},
    "viscous_friction": {"rate": 11.0},
    "cable_spring": {"stiffness": 170.0},
    "transport_delay": {"delay_s": 0.0054},
}
AXIS = {"gain": 7.4, "viscous_rate": 11.0, "spring_stiffness": 170.0, "delay_s": 0.0054}
BAND = (2.0, 60.0)
N_AXIS = 1500


@pytest.fixture(scope="module")
def command():
    return Multisine.design(FS_HZ, N_AXIS, BAND, grid="odd", phases="random", seed=3, amplitude=3.0).table()


def noisy(rng, u, y, periods, noise=0.02):
    """Spectra of whole periods of the axis's answer with white noise."""
    y = np.tile(y, (periods, 1)) + noise * rng.standard_normal((periods, len(y)))
    U, Y = lines_of(np.tile(u, (periods, 1))), lines_of(y)
    line = np.arange(Y.shape[1])
    return Spectra(FS_HZ, len(u), line, U, Y, 0, 0, np.abs(U[0]) > 0.1, hold="zoh", y_unit="deg/s")


@pytest.mark.parametrize("band", [None, (0.0, 60.0)])
def test_false_alarm_rate_with_a_plant(command, band):
    """5 % of 300 right plants are rejected (binomial 99.9 % range), with the line at 0 as without."""
    rng, model, y = np.random.default_rng(SEED), plant(STACK), axis_period(command, **AXIS)
    results = [compare(model, noisy(rng, command, y, 3), band=band) for _ in range(300)]
    lo, hi = stats.binom.interval(0.999, 300, 0.05)
    assert lo <= sum(not r.adequate for r in results) <= hi
    assert stats.kstest([r.p_value for r in results], "uniform").pvalue > 1e-3
    assert np.mean([r.rms_error / r.noise_floor_rms for r in results]) == pytest.approx(1, abs=0.05)
    assert (results[0].line[0] == 0) == (band is not None)


def test_false_alarm_rate_on_the_record_of_the_fit():
    """A bug: four parameters fitted to 15 lines left 1 % of the right plants to be rejected at 5 %."""
    band = (2.0, 30.0)
    u = Multisine.design(FS_HZ, N_AXIS, band, grid="odd", phases="random", seed=3, amplitude=3.0).table()
    rng, y = np.random.default_rng(SEED), axis_period(u, **AXIS)
    results = []
    for _ in range(300):
        one = noisy(rng, u, y, 8)
        results.append(compare(fit_plant(plant(STACK), one).model, one, fitted=True))
    lo, hi = stats.binom.interval(0.999, 300, 0.05)
    assert lo <= sum(not r.adequate for r in results) <= hi
    assert stats.kstest([r.p_value for r in results], "uniform").pvalue > 1e-3
    assert np.mean([r.cost_per_dof for r in results]) == pytest.approx(1, abs=0.1)  # scatters by 0.02


def test_fitted_parameters_take_degrees_of_freedom():
    """The p-value: chi-square of twice the lines less 3/4 of each parameter, of one record and of two."""
    rng = np.random.default_rng(SEED)
    ours = [measured(rng, periods=4, u_noise=0.02) for _ in range(2)]
    rational = fit(frf(ours[0]), "2/0")
    inside = (ours[0].line >= 1) & (ours[0].line <= 60)
    errors = [one.Y[:, inside] - rational.response(one.f_hz[inside]) * one.U[:, inside] for one in ours]
    for several in (errors[:1], errors):
        t = [4 * np.abs(e.mean(0)) ** 2 / e.var(0, ddof=1) for e in several]
        chi2 = 2 * np.sum(3 * np.log1p(np.array(t) / 3))
        n_dof = 2 * 60 * len(several) - 0.75 * 4  # gain, two coefficients of the denominator, delay
        found = compare(rational, ours[: len(several)], fitted=True)
        assert found.p_value == pytest.approx(stats.chi2.sf(chi2, n_dof), rel=1e-6)


def test_a_fitted_plant_is_allowed_its_covariance_on_new_records(command):
    """A bug: the noise of the fit was left out, and 83 % of right plants of 4 periods rejected by 40."""
    print("seed", SEED)
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    results, as_known = [], []
    for _ in range(60):
        model = fit_plant(plant(STACK), noisy(rng, command, y, 4)).model
        new = noisy(rng, command, y, 40)
        results.append(compare(model, new))
        model.cov = None
        as_known.append(compare(model, new).adequate)
    assert np.sum([not r.adequate for r in results]) <= stats.binom.interval(0.999, 60, 0.05)[1]
    assert stats.kstest([r.p_value for r in results], "uniform").pvalue > 1e-3
    assert np.mean([r.cost_per_dof for r in results]) == pytest.approx(1, abs=0.07)
    assert np.mean(as_known) < 0.5


def test_a_wrong_plant_is_rejected_beside_its_uncertainty(command):
    rng = np.random.default_rng(SEED)
    y = axis_period(command, coulomb_level=1.0, **AXIS)
    model = fit_plant(plant(STACK), noisy(rng, command, y, 4)).model
    result = compare(model, noisy(rng, command, y, 40))
    assert result.model_uncertainty == "included"
    assert not result.adequate
    assert result.where


def test_a_covariance_of_other_parameters_is_not_used(command):
    """A parameter fixed after the fit leaves a covariance of another shape."""
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    model = fit_plant(plant(STACK), noisy(rng, command, y, 4)).model
    model["rigid_body.gain"].free = False
    assert compare(model, noisy(rng, command, y, 4)).model_uncertainty == "none"


def test_a_covariance_of_as_many_other_parameters_is_not_used(command):
    """One fixed and another made free after the fit leave its shape."""
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    record = noisy(rng, command, y, 4)
    model = fit_plant(plant(STACK), record, fixed=["rigid_body.gain"]).model
    assert compare(model, record).model_uncertainty == "included"
    model["rigid_body.gain"].free, model["cable_spring.stiffness"].free = True, False
    assert model.cov.shape == (len(model.free_names),) * 2
    assert compare(model, record).model_uncertainty == "none"


def test_a_covariance_of_an_older_fit_is_not_used(command, tmp_path):
    """A parameter was fixed, the model refitted, and the parameter freed again in place of another one.

    The matrix has the right shape and every free parameter a standard deviation, but one is of the first fit.
    """
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    record = noisy(rng, command, y, 4)
    first = fit_plant(plant(STACK), record).model
    model = fit_plant(first, record, fixed=["rigid_body.gain"]).model
    assert compare(model, record).model_uncertainty == "included"
    model["rigid_body.gain"].free, model["cable_spring.stiffness"].free = True, False
    assert model.cov.shape == (len(model.free_names),) * 2
    assert all(model[name].std is not None for name in model.free_names)
    assert compare(model, record).model_uncertainty == "none"
    model.save(tmp_path / "m.json")
    assert compare(PlantModel.load(tmp_path / "m.json"), record).model_uncertainty == "none"
    model["rigid_body.gain"].free, model["cable_spring.stiffness"].free = False, True
    assert compare(model, record).model_uncertainty == "included"


def test_what_the_fit_left_open_may_have_any_value(command, caplog):
    """An undetermined parameter (NaN) and one of each record alone say nothing of a new record."""
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    new = noisy(rng, command, y, 40)
    model = fit_plant(plant(STACK), noisy(rng, command, y, 4)).model
    model["cable_spring.stiffness"].value *= 1.01
    assert not compare(model, new).adequate
    undetermined, of_each = copy.deepcopy(model), copy.deepcopy(model)
    undetermined["cable_spring.stiffness"].std = float("nan")
    of_each.fit["per_record"] = [{"name": "", "cable_spring.stiffness": [170.0, 1.0]}]
    by = model.predict(new, sensitivities=True).dY[model.free_names.index("cable_spring.stiffness")]
    for one in (undetermined, of_each):
        caplog.clear()
        found = compare(one, new)
        assert found.p_value > 1e-3
        assert "does not determine cable_spring.stiffness for other records" in caplog.text
        # Of its own size, at the lowest lines, where the other parameters' errors are small beside that.
        low = found.line[:3]
        expected = np.abs(by[low]) * model["cable_spring.stiffness"].value
        np.testing.assert_allclose(found.sigma_model[:3], expected, rtol=0.01)


def test_friction_is_detected_in_a_plant_without_it(command):
    rng = np.random.default_rng(SEED)
    y = axis_period(command, coulomb_level=2.0, **AXIS)
    result = compare(plant(STACK), noisy(rng, command, y, 6))
    assert not result.adequate
    # An odd law and odd lines: nothing falls on the even ones.
    assert {band["lines"] for band in result.where} == {"excited"}
    with_it = plant(STACK | {"coulomb_friction": {"level": 2.0}})
    assert compare(with_it, noisy(rng, command, y, 6)).adequate


def test_line_0_counts_only_where_the_plant_determines_the_mean(command):
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    away = noisy(rng, command, y + 0.1, 6)
    found, without = (compare(plant(STACK), away, band=(lowest, 60.0)) for lowest in (0.0, 1.0))
    assert [(band["f_lo_hz"], band["lines"]) for band in found.where] == [(0.0, "even")]
    assert without.adequate
    # The mean of a constant's square is the square, not half of it.
    assert found.rms_error**2 - without.rms_error**2 == pytest.approx(0.1**2, rel=0.02)
    nowhere = plant({"rigid_body": {"gain": 7.4}, "viscous_friction": {"rate": 11.0}}, output="angle")
    assert compare(nowhere, dataclasses.replace(away, y_unit="deg"), band=(0.0, 60.0)).line[0] == 1


def test_the_line_at_0_is_real(command):
    """One number, not two: T of that line follows F(1, P - 1), that of the next F(2, 2 (P - 1))."""
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    seen = noisy(rng, command, y, 5)
    found = compare(plant(STACK), seen, band=(0.0, 3.0))
    assert found.line.tolist() == [0, 1]
    t = 5 * np.abs(seen.y[:2] - plant(STACK).predict(seen).Y[:2]) ** 2 / seen.noise_y[:2]
    tails = stats.f.sf(t[0], 1, 4), stats.f.sf(t[1], 2, 8)
    assert found.p_value == pytest.approx(stats.chi2.sf(-2 * np.sum(np.log(tails)), 4), rel=1e-6)


def test_a_band_of_the_line_at_0_alone(command):
    """A bug: scipy's filter of no line at all ended in an internal error."""
    rng, y = np.random.default_rng(SEED), axis_period(command, **AXIS)
    right, off = (compare(plant(STACK), noisy(rng, command, y + by, 5), band=(0.0, 1.0)) for by in (0.0, 0.1))
    assert right.line.tolist() == [0]
    assert right.adequate
    assert [(band["f_lo_hz"], band["f_hi_hz"]) for band in off.where] == [(0.0, 0.0)]


@pytest.mark.parametrize(("share", "told"), [(0.09, False), (0.11, True)])
def test_a_response_that_is_not_steady_is_reported(command, monkeypatch, caplog, share, told):
    """A bug: a plant without steady state was judged like any other. A tenth of the noise may move."""
    caplog.set_level("WARNING", "gsid")
    seen = noisy(np.random.default_rng(SEED), command, axis_period(command, **AXIS), 40)
    noise_rms = compare(plant(STACK), seen).noise_floor_rms
    predict = PlantModel.predict

    def moving(self, spectra, **options):
        return dataclasses.replace(
            predict(self, spectra, **options), residual=share * noise_rms, settled=False
        )

    monkeypatch.setattr(PlantModel, "predict", moving)
    compare(plant(STACK), seen)
    assert ("no steady state" in caplog.text) == told
