"""`gsid.start`: structures of simulated axes and of measured records, and what is reported of them."""

import json
from dataclasses import replace
from types import SimpleNamespace

import axes
import numpy as np
import pytest

import gsid
from gsid.base.errors import InputError
from gsid.cli.main import main
from gsid.response.total_variance import total_variance
from gsid.spectrum.realisation import spectra
from gsid.structure.elements import Structure
from gsid.structure.select import has_slow_lag, rescored, select, simplest
from measured import BENCH, DATA, needs_bench

SEED = 20261124
needs_silverbox = pytest.mark.skipif(not (DATA / "silverbox").is_dir(), reason=f"no silverbox in {DATA}")
needs_crane = pytest.mark.skipif(not (DATA / "crane_multisine").is_dir(), reason=f"no crane in {DATA}")
needs_emps = pytest.mark.skipif(not (DATA / "emps").is_dir(), reason=f"no emps in {DATA}")


def record(axis, rng, hold="zoh", **facts):
    u, y = axes.measured(axis, rng)
    return gsid.Record(u, y, axes.FS_HZ, axes.N, 0, hold=hold, **facts)


def expected(axis):
    """Parameters of the catalogue."""
    values = {"rigid_body.gain": axis.gain, "transport_delay.delay_s": axis.delay_s}
    values["viscous_friction.rate"] = axis.rate
    if axis.stiffness:
        values["cable_spring.stiffness"] = axis.stiffness
    if axis.lag_s:
        values["sensor_lag.time_constant_s"] = axis.lag_s
    for i, mode in enumerate(axis.modes, 1):
        label = "flexible_mode" if i == 1 else f"flexible_mode#{i}"
        values |= {f"{label}.{n}": v for n, v in zip(("f_hz", "zeta", "residue"), mode, strict=True)}
    return values


def flat(effects):
    return {f"{effect}.{name}": value for effect, params in effects.items() for name, value in params.items()}


@pytest.mark.parametrize(("f_body", "zeta"), [(0.847, 0.058), (1.6, 0.04), (3.3, 0.011)])
def test_bug_a_spring_with_a_narrow_resonance_was_refused(f_body, zeta):
    """Lines 1 Hz apart, half widths of 0.04 to 0.06 Hz: no stack was found, or one without the spring."""
    rng = np.random.default_rng([SEED, round(1000 * f_body)])
    w = 2 * np.pi * f_body
    axis = replace(
        axes.drawn(rng, 0.0), rate=2 * zeta * w, stiffness=w**2, modes=[(87.7, 0.05, 0.2)], lag_s=1e-3
    )
    found = gsid.start(record(axis, rng))
    true, values, std = expected(axis), flat(found.effects), flat(found.std)
    assert set(values) == set(true), found
    for name, value in true.items():
        assert abs(values[name] - value) < 5 * std[name], (name, value, values[name], std[name])
    assert any("narrower than the distance of the lines" in text for text in found.assumed)


@pytest.mark.parametrize("seed", range(3))
def test_a_linear_axis_is_found_with_its_values(seed):
    print("seed", SEED, seed)
    rng = np.random.default_rng([SEED, seed])
    axis = axes.drawn(rng, 0.0)
    found = gsid.start(record(axis, rng))
    true, values, std = expected(axis), flat(found.effects), flat(found.std)
    assert set(values) == set(true), found
    assert found.output == "rate"
    assert found.represented
    for name, value in true.items():
        assert abs(values[name] - value) < 5 * std[name], (name, value, values[name], std[name])


@pytest.mark.parametrize("seed", range(3))
def test_coulomb_friction_adds_no_elements(seed):
    """A bug of weights from the noise alone: friction counted as dynamics, with surplus poles."""
    print("seed", SEED, 10 + seed)
    rng = np.random.default_rng([SEED, 10 + seed])
    axis = axes.drawn(rng, 0.05)
    found = gsid.start(record(axis, rng))
    assert set(flat(found.effects)) == set(expected(axis)), found
    modes = [params["f_hz"] for effect, params in found.effects.items() if effect.startswith("flexible")]
    assert modes == pytest.approx([f for f, _, _ in axis.modes], rel=5e-3)
    noise, std = flat(found.std_noise_only), flat(found.std)
    assert std["viscous_friction.rate"] > 2 * noise["viscous_friction.rate"]


@pytest.mark.parametrize("seed", range(3))
def test_bug_friction_of_a_fifth_of_the_drive_hid_a_spring(seed):
    """The variance at the first lines, which show the spring, was four times too large."""
    print("seed", SEED, 15, seed)
    rng = np.random.default_rng([SEED, 15, seed])
    axis = axes.Axis(10.0, 10.6, (2 * np.pi * 2.6) ** 2, [(190.0, 0.025, 0.31)], 0.0, 4e-3, coulomb=0.2)
    found = gsid.start(record(axis, rng))
    assert set(flat(found.effects)) == set(expected(axis)), found


def test_bug_every_structure_was_refused_after_fits_of_high_weight():
    """The rational fits with a small allowed error ended far away: all structures were refused."""
    rng = np.random.default_rng([9002, 20, 54])
    axis = axes.drawn(rng, 0.2)
    found = gsid.start(record(axis, rng))
    assert found.represented
    assert found.output == "rate"
    assert found.effects["flexible_mode"]["f_hz"] == pytest.approx(axis.modes[0][0], rel=5e-3)


def test_bug_the_holds_were_compared_with_default_settings():
    """With other odds against a slow lag the scores of the two holds ignored them."""
    rng = np.random.default_rng([SEED, 60])
    axis = axes.drawn(rng, 0.0)
    axis.modes, axis.stiffness, axis.rate, axis.lag_s = [], 0.0, 20.0, 2e-3
    measured = total_variance(record(axis, rng))
    found = select(measured, "zoh", ("rate",))
    values = found.chosen.fitted.values
    assert (values.structure.body, values.structure.n_modes, len(values.lags)) == ("viscous", 0, 1)
    exchanged = values.theta.copy()  # the same response: rate and 1 / lag are two real poles
    exchanged[:2] = -values.theta[1::-1]
    slow = replace(found.chosen.fitted, values=replace(values, theta=exchanged))
    assert has_slow_lag(slow.values, found.data.lines)
    found = replace(found, chosen=replace(found.chosen, fitted=slow))
    same = {name: getattr(found, name) for name in ("relative_error", "correlation", "scale")}
    other = replace(found.settings, slow_lag_odds=found.settings.slow_lag_odds + 5.0)
    before, after = (rescored(one, measured, **same) for one in (found, replace(found, settings=other)))
    assert after - before == pytest.approx(5.0, abs=1e-6)


def test_model_and_rational_model_are_the_same_function():
    rng = np.random.default_rng([SEED, 20])
    measured = record(axes.drawn(rng, 0.0), rng)
    found = gsid.start(measured)
    model, one = found.model(), spectra(measured)
    plant = model.predict(one).Y[one.excited] / one.u[one.excited]
    rational = found.rational.response(one.f_hz[one.excited])
    assert np.abs(plant / rational - 1).max() < 1e-6
    assert model.cov.shape == (len(model.free_names),) * 2
    assert model["rigid_body.gain"].std == pytest.approx(found.std["rigid_body"]["gain"])


def test_two_realisations_with_lines_of_their_own():
    """Lines that one realisation only excites count too."""
    rng = np.random.default_rng([SEED, 30])
    axis = axes.drawn(rng, 0.05)
    odd = np.arange(1, axes.LINE_MAX + 1, 2)
    records = []
    for _ in range(3):
        u, y = axes.measured(axis, rng, lines=odd[rng.random(len(odd)) < 0.6])
        records.append(gsid.Record(u, y, axes.FS_HZ, axes.N, 0, hold="zoh"))
    found = gsid.start(records)
    assert set(flat(found.effects)) == set(expected(axis)), found
    assert len(found.measured) > 220
    assert found.measured.largest_source == "realisations"


def test_output_is_inferred_reported_and_settled():
    rng = np.random.default_rng([SEED, 40])
    axis = axes.drawn(rng, 0.0, "angle")
    axis.modes, axis.lag_s, axis.stiffness, axis.rate = [], 0.0, 0.0, 12.0
    measured = record(axis, rng)
    found = gsid.start(measured)
    assert found.output == "angle"
    assert any("inferred" in text for text in found.assumed)
    assert any(one["what"] == "output" and one["score"] == 0 for one in found.ambiguous)
    stated = gsid.start(measured, output="rate")
    assert stated.output == "rate"
    assert not any("inferred" in text for text in stated.assumed)


def test_the_unit_states_what_y_is():
    """An angle and a rate behind a slow lag are the same function: the unit decides."""
    rng = np.random.default_rng([SEED, 40])
    axis = axes.drawn(rng, 0.0, "angle")
    axis.modes, axis.lag_s, axis.stiffness, axis.rate = [], 0.0, 0.0, 12.0
    found = gsid.start(record(axis, rng, y_unit="deg/s"))
    assert found.output == "rate"
    assert "y is the rate, by its unit deg/s; --output states another" in found.assumed


def test_bug_an_output_against_its_unit_was_found_without_a_word():
    """No later step took the model. Here no stack has such an acceleration: it falls with the square."""
    rng = np.random.default_rng([SEED, 40])
    axis = axes.drawn(rng, 0.0, "angle")
    axis.modes, axis.lag_s, axis.stiffness, axis.rate = [], 0.0, 0.0, 12.0
    found = gsid.start(record(axis, rng, y_unit="deg/s^2"))
    assert found.output == "angle"
    against = "inferred from the data against its unit deg/s^2 (acceleration); --output"
    assert any(against in text for text in found.assumed), found.assumed


@pytest.mark.parametrize(
    ("unit", "is_told"), [("deg/s", True), ("deg", False), ("", False), ("counts", False)]
)
def test_bug_a_stated_output_against_its_unit_was_taken_without_a_word(unit, is_told):
    """Later verbs refuse the record beside that model: the unit has to be corrected."""
    rng = np.random.default_rng([SEED, 40])
    axis = axes.drawn(rng, 0.0, "angle")
    axis.modes = []
    found = gsid.start(record(axis, rng, y_unit=unit), output="angle")
    against = "y is the angle, as stated, against its unit deg/s (rate); --unit NAME=UNIT corrects it"
    assert (against in found.assumed) is is_told


@pytest.mark.parametrize("unit", ["", "deg/s"])
@pytest.mark.parametrize("coulomb", [0.0, 0.2])
def test_bug_rounding_decided_between_a_rate_and_an_angle(coulomb, unit):
    """Viscous body and lag, or the angle of an overdamped spring: the same function. 10 of 12 were angles."""
    for seed in (1, 2, 4):
        print("seed", SEED, seed)
        rng = np.random.default_rng([SEED, seed])
        axis = axes.drawn(rng, coulomb)
        axis.modes, axis.lag_s, axis.stiffness, axis.rate = [], 1.2e-3, 0.0, 6.0
        found = gsid.start(record(axis, rng, y_unit=unit))
        assert found.output == "rate"
        assert set(found.effects) >= {"viscous_friction", "sensor_lag"}
        assert any("no unit is stated" in text for text in found.assumed) == (unit == "")
        assert any(one["what"] == "output" for one in found.ambiguous) == (unit == "")


def two_masses(rng):
    """Rate of a motor with viscous friction that drives a load through a spring, in closed form."""
    n, fs_hz, periods = 4000, 2000.0, 8
    line = np.arange(1, 400, 2)
    s = 2j * np.pi * line * fs_hz / n
    joint = 4.0 * s + (2 * np.pi * 63) ** 2 / 3  # over the inertia of the motor; the load has half of it
    response = 1.35 / (s + 4.0 + joint / s * (0.5 * s**2) / (0.5 * s**2 + joint))
    response *= np.exp(-s * 0.7e-3) / (1 + 0.5e-3 * s)
    lines = np.zeros((2, n // 2 + 1), complex)
    lines[0, line] = np.exp(2j * np.pi * rng.random(len(line)))
    lines[1, line] = response * lines[0, line]
    u, y = (np.tile(one, periods) * n for one in np.fft.irfft(lines, n))
    y += 1e-3 * y.std() * rng.standard_normal(len(y))
    return gsid.Record(u, y, fs_hz, n, 0, hold="none")


def test_bug_the_rate_of_two_masses_was_an_acceleration_behind_a_slow_lag():
    """The friction of the motor alone is not that of a mode, and a lag of 0.4 s fitted better."""
    print("seed", SEED)
    found = gsid.start(two_masses(np.random.default_rng([SEED, 70])))
    assert found.output == "rate"
    assert found.effects["flexible_mode"]["f_hz"] == pytest.approx(63.0, rel=5e-3)
    gain, std = found.effects["rigid_body"]["gain"], found.std["rigid_body"]["gain"]
    assert abs(gain - 0.9) < 5 * std, (gain, std)


def test_lag_of_motor_or_sensor_is_ambiguous():
    rng = np.random.default_rng([SEED, 50])
    axis = axes.drawn(rng, 0.0)
    axis.lag_s = 1.5e-3
    found = gsid.start(record(axis, rng))
    assert {"what": "lag", "chosen": "sensor_lag", "other": "motor_lag", "score": 0.0} in found.ambiguous


def candidate(score, n_lags, residual, body="sprung", output="rate"):
    return SimpleNamespace(structure=Structure(output, body, 1, n_lags, residual), score=score)


def test_bug_modes_above_the_band_stood_for_a_lag_within_the_odds():
    """Of as many parameters the one with the better score was chosen; a motor lag of 0.3 ms was not found."""
    above, two_lags, more = candidate(10.0, 1, True), candidate(16.0, 2, False), candidate(9.0, 2, True)
    assert above.structure.n_parameters == two_lags.structure.n_parameters
    assert simplest([more, above, two_lags]) is two_lags


@pytest.mark.parametrize("other", [{"body": "viscous", "n_lags": 3}, {"output": "angle", "n_lags": 2}])
def test_modes_above_the_band_give_way_to_a_lag_alone(other):
    """Not to another body or another output with as many parameters."""
    above = candidate(10.0, 1, True)
    rival = candidate(10.1, residual=False, **other)
    assert rival.structure.n_parameters == above.structure.n_parameters
    assert simplest([above, rival]) is above


def test_hold_that_the_record_does_not_state_is_assumed():
    rng = np.random.default_rng([SEED, 60])
    axis = axes.drawn(rng, 0.0)
    found = gsid.start(record(axis, rng, hold=None))
    assert any("the input was" in text and "to decide" in text for text in found.assumed)
    other = {"zoh": "none", "none": "zoh"}[found.hold]
    assert ("hold", other) in [(one["what"], one["other"]) for one in found.ambiguous]  # lines up to 0.08 fs


def test_a_response_that_is_no_stack_gives_the_rational_model(tmp_path, capsys):
    """Two echoes of equal size: no lag, mode or delay represents them."""
    rng = np.random.default_rng([SEED, 70])
    print("seed", SEED, 70)
    u = axes.command(rng)
    f = np.arange(axes.N // 2 + 1) * axes.FS_HZ / axes.N
    echoes = 1 + 0.9 * np.exp(-2j * np.pi * f * 0.05) + 0.8 * np.exp(-2j * np.pi * f * 0.08)
    y = np.fft.irfft(np.fft.rfft(u) * echoes, axes.N)
    y = np.tile(y, 4) + 1e-3 * rng.standard_normal(4 * axes.N)
    measured = gsid.Record(np.tile(u, 4), y, axes.FS_HZ, axes.N, 0, hold="none")
    found = gsid.start(measured)
    assert not found.represented
    assert found.effects == {}
    with pytest.raises(InputError, match="no stack of effects represents the data"):
        found.model()
    path, out = tmp_path / "echo.csv", tmp_path / "model.json"
    gsid.write_record(path, measured)
    assert main(["start", str(path), "-o", str(out)]) == 0
    assert "No stack of effects represents the data" in capsys.readouterr().out
    assert isinstance(gsid.load_model(out), gsid.RationalModel)


def test_the_command_prints_and_writes(tmp_path, capsys):
    rng = np.random.default_rng([SEED, 80])
    path, out, picture = (tmp_path / name for name in ("rec.csv", "plant.json", "start.png"))
    gsid.write_record(path, record(axes.drawn(rng, 0.0), rng, y_unit="deg/s"))
    assert main(["start", str(path), "-o", str(out), "--plot", str(picture), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    keys = {"effects", "ambiguous", "output", "hold", "cost_per_line", "order", "assumed"}
    assert keys <= set(printed)
    assert picture.stat().st_size > 0
    model = gsid.load_model(out)
    assert model["rigid_body.gain"].value == printed["effects"]["rigid_body"]["gain"]
    assert main(["start", str(path), "--output", "rate"]) == 0
    text = capsys.readouterr().out
    assert "noise only" in text
    assert "assumed: period 6000 samples" in text


def test_printed_forms():
    rng = np.random.default_rng([SEED, 90])
    found = gsid.start(record(axes.drawn(rng, 0.0), rng, y_unit="deg/s"))
    assert "rigid_body" in repr(found)
    assert "<table>" in found._repr_html_()
    assert "1 realisations" not in repr(found)


def test_bad_arguments():
    rng = np.random.default_rng([SEED, 91])
    measured = record(axes.drawn(rng, 0.0), rng)
    with pytest.raises(ValueError, match="output must be one of rate, angle, acceleration, got 'speed'"):
        gsid.start(measured, output="speed")
    with pytest.raises(InputError, match="too few lines for a structure"):
        gsid.start(measured, band=(1.0, 6.0))


def test_bug_a_constant_output_ended_in_a_singular_matrix():
    rng = np.random.default_rng(SEED)
    moving = record(axes.drawn(rng, 0.0), rng)
    with pytest.raises(InputError, match="y is constant"):
        gsid.start(replace(moving, y=np.zeros_like(moving.y)))


# ---- measured records ----------------------------------------------------------------------------------


@needs_silverbox
def test_silverbox_is_one_spring():
    """Ten realisations with random phases, of one period each."""
    whole = np.load(DATA / "silverbox" / "Schroeder80mV.npz")
    parts = [slice(begin - 200, begin + 8192) for begin in 22231 + 8692 * np.arange(10)]
    records = [gsid.Record(whole["u"][p], whole["y"][p], 610.3515625, 8192, 200, hold="none") for p in parts]
    found = gsid.start(records)
    assert (found.output, found.order) == ("angle", "2/0")
    assert set(found.effects) <= {"rigid_body", "viscous_friction", "cable_spring", "transport_delay"}
    f_hz = np.sqrt(found.effects["cable_spring"]["stiffness"]) / (2 * np.pi)
    assert f_hz == pytest.approx(69.95, rel=5e-3)
    assert found.measured.largest_source == "realisations"


@needs_silverbox
def test_smooth_phases_of_one_realisation_are_reported():
    whole = np.load(DATA / "silverbox" / "Schroeder80mV.npz")
    part = slice(10587, 10587 + 11 * 1024)
    measured = gsid.Record(whole["u"][part], whole["y"][part], 610.3515625, 1024, hold="none")
    found = gsid.start(measured)
    assert found.output == "angle"
    assert set(found.effects) <= {"rigid_body", "viscous_friction", "cable_spring", "transport_delay"}
    f_hz = np.sqrt(found.effects["cable_spring"]["stiffness"]) / (2 * np.pi)
    # smooth phases: the level's own stiffness, 4 % above that of random phases, and the allowance is reported
    assert f_hz == pytest.approx(72.6, rel=5e-3)
    assert found.relative_error >= 0.2
    assert any("smooth phases" in text for text in found.assumed)


@needs_bench
@pytest.mark.parametrize(("part", "f_hz"), [("A", 76.2), ("B", 76.4)])
def test_motor_bench_has_one_mode(part, f_hz):
    whole = np.load(BENCH / f"multisine_{part}.npz")
    measured = gsid.Record(whole["iq"], whole["omega_motor"], 2500.0, 2500, 2500)
    found = gsid.start(measured)
    assert found.output == "rate"
    assert found.effects["flexible_mode"]["f_hz"] == pytest.approx(f_hz, rel=5e-3)
    in_band = [p for e, p in found.effects.items() if e.startswith("flexible") and p["f_hz"] < 250]
    assert len(in_band) == 1


@needs_crane
def test_crane_is_a_pendulum():
    whole = np.load(DATA / "crane_multisine" / "exp1.npz")
    found = gsid.start(gsid.Record(whole["u"], whole["cable_angle"], 50.0, 8192, 8192))
    f_hz = np.sqrt(found.effects["cable_spring"]["stiffness"]) / (2 * np.pi)
    assert f_hz == pytest.approx(0.735, rel=2e-3)
    assert not any(effect.startswith("flexible") for effect in found.effects)


@needs_emps
def test_emps_in_its_loop():
    whole = np.load(DATA / "emps" / "estimation.npz")
    columns = {"q_ref": whole["q_ref"]}
    measured = gsid.Record(whole["v"], whole["q"], 1000.0, 6240, 6240, columns=columns, y_unit="m")
    found = gsid.start(measured, reference="q_ref")
    assert found.output == "angle"
    mass = 35.15065188 / found.effects["rigid_body"]["gain"]
    assert mass == pytest.approx(95.1, rel=0.03)
