"""The facts beside each effect's descriptor, against formulas and numbers written down once more."""

import ctypes
import os
import shlex
import subprocess

import numpy as np
import pytest
from plants import FS_HZ, plant

from gsid._lib import ffi
from gsid.effects.types import SCALES, SPACINGS, catalogue, find
from gsid.greybox.linear_start import LINEAR
from gsid.plant.effect import Effect, Param
from gsid.plant.linear_response import linear_view
from gsid.plant.periodic import PeriodicPlant
from gsid.rig.axis import HIDDEN, parameter_types

NOT_SEARCHED = {effect.id for effect in catalogue().values() if effect.not_searched}
TURNS_ONLY = {effect.id for effect in catalogue().values() if effect.turns_only}
SIMPLER = {effect.id: effect.simpler for effect in catalogue().values() if effect.simpler}
F_HZ = np.geomspace(0.5, 200.0, 40)
S = 2j * np.pi * F_HZ
UNIT = np.pi / 180  # degrees
GAIN, RATE, STIFFNESS = 7.4, 11.0, 170.0
AXIS = {
    "rigid_body": {"gain": GAIN},
    "viscous_friction": {"rate": RATE},
    "cable_spring": {"stiffness": STIFFNESS},
}
BODY = S**2 + RATE * S + STIFFNESS
HOLD = (1 - np.exp(-S / FS_HZ)) / (S / FS_HZ)
G = GAIN * S / BODY * HOLD  # command to rate

GEAR = {"gap_deg": 0.3, "stiffness": 3e4, "inertia_ratio": 0.2, "damping": 25.0}
JOINT = GEAR["stiffness"] / S + GEAR["damping"]
W0 = 2 * np.pi * 60.0
KP, KV = 20.0, 5.0
TACHO = GAIN * HOLD * S / BODY

# Of each effect with a linear part: its values, and the response of the axis with it.
CLOSED_FORMS = {
    "rigid_body": ({"gain": 3.0}, (GAIN + 3.0) / GAIN * G),
    "viscous_friction": ({"rate": 4.0}, GAIN * S / (BODY + 4.0 * S) * HOLD),
    "cable_spring": ({"stiffness": 40.0}, GAIN * S / (BODY + 40.0) * HOLD),
    "mass_unbalance": (
        {"level": 5000.0, "angle_deg": 60.0},
        GAIN * S / (BODY + 5000.0 * 0.5 * UNIT) * HOLD,
    ),
    "transport_delay": ({"delay_s": 0.004}, G * np.exp(-0.004 * S)),
    "motor_lag": ({"time_constant_s": 0.002}, G / (1 + 0.002 * S)),
    "sensor_lag": ({"time_constant_s": 0.003}, G / (1 + 0.003 * S)),
    "sensor_sample_hold": ({"rate_hz": 400.0}, G * (1 - np.exp(-S / 400)) / (S / 400)),
    "flexible_mode": (
        {"f_hz": 60.0, "zeta": 0.02, "residue": 0.3},
        G + GAIN * HOLD * 0.3 * S / (S**2 + 2 * 0.02 * W0 * S + W0**2),
    ),
    "internal_dynamics": (
        {"b1": 30.0, "b0": 5e4, "a1": 8.0, "a0": 1.5e4},
        GAIN * S / (BODY + S * (30.0 * S + 5e4) / (S**2 + 8.0 * S + 1.5e4)) * HOLD,
    ),
    # Two bodies: r s p = gain u - T, (s + rate + stiffness / s) w = T, T = joint (p - w).
    "gear_backlash": (
        GEAR,
        GAIN
        * HOLD
        * JOINT
        / ((0.2 * S + JOINT) * (BODY / S + JOINT) - JOINT**2),
    ),
    # u = kv (kp (r - w / s) - w)
    "position_velocity_loop": (
        {"kp": KP, "kv": KV, "limit": 0.0, "rate_samples": 0.0},
        TACHO * KV * KP / (1 + TACHO * KV * (1 + KP / S)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("effect", [e.id for e in catalogue().values() if e.linear_part])
def test_the_linear_part_is_the_closed_form(effect):
    params, expected = CLOSED_FORMS[effect]
    stack = AXIS | {f"{effect}#2" if effect in AXIS else effect: params}
    found = linear_view(stack, F_HZ, FS_HZ, radians_per_unit=UNIT).command
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_linear_part_of_a_controller_that_counts_an_encoder():
    stack = AXIS | {"position_velocity_loop": {"kp": KP, "kv": KV, "limit": 0.0, "rate_samples": 3.0}}
    seen = (1 - np.exp(-3 * S / FS_HZ)) / (3 * S / FS_HZ)
    expected = TACHO * KV * KP / (1 + TACHO * KV * (seen + KP / S))
    np.testing.assert_allclose(linear_view(stack, F_HZ, FS_HZ).command, expected, rtol=1e-9)


# Without the sensor that holds: sampling folds its images back into the band.
@pytest.mark.parametrize("effect", sorted(CLOSED_FORMS.keys() - {"sensor_sample_hold"}))
def test_a_small_command_shows_the_linear_part(effect):
    """The simulation solves differential equations, and owes the formula in the frequency domain nothing."""
    params, _ = CLOSED_FORMS[effect]
    if effect == "gear_backlash":
        params = params | {"gap_deg": 0.0}
    n, excited = 6000, np.arange(2, 60, 8)
    phases = np.exp(2j * np.pi * np.random.default_rng(7).random(len(excited)))
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[excited] = 1e-3 * phases
    u = np.fft.irfft(spectrum) * n / 2
    model = plant(AXIS | {effect: params})
    f = np.arange(n // 2 + 1) * FS_HZ / n
    view = linear_view(model.stack(), f, FS_HZ, radians_per_unit=UNIT)
    answer = PeriodicPlant(model, u, FS_HZ).run()
    np.testing.assert_allclose(answer.Y[excited], (view.command * spectrum)[excited], rtol=2e-3)


def test_every_law_with_equations_of_state_has_a_linear_part():
    """But a constant torque, which has no frequency response."""
    of_state = {e.id for e in catalogue().values() if e.c.linear != ffi.NULL}
    assert of_state - {e.id for e in catalogue().values() if e.linear_part} == {"torque_bias"}


def test_what_is_fitted_to_the_linear_response():
    assert {
        "rigid_body.gain",
        "viscous_friction.rate",
        "cable_spring.stiffness",
        "transport_delay.delay_s",
        "motor_lag.time_constant_s",
        "sensor_lag.time_constant_s",
        "flexible_mode.f_hz",
        "flexible_mode.zeta",
        "flexible_mode.residue",
        "internal_dynamics.a0",
        "internal_dynamics.a1",
        "internal_dynamics.b0",
        "internal_dynamics.b1",
        "gear_backlash.stiffness",
        "gear_backlash.damping",
    } == LINEAR


def test_what_the_axis_can_hide():
    assert {
        "drive_dead_zone",
        "drive_saturation",
        "coulomb_friction",
        "stribeck_friction",
        "quadratic_drag",
        "cubic_spring",
        "mass_unbalance",
        "motor_cogging",
        "sensor_sample_hold",
    } == set(HIDDEN)
    assert HIDDEN["mass_unbalance"] == {"level": "unbalance_level", "angle_deg": "unbalance_angle_deg"}
    fields = [name for effect in catalogue().values() for name in _axis_fields(effect)]
    assert set(fields) <= set(parameter_types())


def _axis_fields(effect):
    return [parameter.axis_field for parameter in effect.parameters if parameter.axis_field]


def test_an_effect_is_in_the_axis_wholly_or_not_at_all():
    for effect in catalogue().values():
        assert len(_axis_fields(effect)) in (0, len(effect.parameters)), effect.id


def test_what_the_search_leaves_out():
    """One more effect in the search changes every diagnosis, and needs its rates measured anew."""
    assert {
        "position_velocity_loop",
        "periodic_disturbance",
        "quadratic_spring",
        "internal_dynamics",
    } == NOT_SEARCHED
    assert {"mass_unbalance", "motor_cogging"} == TURNS_ONLY
    assert SIMPLER == {
        "bouc_wen": "presliding_friction",
        "presliding_friction": "coulomb_friction",
        "stribeck_friction": "coulomb_friction",
    }
    for effect in NOT_SEARCHED:
        assert "not searched by gsid diagnose: " in repr(find(effect))


@pytest.mark.parametrize("effect", catalogue())
def test_the_law_for_a_reader_names_every_parameter(effect):
    known = find(effect)
    assert known.law in repr(known)
    assert all(name in known.law for name in known.names), known.law


# What the points are shares of, on a gimbal axis.
OF = {
    "largest rate": 20.0,
    "largest angle": 1.7,
    "travel": 0.06,
    "largest command": 75.0,
    "sample": 1 / 3000,
    "sampling rate": 3000.0,
    "highest excited line": 150.0,
    "1": 1.0,
}


@pytest.mark.parametrize("effect", catalogue())
def test_a_grid_lies_in_the_bounds_and_has_a_reason(effect):
    for parameter in find(effect).parameters:
        if parameter.grid is not None:
            assert parameter.grid.spacing in SPACINGS.values()
            assert parameter.grid.of in SCALES.values()
            assert parameter.grid.reason
            points = parameter.grid.at(OF[parameter.grid.of])
            assert len(points) >= 3
            assert np.all((points >= parameter.lower) & (points <= parameter.upper))


# The grids of the search as numbers, of motions and commands of these sizes.
GRIDS = {
    "stribeck_friction.velocity": (20.0, 20.0 * np.geomspace(0.003, 0.5, 8)),
    "presliding_friction.stiffness": (3.0, 1 / (3.0 * np.geomspace(0.001, 4.0, 11))),
    "bouc_wen.unloading": (3.0, 1 / (3.0 * np.geomspace(0.02, 2.0, 5))),
    "bouc_wen.loading": (3.0, np.array([-2, -1, -0.5, -0.2, 0, 0.5, 2, 8, 30]) / 3.0),
    "hard_stop.angle_deg": (1.7, (1 - np.geomspace(0.5, 0.002, 14)) * 1.7),
    "drive_dead_zone.half_width": (75.0, 75.0 * np.geomspace(1e-4, 0.3, 14)),
    "drive_saturation.limit": (
        75.0,
        75.0 * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.86, 0.92, 0.96, 0.985]),
    ),
    "motor_lag.time_constant_s": (1.0, np.array([0.6, 1.5, 3, 6, 15])),
    "sensor_lag.time_constant_s": (1.0, np.array([0.6, 1.5, 3, 6, 15])),
    "motor_cogging.cycles_per_rev": (
        0.06,
        np.arange(np.pi / 2 / 0.06, 40 * np.pi / 0.06, 2 * np.pi / 3 / 0.06),
    ),
    "flexible_mode.zeta": (1.0, np.array([0.005, 0.02, 0.08])),
}


@pytest.mark.parametrize("name", GRIDS)
def test_the_points_of_a_grid(name):
    effect, _, parameter = name.partition(".")
    scale, expected = GRIDS[name]
    np.testing.assert_array_equal(find(effect)[parameter].grid.at(scale), expected)


def test_roundings_differ_by_a_third_of_a_step_at_the_largest_command():
    steps = find("drive_quantization")["step"].grid.at(100.0)
    assert steps[0] == pytest.approx(100 / 3)
    np.testing.assert_allclose(np.diff(100.0 / steps), 1 / 3, rtol=1e-9)
    assert steps[-1] == pytest.approx(100 / 1500, rel=1e-3)


def test_usual_rates_of_sensors():
    rates = find("sensor_sample_hold")["rate_hz"].grid.at(3000.0)
    assert rates[0] == 100.0
    assert rates[-1] == 1500.0
    assert {125.0, 200.0, 400.0, 1000.0} <= set(rates)
    assert np.all(np.diff(rates) > 0)


def test_an_effect_of_ones_own_has_no_linear_part():
    from gsid import effects

    own = effects.expression("k*theta", {"k": 1.0})
    assert own.linear_part is None
    model = plant(AXIS)
    model.effects.append(Effect(own.id, {"k": Param(40.0)}, own))
    np.testing.assert_array_equal(
        linear_view(model.stack(), F_HZ, FS_HZ).command, linear_view(AXIS, F_HZ, FS_HZ).command
    )


# ---- the law written for export-c, against the equations that the plant runs -------------------------------

WRITTEN = [effect.id for effect in catalogue().values() if effect.as_c]
LAWS_HEAD = "#include <math.h>\n#define RAD_PER_DEG 0.017453293f\n"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The laws in C with typical values, compiled: {effect: function of command, rate and angle}."""
    folder, source = tmp_path_factory.mktemp("laws"), LAWS_HEAD
    for effect in WRITTEN:
        known = find(effect)
        values = {parameter.name: f"{parameter.typical!r}f" for parameter in known.parameters}
        law = known.as_c.format(**values, unit_rad=f"{UNIT!r}f")
        source += f"float {effect}(float u, float rate, float angle) {{\n"
        source += f"    (void)u, (void)rate, (void)angle;\n    return {law};\n}}\n"
    (folder / "laws.c").write_text(source)
    flags = ["-std=c99", "-O1", "-fPIC", "-shared", "-o", "laws.so", "laws.c", "-lm"]
    subprocess.run([*shlex.split(os.environ.get("CC", "cc")), *flags], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "laws.so"))

    def function(effect):
        law = getattr(library, effect)
        law.restype, law.argtypes = ctypes.c_float, [ctypes.c_float] * 3
        return law

    return function


def by_the_plant(known, u, rate, angle):
    """Torque, or what a map makes of the command, by the functions of the descriptor."""
    item = ffi.new("gsid_plant_item *")
    item.effect = known.c
    for i, parameter in enumerate(known.parameters):
        item.value[i] = parameter.typical
    if known.stage == "actuator":
        return known.c.command(item, u, ffi.new("double *"), ffi.new("double[4]"))
    if known.c.torque == ffi.NULL:  # a constant torque is an entry of the equations of state
        return item.value[0]
    motion, answer = ffi.new("gsid_motion *"), ffi.new("gsid_torque *")
    motion.rate, motion.angle, motion.side, motion.unit_rad = rate, angle, np.sign(rate), UNIT
    known.c.torque(item, motion, answer)
    return answer.torque


@pytest.mark.parametrize("effect", WRITTEN)
def test_the_law_for_export_is_the_law_that_is_simulated(written, effect):
    rng = np.random.default_rng(3)
    for u, rate, angle in rng.uniform(-1, 1, (50, 3)) * [200.0, 5.0, 2.0]:
        expected = by_the_plant(find(effect), u, rate, angle)
        # Single precision, and cogging turns its phase by 252 times the angle.
        assert written(effect)(u, rate, angle) == pytest.approx(expected, rel=1e-5, abs=2e-4), (
            u,
            rate,
            angle,
        )
