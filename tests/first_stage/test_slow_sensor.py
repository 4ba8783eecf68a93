"""A gimbal axis whose gyro is refreshed at 400 Hz and read at 3 kHz, with a fan, simulated by tests/blind.

Its images and what it folds into the band are errors of the first stage; the simulation contains them.
"""

import numpy as np
import pytest
import truth
from test_steps import BODY, VISCOUS, model

import gsid
from gsid.base.zero_order_hold import hold_factor
from gsid.diagnosis.missing_torque.motion import _lines_of_motion
from gsid.diagnosis.missing_torque.problem import Problem, linear_part
from gsid.diagnosis.missing_torque.settings import DEFAULTS

FS_HZ, N, P, RATE_HZ = 3000.0, 6000, 8, 400.0
AXIS = {"fs_hz": FS_HZ, "gain": 20.0, "delay_s": 0.0055, "viscous_rate": 2.5, "sensor_lag_s": 0.0008}
AXIS |= {"mode_hz": 179.0, "mode_zeta": 0.01, "mode_residue": 0.3, "sample_hold_hz": RATE_HZ}
SEED = 1


def rig(**law):
    """Records at two levels; noise and fan are held by the sensor too, and rounded to 0.01 deg/s."""
    print("seed", SEED)
    rng, t_s = np.random.default_rng([SEED, 5]), np.arange(N * P) / FS_HZ
    lines = np.arange(1, 380, 2)
    lines = lines[rng.random(len(lines)) < 0.85]
    last = np.floor(np.floor(t_s * RATE_HZ + 1e-9) * (FS_HZ / RATE_HZ) + 1e-9).astype(int)
    records = []
    for level in (40, 40, 120, 120):
        phases = rng.uniform(0, 2 * np.pi, len(lines))
        u = np.cos(2 * np.pi * np.outer(t_s[:N], lines / 2) + phases).sum(axis=1)
        u = np.rint(1.4 * level * u / np.abs(u).max()).clip(-179, 179)
        y = truth.steady(AXIS | law, u, tolerance=1e-5)[0]
        noise = 0.03 * rng.standard_normal(N * P)
        noise += 0.05 * np.sin(2 * np.pi * 30.9 * t_s + rng.uniform(0, 2 * np.pi))
        y = 0.01 * np.rint((np.tile(y, P) + noise[last]) / 0.01)
        units = {"u_unit": "command", "y_unit": "deg/s", "hold": "zoh"}
        records.append(gsid.Record(np.tile(u, P), y, FS_HZ, N, 0, **units))
    return records


def test_bug_images_above_half_the_refresh_rate_were_taken_for_motion():
    """Coulomb friction explained 6 % of the misfit in the first draft, and the effect was unknown."""
    found = gsid.diagnose_records(rig(coulomb_level=12.0), fast=True)
    best = found.ranking[0]
    assert best.effects[0] == "coulomb_friction"
    assert best.share_kept_out > 0.98
    assert best.params["level"] == pytest.approx(12.0, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize(
    ("law", "name", "value"),
    [
        ({"coulomb_level": 12.0}, "coulomb_friction.level", 12.0),
        (
            {"spring_stiffness": 30.0, "cogging_level": 20.0, "cogging_cycles": 72.0},
            "motor_cogging.level",
            20.0,
        ),
        (
            {"coulomb_level": 8.0, "stribeck_extra": 6.0, "stribeck_velocity": 1.0},
            "stribeck_friction.extra",
            6.0,
        ),
        ({"quadratic_drag_rate": 0.05}, "quadratic_drag.rate", 0.05),
    ],
)
def test_bug_behind_a_slow_sensor_an_effect_was_unknown_or_the_simpler_one(law, name, value):
    """Coulomb friction and cogging were unknown, and a Stribeck friction was Coulomb friction alone."""
    found = gsid.diagnose_records(rig(**law), time_s=600)
    assert (found.verdict, found.effects[0]) == ("missing_effect", name.partition(".")[0])
    assert tuple(found.found[0]) == ("sensor_sample_hold",)
    assert found.model[name].value == pytest.approx(value, rel=0.03)  # a friction at low speed: 1 %
    assert found.cost_per_dof_after < 1.1


def small_problem(stack):
    """Lines to 190 Hz of a small record, whose values do not matter."""
    rng, line = np.random.default_rng(SEED), np.arange(1, 381)
    u = np.cos(2 * np.pi * np.outer(np.arange(N), line) / N + rng.uniform(0, 6, 380)).sum(axis=1)
    y = np.tile(np.roll(u, 5), 2) + 0.1 * rng.standard_normal(2 * N)
    record = gsid.Record(np.tile(u, 2), y, FS_HZ, N, 0, u_unit="command", y_unit="deg/s", hold="zoh")
    return Problem(stack, [gsid.spectra(record)], None, DEFAULTS)


def behind(rate_hz):
    return model(BODY, VISCOUS).with_effect("sensor_sample_hold", {"rate_hz": rate_hz})


@pytest.mark.parametrize(("rate_hz", "top_hz"), [(3000.0, 380.0), (400.0, 200.0), (300.0, 150.0)])
def test_lines_beyond_half_the_refresh_rate_show_no_motion(rate_hz, top_hz):
    problem = small_problem(behind(rate_hz))
    line = _lines_of_motion(problem, linear_part(behind(rate_hz)), problem.records[0])
    assert 2 * top_hz - 2 <= line[-1] <= 2 * top_hz


def test_the_first_stage_has_the_age_of_each_value_of_the_sensor():
    """Of 7 or 8 samples in turn: the mean of its samples, in time, over that without the sensor."""
    problem, part = small_problem(behind(400.0)), linear_part(behind(400.0))
    found = problem.responses(part)[0][1] / problem.responses(linear_part(model(BODY, VISCOUS)))[0][1]
    n = np.arange(N)
    refreshed = np.floor(n * 400 / 3000 + 1e-9) * 7.5  # time of the last refresh [samples]
    f_hz = problem.records[0].f_hz[::20]
    turn = 2j * np.pi * np.outer(f_hz / FS_HZ, np.ones(N))
    expected = np.mean(np.exp(turn * refreshed) * np.exp(-turn * n), axis=1)
    np.testing.assert_allclose(found[::20], expected, rtol=1e-9)
    continuous = hold_factor(f_hz, 400.0)
    assert np.max(np.abs(continuous / expected - 1)) > 0.01
