"""The lag of a linear part is its fastest real pole: a torque acts on the body, behind the slower ones."""

import numpy as np
import pytest

import gsid
from gsid.diagnosis.missing_torque.linear_fit import with_fast_lag
from gsid.excitation.multisine import Multisine
from gsid.plant.linear_response import linear_view
from gsid.rig.axis import SimulatedAxis

SEED = 20261123
FS_HZ, N, PERIODS = 3000.0, 3000, 6


def stack(gain, rate, stiffness, tau):
    known = {
        "rigid_body": {"gain": gain},
        "viscous_friction": {"rate": rate},
        "sensor_lag": {"time_constant_s": tau},
    }
    return known | ({} if stiffness is None else {"cable_spring": {"stiffness": stiffness}})


@pytest.mark.parametrize("stiffness", [None, 7355.0])
def test_a_slow_lag_is_swapped_without_a_change_of_the_response(stiffness):
    slow = stack(349.0, 996.0, stiffness, 0.0468)
    fast = with_fast_lag(slow)
    f_hz = np.array([0.3, 2.0, 40.0, 900.0])
    before, after = (
        linear_view(one, f_hz, FS_HZ, output_angle=False, radians_per_unit=np.pi / 180, held=True)
        for one in (slow, fast)
    )
    assert after.command == pytest.approx(before.command, rel=1e-12)  # rounding
    assert fast["sensor_lag"]["time_constant_s"] < 1 / 900
    assert with_fast_lag(fast) is None


@pytest.mark.parametrize(
    "known",
    [
        stack(7.4, 11.0, 170.0, 0.001),  # a body that oscillates
        stack(7.4, 30.0, None, 0.001),
        {"rigid_body": {"gain": 1.0}, "sensor_lag": {"time_constant_s": 1.0}},
        {"rigid_body": {"gain": 1.0}, "viscous_friction": {"rate": 1.0}},
    ],
)
def test_other_stacks_stay(known):
    assert with_fast_lag(known) is None


@pytest.mark.long
def test_bug_friction_was_unknown_where_the_fit_took_the_pole_of_the_body_for_the_lag():
    """The linear part of an axis with friction ended at a body of 996 1/s behind a lag of 47 ms."""
    print("seed", SEED)
    axis = SimulatedAxis(seed=SEED, mode_residue=0, fan_amplitude=0, noise_low_rms=0, coulomb_level=20.0)
    u = np.tile(
        Multisine.design(FS_HZ, N, (2, 250), rms=20.0, phases="random", seed=SEED).table(), PERIODS + 2
    )
    applied, y, _ = axis.step(u)
    record = gsid.Record(applied, y, FS_HZ, N, 2 * N, hold="zoh", y_unit="deg/s")
    found = gsid.diagnose_records(record, time_s=600)
    assert found.verdict == "missing_effect"
    assert found.effects == ("coulomb_friction",)
    values = found.model.stack()
    assert values["coulomb_friction"]["level"] == pytest.approx(20.0, rel=0.02)
