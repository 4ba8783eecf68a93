"""Grey-box fits of records that the simulated axis made, which shares no code with the plants."""

import copy
import re
from dataclasses import fields

import numpy as np
import pytest
from plants import FS_HZ, axis_record, plant
from scipy import ndimage, stats
from scipy.signal import lfilter
from squares import search

from gsid.base.errors import GsidError, InputError
from gsid.comparison import compare
from gsid.excitation.multisine import Multisine
from gsid.greybox.fit import fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.greybox.settings import GreyboxSettings
from gsid.greybox.weights import lines_used, pooled_variance
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant
from gsid.records.record import Record
from gsid.spectrum.pooling import DOF_WANTED, averaged, smoothed
from gsid.spectrum.realisation import spectra

N, P = 1500, 4
AXIS = {"gain": 900.0, "viscous_rate": 12.0, "spring_stiffness": 400.0, "delay_s": 0.00437}
TRUTH = {
    "rigid_body.gain": 900.0,
    "viscous_friction.rate": 12.0,
    "cable_spring.stiffness": 400.0,
    "transport_delay.delay_s": 0.00437,
}
LEVEL = "coulomb_friction.level"
RESIDUE = "flexible_mode.residue"


def multisine(seed, n=N, amplitude=0.05, band=(2, 250), grid="full"):
    return Multisine.design(
        FS_HZ, n, band, grid=grid, amplitude=amplitude, phases="random", seed=seed
    ).table()


def start(truth, off=1.05):
    """A plant whose values are 5 % off, up and down in turn."""
    stack = {}
    for i, (name, value) in enumerate(truth.items()):
        effect, parameter = name.split(".")
        stack.setdefault(effect, {})[parameter] = value * off ** (-1) ** i
    return plant(stack)


def records(n_records=3, noise=0.1, friction=0.0, n_periods=P, amplitude=0.05):
    return [
        axis_record(
            multisine(i, amplitude=amplitude),
            n_periods,
            noise,
            100 + i,
            f"r{i}",
            **AXIS,
            coulomb_level=friction,
        )
        for i in range(n_records)
    ]


def deviations(fit, truth):
    return {name: (fit.model[name].value - value) / fit.model[name].std for name, value in truth.items()}


@pytest.fixture(scope="module")
def with_friction():
    return records(friction=6.0)


FRICTION_TRUTH = TRUTH | {LEVEL: 6.0}


# ---- known plants ----------------------------------------------------------------------------------------


def test_linear_axis():
    fit = fit_plant(start(TRUTH), records())
    assert fit.converged
    assert all(abs(z) < 3 for z in deviations(fit, TRUTH).values()), deviations(fit, TRUTH)
    # r'r scatters as chi-square; that its weights scatter too adds a little.
    assert fit.cost_per_dof == pytest.approx(1, abs=4 * np.sqrt(2 / fit.n_dof))
    assert fit.n_dof == 2 * 3 * len(fit.records[0].line) - 4
    assert (fit.undetermined, fit.at_bound, fit.unsettled) == ([], [], [])


def test_coulomb_friction(with_friction):
    fit = fit_plant(start(FRICTION_TRUTH), with_friction)
    assert fit.converged
    assert all(abs(z) < 3 for z in deviations(fit, FRICTION_TRUTH).values()), deviations(fit, FRICTION_TRUTH)
    assert fit.cost_per_dof == pytest.approx(1, abs=4 * np.sqrt(2 / fit.n_dof))
    without = fit_plant(start(TRUTH), with_friction)
    assert without.cost_per_dof > 10


def test_without_noise_the_truth_comes_back():
    fit = fit_plant(start(FRICTION_TRUTH), records(2, noise=0.0, friction=6.0))
    for name, value in FRICTION_TRUTH.items():
        assert fit.model[name].value == pytest.approx(value, rel=1e-7)
    assert fit.converged


def test_lines_that_are_not_excited_count(with_friction):
    fit = fit_plant(start(FRICTION_TRUTH), with_friction)
    assert np.all(np.diff(fit.records[0].line) == 1)
    odd = [axis_record(multisine(1, grid="odd"), P, 0.1, 1, **AXIS)]
    (record,) = fit_plant(start(TRUTH), odd).records
    assert np.all(np.diff(record.line) == 1)


def test_the_fit_leaves_the_cost_that_it_reports(with_friction):
    fit = fit_plant(start(FRICTION_TRUTH), with_friction)
    assert fit.cost == pytest.approx(sum(r.residual @ r.residual for r in fit.records), rel=1e-12)
    jacobian = np.vstack([r.jacobian for r in fit.records])
    factor = (fit.variance_dof - 1) / (fit.variance_dof - 2)
    np.testing.assert_allclose(fit.model.cov, factor * np.linalg.inv(jacobian.T @ jacobian), rtol=1e-6)
    # At the minimum nothing is left along the parameters, but for a cost of 0.01.
    left = np.linalg.lstsq(jacobian, np.concatenate([r.residual for r in fit.records]), rcond=None)[0]
    assert np.sum((jacobian @ left) ** 2) < 0.01
    assert fit.model.fit["cost_per_dof"] == fit.cost_per_dof


def test_a_fit_carries_its_records(with_friction):
    """Callers paired the records of a fit with a list of spectra, which could be another one."""
    measured = [spectra(record) for record in with_friction]
    fit = fit_plant(start(TRUTH), measured, band=(0, 250))
    assert all(record.spectra is one for record, one in zip(fit.records, measured, strict=True))
    assert fit.cost_of(fit.model) == pytest.approx(fit.cost, rel=1e-9)
    opened = [copy.copy(one) for one in measured]
    for one in opened:
        one.hold = None
    fit = fit_plant(start(TRUTH), opened)
    assert {record.spectra.hold for record in fit.records} == {fit.hold}


def test_the_whitened_output_is_stacked_like_residual_and_jacobian(with_friction):
    """Line 0 is among the lines: it has no imaginary part."""
    fit = fit_plant(start(FRICTION_TRUTH), with_friction, band=(0, 250))
    records, m = fit.records, sum(len(record.line) for record in fit.records)
    errors = [record.spectra.y - record.prediction.Y for record in records]
    np.testing.assert_allclose(fit.whitened([e[None] for e in errors])[:, 0], fit.residual, atol=1e-12)
    np.testing.assert_allclose(fit.whitened([r.prediction.dY for r in records]), fit.jacobian, atol=1e-12)
    assert fit.residual.shape == (2 * m,)
    assert fit.jacobian.shape == (2 * m, len(FRICTION_TRUTH))
    assert np.array_equal(np.flatnonzero(np.concatenate([r.line for r in records]) == 0) + m, [
        i for i in range(m, 2 * m) if not np.any(fit.jacobian[i])
    ])  # fmt: skip


def test_the_p_value_of_a_fit_is_that_of_its_comparison(with_friction):
    """One test, CMP-1: a fit in the default band and `compare` with `fitted=True` agree."""
    for truth in (TRUTH, FRICTION_TRUTH):
        fit = fit_plant(start(truth), with_friction)
        compared = compare(fit.model, with_friction, fitted=True)
        assert fit.noise_p_value == pytest.approx(compared.p_value, rel=1e-9)
    assert fit.noise_p_value > 1e-3


def test_the_fitted_model_comes_back_from_its_file(with_friction, tmp_path):
    fit = fit_plant(start(FRICTION_TRUTH), with_friction, per_record=["drift"])
    fit.model.save(tmp_path / "m.json")
    assert PlantModel.load(tmp_path / "m.json").to_dict() == fit.model.to_dict()
    assert "converged" in repr(fit)


def test_a_fit_keeps_to_the_limits_of_its_file(with_friction, tmp_path):
    """They were not saved: the fit of a model file went where its user had said it must not."""
    model = start(FRICTION_TRUTH)
    level = FRICTION_TRUTH[LEVEL]
    model[LEVEL].value = 0.7 * level
    model[LEVEL].limits = (0.5 * level, 0.8 * level)
    model.save(tmp_path / "m.json")
    fit = fit_plant(PlantModel.load(tmp_path / "m.json"), with_friction)
    assert fit.model[LEVEL].value == pytest.approx(0.8 * level)


def test_nlopt_finds_the_same(with_friction):
    lm = fit_plant(start(FRICTION_TRUTH), with_friction)
    nlopt = fit_plant(start(FRICTION_TRUTH), with_friction, solver="nlopt", max_iter=200)
    assert nlopt.cost == pytest.approx(lm.cost, abs=0.05)
    for name in FRICTION_TRUTH:
        assert abs(nlopt.model[name].value - lm.model[name].value) < 0.2 * lm.model[name].std


# ---- records that differ ---------------------------------------------------------------------------------


def test_each_record_may_have_a_friction_of_its_own():
    levels = [4.0, 6.0, 9.0]
    several = [
        axis_record(multisine(i), P, 0.1, i, **AXIS, coulomb_level=level) for i, level in enumerate(levels)
    ]
    fit = fit_plant(start(FRICTION_TRUTH), several, per_record=[LEVEL])
    assert fit.converged
    for record, level in zip(fit.records, levels, strict=True):
        assert abs(record.params[LEVEL].value - level) < 3 * record.params[LEVEL].std
    assert fit.model[LEVEL].value == pytest.approx(np.mean([r.params[LEVEL].value for r in fit.records]))
    assert all(abs(z) < 3 for z in deviations(fit, TRUTH).values())


def test_a_drift_is_taken_out():
    """By what the periods gain; the ramp of a fit then finds what is left: nothing."""
    drifting, slopes = records(2), (3.0, -1.0)
    undisturbed = fit_plant(start(TRUTH), drifting)
    for record, slope in zip(drifting, slopes, strict=True):
        record.y = record.y + slope * np.arange(len(record.y)) / N
    fit = fit_plant(start(TRUTH), drifting)
    rate = "viscous_friction.rate"
    assert fit.model[rate].std == pytest.approx(undisturbed.model[rate].std, rel=0.1)
    assert fit.cost_per_dof == pytest.approx(1, abs=4 * np.sqrt(2 / fit.n_dof))
    with_ramp = fit_plant(start(TRUTH), drifting, per_record=["drift"])
    for record, slope in zip(with_ramp.records, slopes, strict=True):
        drift = record.params["drift"]
        assert record.spectra.turn == pytest.approx(slope, abs=3 * drift.std)
        assert abs(drift.value) < 3 * drift.std


def test_an_offset_is_each_records_own_unless_the_band_has_0_hz_in_it():
    shifted = records(2)
    for record in shifted:
        record.y = record.y + 5
    assert fit_plant(start(TRUTH), shifted).cost_per_dof < 1.2
    fit = fit_plant(start(TRUTH), shifted, band=(0, 250))
    assert fit.records[0].line[0] == 0
    assert fit.cost_per_dof > 1.2


def test_a_free_axis_has_no_mean_angle():
    """Without a spring nothing says where the axis stands: line 0 of an angle is never used."""
    u = multisine(1)
    model = plant({"rigid_body": {"gain": 900.0}, "viscous_friction": {"rate": 12.0}}, output="angle")
    y = np.tile(model.simulate(u).y + 7, P) + 1e-5 * np.random.default_rng(1).standard_normal(P * N)
    fit = fit_plant(model, Record(np.tile(u, P), y, FS_HZ, N, 0, hold="zoh"), band=(0, 250))
    assert fit.records[0].line[0] == 1
    assert fit.cost_per_dof < 1.2


def test_the_mean_angle_counts_in_closed_loop():
    """A constant torque against a position loop without integrator leaves an error that stays."""
    loop = {"kp": 30.0, "kv": 0.1, "limit": 1e3}
    stack = {"position_velocity_loop": loop, "rigid_body": {"gain": 900.0}, "torque_bias": {"level": 50.0}}
    model = plant(stack, output="angle")
    u = multisine(1, band=(2, 20), amplitude=0.5)
    y = np.tile(model.simulate(u).y, P) + 1e-3 * np.random.default_rng(1).standard_normal(P * N)
    fit = fit_plant(model.with_values([855.0, 55.0]), Record(np.tile(u, P), y, FS_HZ, N, 0, hold="zoh"))
    assert fit.records[0].line[0] == 0
    assert fit.converged
    assert all(
        abs(z) < 3 for z in deviations(fit, {"rigid_body.gain": 900, "torque_bias.level": 50}).values()
    )


# ---- what the data do not tell ---------------------------------------------------------------------------


def test_a_mode_far_above_the_band_is_not_determined():
    truth = TRUTH | {"flexible_mode.f_hz": 1100.0, "flexible_mode.zeta": 0.02, "flexible_mode.residue": 0.5}
    low = [axis_record(multisine(i, band=(2, 20)), P, 0.1, i, **AXIS) for i in range(2)]
    fit = fit_plant(start(truth), low)
    assert "flexible_mode.zeta" in fit.undetermined
    assert "rigid_body.gain" not in fit.undetermined


def test_a_spring_without_travel_is_not_determined():
    inputs = [multisine(i, band=(100, 250), amplitude=0.01) for i in range(2)]
    fast = [axis_record(u, P, 0.1, i, **AXIS) for i, u in enumerate(inputs)]
    fit = fit_plant(start(TRUTH), fast)
    assert "cable_spring.stiffness" in fit.undetermined
    assert "not determined by the data: " + ", ".join(fit.undetermined) in repr(fit)
    assert not {"rigid_body.gain", "transport_delay.delay_s"} & set(fit.undetermined)
    assert np.isfinite(fit.model["cable_spring.stiffness"].std)


def test_a_parameter_without_any_influence_is_pinned():
    """The derivative by a quantization is zero: it stays where it is, and the rest is fitted."""
    model = start(TRUTH | {"drive_quantization.step": 1e-6})
    fit = fit_plant(model, records(2))
    assert fit.undetermined == ["drive_quantization.step"]
    assert fit.model["drive_quantization.step"].value == model["drive_quantization.step"].value
    assert np.isnan(fit.model["drive_quantization.step"].std)
    assert fit.n_dof == 2 * 2 * len(fit.records[0].line) - 4
    assert all(abs(z) < 3 for z in deviations(fit, TRUTH).values())


def test_a_torque_that_only_shifts_the_mean_is_pinned():
    """With a linear spring a constant torque moves the angle's mean alone, which the band leaves out."""
    fit = fit_plant(start(TRUTH | {"torque_bias.level": 2.0}), records(2))
    assert fit.undetermined == ["torque_bias.level"]
    assert fit.converged
    assert all(abs(z) < 3 for z in deviations(fit, TRUTH).values())


def test_two_laws_that_the_travel_cannot_distinguish():
    """Over a few degrees gravity is a spring. The cost comes down, and what is not known is named."""
    truth = TRUTH | {"mass_unbalance.level": 100.0, "mass_unbalance.angle_deg": 20.0}
    fit = fit_plant(start(truth), records(2))
    assert fit.cost_per_dof < 1.1
    assert {"cable_spring.stiffness", "mass_unbalance.angle_deg"} & set(fit.undetermined)
    assert not {"rigid_body.gain", "transport_delay.delay_s"} & set(fit.undetermined)


def test_friction_that_is_not_there_ends_at_its_bound():
    """Half of all noises would like it below zero; seeds 100 and 101 are such."""
    fit = fit_plant(start(FRICTION_TRUTH), records(2))
    assert fit.at_bound == [LEVEL]
    assert fit.model[LEVEL].value == 0
    assert fit.converged


# ---- misuse and trouble ----------------------------------------------------------------------------------


def test_a_step_that_cannot_be_simulated_is_a_step_that_failed(with_friction, monkeypatch):
    run, calls = PeriodicPlant.run, []

    def failing(self, *args, **kwargs):
        calls.append(1)
        if 3 < len(calls) <= 6:  # the first trial of three records
            raise GsidError(-4, "the plant left the range of numbers")
        return run(self, *args, **kwargs)

    monkeypatch.setattr(PeriodicPlant, "run", failing)
    fit = fit_plant(start(FRICTION_TRUTH), with_friction)
    assert fit.converged
    assert all(abs(z) < 3 for z in deviations(fit, FRICTION_TRUTH).values())


def test_a_start_that_cannot_be_simulated_is_reported():
    """A spring that pushes away: the angle grows by exp(30 t)."""
    model = start(TRUTH)
    model["cable_spring.stiffness"].value = -1e7
    with pytest.raises(InputError, match="cannot be simulated with its starting values"):
        fit_plant(model, records(1))


@pytest.mark.parametrize("value", [0.0, 1e30])
def test_a_constant_output_is_bad_input(value):
    """A bug: "Residuals are not finite in the initial point", as if the command had been typed wrong."""
    (still,) = records(1)
    still.y = np.full_like(still.y, value)
    for fit in (fit_plant, lambda model, record: linear_start(model, [spectra(record)])):
        with pytest.raises(InputError, match="the output is constant") as refused:
            fit(start(TRUTH), still)
        assert refused.value.hint


def test_misuse():
    model, one = start(TRUTH), records(1)
    with pytest.raises(ValueError, match="no record"):
        fit_plant(model, [])
    with pytest.raises(ValueError, match="solver must be one of"):
        fit_plant(model, one, solver="newton")
    with pytest.raises(ValueError, match="method must be one of"):
        fit_plant(model, one, method="nls")
    with pytest.raises(ValueError, match="max_iter"):
        fit_plant(model, one, max_iter=0)
    with pytest.raises(ValueError, match="no line"):
        fit_plant(model, one, band=(2000, 3000))
    with pytest.raises(ValueError, match="per_record contains"):
        fit_plant(model, one, per_record=["cable_spring"])
    with pytest.raises(ValueError, match="share no free parameter"):
        fit_plant(model, one, per_record=list(TRUTH))
    with pytest.raises(InputError, match="no such parameter") as error:
        fit_plant(model, one, fixed=["cable_spring.stifness"])
    assert "cable_spring.stiffness" in error.value.hint
    with pytest.raises(InputError, match="4 unknowns need more lines"):
        fit_plant(model, one, band=(100, 101.9))


def test_fixed_parameters_stay_and_are_marked():
    model = start(TRUTH)
    fit = fit_plant(model, records(1), fixed=["transport_delay.delay_s"])
    assert fit.model["transport_delay.delay_s"].value == model["transport_delay.delay_s"].value
    assert not fit.model["transport_delay.delay_s"].free
    assert model["transport_delay.delay_s"].free
    assert fit.model.cov.shape == (3, 3)


def test_a_limit_of_steps_is_reported(with_friction):
    fit = fit_plant(start(FRICTION_TRUTH), with_friction, max_iter=1)
    assert not fit.converged
    assert "NOT converged" in repr(fit)


def test_every_setting_has_a_source():
    """A unit where it is a float, and an equation, the sweep, a reference or the reason of a choice."""
    text = GreyboxSettings.__doc__.split("Attributes\n")[1]
    entries = re.findall(r"^    ([a-z_, ]+) : (.+)\n((?:        .+\n)+)", text, re.M)
    sources = {name: words for names, _, words in entries for name in names.split(", ")}
    assert list(sources) == [field.name for field in fields(GreyboxSettings)]
    for name, words in sources.items():
        assert re.search(r"Chosen:|Sweep:|From [A-Z]|GBX-\d", words), name


# ---- statistics ------------------------------------------------------------------------------------------


def test_variances_are_pooled_over_records_of_one_level():
    a, b = (spectra(record) for record in records(2, n_periods=14))
    (loud,) = (spectra(record) for record in records(1, n_periods=30, amplitude=0.5))
    (var_a, dof_a), (var_b, dof_b), (var_loud, dof_loud) = pooled_variance([a, b, loud])
    assert (dof_a, dof_b, dof_loud) == (26, 26, 29)
    np.testing.assert_allclose(var_a, (a.noise_y + b.noise_y) / 2)
    assert var_a is var_b
    np.testing.assert_allclose(var_loud, loud.noise_y)


def test_few_degrees_of_freedom_are_pooled_over_lines():
    (s,) = (spectra(record) for record in records(1, n_periods=3))
    ((variance, dof),) = pooled_variance([s])
    assert dof == 2 * 11
    np.testing.assert_allclose(variance[100], s.noise_y[95:106].mean())
    assert dof >= DOF_WANTED


@pytest.mark.parametrize(
    ("n_lines", "n_dof", "n_pooled"),
    [(1, 2, 1), (2, 2, 1), (5, 2, 5), (6, 2, 5), (40, 2, 11), (40, 3, 7), (40, 20, 1)],
)
def test_as_few_lines_are_pooled_as_are_needed(n_lines, n_dof, n_pooled):
    """Up to 20 degrees of freedom, and no more lines than there are."""
    variance = np.random.default_rng(1).chisquare(2, n_lines)
    pooled, dof = smoothed(variance, float(n_dof))
    assert dof == n_dof * n_pooled
    middle = (n_lines - 1) // 2
    around = variance[middle - n_pooled // 2 : middle + n_pooled // 2 + 1]
    assert pooled[middle] == pytest.approx(around.mean())


@pytest.mark.parametrize("shortened", [False, True])
def test_pooled_lines_are_those_of_scipy_and_numpy(shortened):
    """Reflected edges as ndimage has them, shortened ones as the quotient of two convolutions."""
    seed = 20260902
    print("seed", seed)
    rng, worst = np.random.default_rng(seed), 0.0
    for n_lines in (1, 2, 5, 40):
        for half in range((n_lines - 1) // 2 + 1):
            x = rng.chisquare(2, (n_lines, 2, 3)) + 1j * rng.chisquare(2, (n_lines, 2, 3))
            window = np.ones(2 * half + 1)
            if shortened:
                count = np.convolve(np.ones(n_lines), window, "same")[:, None]
                rows = x.reshape(n_lines, -1)
                expected = np.array([np.convolve(row, window, "same") for row in rows.T]).T / count
            else:
                parts = (ndimage.uniform_filter1d(part, len(window), axis=0) for part in (x.real, x.imag))
                expected = np.add(*(part * by for part, by in zip(parts, (1, 1j), strict=True)))
            difference = averaged(x, half, shortened=shortened) / expected.reshape(x.shape) - 1
            worst = max(worst, float(np.abs(difference).max()))
    print("largest relative difference", worst)
    assert worst < 1e-13


@pytest.mark.parametrize("shortened", [False, True])
def test_bug_a_large_variance_cost_the_lines_behind_it_their_digits(shortened):
    """Running sums kept the rounding of a large value: 1e-4 of variances of 1e-13 of it."""
    variance = np.full(200, 1e-13)
    variance[50] = 1.0
    pooled = averaged(variance, 5, shortened=shortened)
    np.testing.assert_allclose(pooled[60:], 1e-13, rtol=1e-12)
    if not shortened:
        np.testing.assert_allclose(smoothed(variance, 2.0)[0][60:], 1e-13, rtol=1e-12)


def test_a_band_may_reach_half_the_sample_rate():
    (s,) = (spectra(record) for record in records(1, n_periods=3))
    use = lines_used(start(TRUTH), s, (0.1, FS_HZ))
    assert s.line[use].tolist() == list(range(1, (s.period_samples + 1) // 2))


def test_standard_errors_cover_the_truth():
    """300 noises, 4 periods: |z| < 1.96 in 95 % of the fits of each parameter, within the 99.9 % range."""
    n, n_repeats, seed = 300, 300, 20260308
    print("seed", seed)
    rng = np.random.default_rng(seed)
    axis = {"gain": 900.0, "viscous_rate": 60.0, "spring_stiffness": 9000.0, "coulomb_level": 300.0}
    truth = {"rigid_body.gain": 900.0, "viscous_friction.rate": 60.0, "cable_spring.stiffness": 9000.0}
    truth |= {LEVEL: 300.0}
    u = multisine(1, n=n, band=(10, 400), amplitude=0.3)
    record = axis_record(u, P, 0.0, 0, **axis)
    clean, model = record.y, start(truth)
    z, cost = [], []
    for _ in range(n_repeats):
        record.y = clean + 0.5 * rng.standard_normal(len(clean))
        fit = fit_plant(model, record)
        z.append(list(deviations(fit, truth).values()))
        cost.append(fit.cost_per_dof)
    lo, hi = stats.binom.interval(0.999, n_repeats, 0.95)
    covered = np.count_nonzero(np.abs(z) < 1.96, axis=0)
    print("covered", covered, "of", n_repeats, "rms z", np.sqrt(np.mean(np.square(z), axis=0)))
    assert np.all((covered >= lo) & (covered <= hi))
    print(f"cost per degree of freedom {np.mean(cost):.4f} +- {np.std(cost) / np.sqrt(n_repeats):.4f}")
    assert np.mean(cost) == pytest.approx(1, abs=4 * np.std(cost) / np.sqrt(n_repeats) + 0.01)


# ---- all lines alike -------------------------------------------------------------------------------------


def rms_error(model, measured, band):
    """Over time, of what the lines of the band leave, by the transform of the error itself."""
    n = measured.period_samples
    E = np.where(
        (measured.f_hz >= band[0]) & (measured.f_hz <= band[1]), measured.y - model.predict(measured).Y, 0
    )
    return np.sqrt(np.mean(np.fft.irfft(E * n / 2, n) ** 2))


def test_least_squares_of_the_output_leave_the_smallest_rms_error(with_friction):
    """A wrong model, and noise that is ten times smaller at high frequency."""
    band, rng = (2, 250), np.random.default_rng(20260312)
    record = axis_record(multisine(1), 8, 0.0, 0, **AXIS, coulomb_level=6.0)
    white = rng.standard_normal(len(record.y))
    record.y = record.y + 1e-3 * np.convolve(white, np.ones(30) / 3, "same") + 1e-3 * white
    measured = spectra(record)
    by_noise = fit_plant(start(TRUTH), measured, band=band)
    alike = fit_plant(start(TRUTH), measured, band=band, method="nls-output")
    assert alike.converged
    least = rms_error(alike.model, measured, band)
    assert least < 0.99 * rms_error(by_noise.model, measured, band)
    assert alike.cost > by_noise.cost  # both in units of the noise
    for i, value in enumerate(alike.model.free_values):
        for factor in (0.98, 1.02):
            values = alike.model.free_values
            values[i] = factor * value
            assert rms_error(alike.model.with_values(values), measured, band) > least, alike.model.free_names[
                i
            ]
    residual = np.concatenate([r.residual for r in alike.records])
    assert alike.cost == pytest.approx(residual @ residual, rel=1e-12)
    assert alike.model.fit["method"] == "nls-output"


def test_standard_errors_of_equal_weights_cover_the_truth():
    """150 noises that are large at low frequency: |z| < 1.96 in 95 %, within the 99.9 % range (GBX-4)."""
    n, n_repeats, seed = 300, 150, 20260313
    print("seed", seed)
    rng = np.random.default_rng(seed)
    truth = {"rigid_body.gain": 900.0, "viscous_friction.rate": 60.0, "cable_spring.stiffness": 9000.0}
    axis = {"gain": 900.0, "viscous_rate": 60.0, "spring_stiffness": 9000.0}
    record = axis_record(multisine(1, n=n, band=(10, 400), amplitude=0.3), 24, 0.0, 0, **axis)
    clean, model = record.y, start(truth, 1.2)  # 5 to 12 deviations off
    z, wider = [], []
    for i in range(n_repeats):
        white = rng.standard_normal(len(clean) + 100)
        record.y = clean + 0.3 * lfilter([1], [1, -0.95], white)[100:]
        fit = fit_plant(model, record, method="nls-output")
        z.append(list(deviations(fit, truth).values()))
        if i % 10 == 0:
            weighted = fit_plant(model, record).model
            wider.append(fit.model["rigid_body.gain"].std / weighted["rigid_body.gain"].std)
    lo, hi = stats.binom.interval(0.999, n_repeats, 0.95)
    covered = np.count_nonzero(np.abs(z) < 1.96, axis=0)
    print("covered", covered, "of", n_repeats, "rms z", np.sqrt(np.mean(np.square(z), axis=0)))
    assert np.all((covered >= lo) & (covered <= hi))
    assert np.mean(wider) > 1.5  # what the noise's weights are for: the gain shows at quiet lines, too


def test_quiet_lines_are_searched_as_closely_as_loud_ones():
    """A mode at 220 Hz above noise that lies below 60 Hz, 1 % off: five standard deviations.

    The search had counted in the mean noise, called such a start converged, and given it back.
    """
    model = plant(
        {
            "rigid_body": {"gain": 900.0},
            "viscous_friction": {"rate": 12.0},
            "cable_spring": {"stiffness": 400.0},
            "flexible_mode": {"f_hz": 220.0, "zeta": 0.005, "residue": 0.03},
        }
    )
    fixed = [name for name in model.free_names if name != RESIDUE]
    rng = np.random.default_rng(20260314)
    u = np.tile(multisine(1, amplitude=0.5), 8)
    record = Record(u, np.zeros(len(u)), FS_HZ, N, 0, hold="zoh", y_unit="deg/s")
    record.y = np.tile(model.predict(spectra(record)).y, 8)
    white = np.fft.rfft(rng.standard_normal(len(u)))
    record.y = record.y + np.fft.irfft(np.where(np.fft.rfftfreq(len(u), 1 / FS_HZ) < 60, 30, 1e-2) * white)
    ends = []
    for off in (1.01, 1.5):
        model[RESIDUE].value = 0.03 * off
        fit = fit_plant(model, record, fixed=fixed, method="nls-output")
        assert fit.converged
        std = fit.model[RESIDUE].std
        assert 0.03 * (off - 1) > 5 * std
        assert abs(deviations(fit, {RESIDUE: 0.03})[RESIDUE]) < 3
        ends.append(fit.model[RESIDUE].value)
    # Each stops where a step would lower the cost by less than 0.01, which is within 0.1 deviation.
    assert abs(ends[1] - ends[0]) < 0.2 * std


@pytest.mark.parametrize("solver", ["lm", "nlopt"])
def test_a_step_into_what_does_not_settle_has_failed(solver):
    """A bug: the fit of a gear went on at values where one record rattled without end, and a cost that
    depends on when one stops to wait was taken for the least."""

    class Rattling:
        """Cost (x - 1)^2; from 0.5 on nothing settles."""

        n = 1

        def start(self):
            return np.zeros(1)

        def bounds(self):
            return np.full(1, -np.inf), np.full(1, np.inf)

        def at(self, x):
            slope, error = np.array([[10.0]]), 10 * (1 - x)
            return float(error @ error), slope, error, bool(x[0] < 0.5)

        def keep(self):
            pass

    found = search(Rattling(), solver, 50)
    assert 0 < found.x[0] < 0.5
    assert not found.converged
