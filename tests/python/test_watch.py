"""Limits of a run, on samples whose first excess is known."""

import numpy as np
import pytest
from line import Loopback, multisine, quiet_axis

from gsid.rig.axis import SimulatedAxis
from gsid.rig.link import LimitError, Stopped
from gsid.rig.run import run
from gsid.rig.server import Server
from gsid.rig.watch import RunLimits, Watch

FS_HZ = 100.0


def first_excess(limits, u, y, received=None, offset=0.0, piece=7):
    """Sample and words of the first excess, with the samples in pieces."""
    watch = Watch(limits, FS_HZ, offset)
    received = np.ones(len(y), bool) if received is None else received
    for first in range(0, len(y), piece):
        part = slice(first, first + piece)
        if found := watch.check(u[part], y[part], received[part]):
            return first + found[0], found[1]
    return None


def test_the_first_sample_beyond_a_limit_is_found():
    u, y = np.linspace(0, 10, 101), np.linspace(0, -5, 101)
    assert first_excess(RunLimits(), u, y) is None
    assert first_excess(RunLimits(command=7.0, rate=5.0, travel_deg=50.0), u, y) == (
        71,
        "command 7.1, limit 7",
    )
    assert first_excess(RunLimits(command=10.0, rate=4.0), u, y) == (81, "rate -4.05, limit 4")
    angle = np.cumsum(y) / FS_HZ
    at = int(np.flatnonzero(np.abs(angle) > 1.0)[0])
    assert first_excess(RunLimits(travel_deg=1.0), u, y)[0] == at


def test_the_offset_at_rest_is_no_travel():
    """0.01 deg/s are 0.6 deg in a minute."""
    n = int(60 * FS_HZ)
    y = 0.01 + np.random.default_rng(1).normal(0, 0.01, n)
    assert first_excess(RunLimits(travel_deg=0.5), np.zeros(n), y, offset=0.01) is None
    assert first_excess(RunLimits(travel_deg=0.5), np.zeros(n), y) is not None


def test_a_lost_sample_holds_the_rate():
    y = np.full(300, 1.0)
    received = np.ones(300, bool)
    received[20:80] = False
    y[~received] = 0.0
    assert first_excess(RunLimits(travel_deg=1.0), np.zeros(300), y, received)[0] == 100


@pytest.mark.parametrize("limits", [RunLimits(rate=5.0), RunLimits(travel_deg=90.0)])
def test_an_axis_whose_gyro_fails_does_not_move_on_unwatched(limits):
    """At 100 Hz a second is 100 samples."""
    y, received = np.full(300, 1.0), np.ones(300, bool)
    received[50:149] = False  # not long enough
    received[160:] = False
    assert first_excess(limits, np.zeros(300), y, received) == (260, "time without a rate [s] 1.01, limit 1")
    assert first_excess(RunLimits(command=1.0), np.zeros(300), y, received) is None


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_an_invalid_limit_is_refused(limit):
    with pytest.raises(ValueError, match="must be positive"):
        RunLimits(rate=limit)


def test_a_run_within_its_limits_is_not_disturbed_by_the_offset_of_the_gyro():
    class Biased(SimulatedAxis):
        def step(self, u):
            u, y, angle = super().step(u)
            return u, y + 0.5, angle

    axis = Biased(noise_rms=0, noise_low_rms=0, fan_amplitude=0)
    u = multisine(600, 40, 0.5)
    record = run(Loopback(Server(axis)), u, periods=20, limits=RunLimits(20.0, 1.0, 50.0))
    assert record.meta["good_periods"] == "20"
    assert record.y.mean() == pytest.approx(0.5, abs=0.1)  # 2.2 deg in these 4.4 s
    with pytest.raises(LimitError, match="exceeds a limit: stopped") as caught:
        run(Loopback(Server(quiet_axis())), u, periods=20, limits=RunLimits(rate=0.05))
    assert len(caught.value.record) > 0


def test_a_run_stopped_while_the_axis_rests_has_no_samples(tmp_path):
    """Those of the rest are no part of the record."""
    line = Loopback(Server(quiet_axis()))
    with pytest.raises(Stopped) as caught:
        run(
            line,
            multisine(600, 40, 0.5),
            periods=2,
            limits=RunLimits(travel_deg=1.0),
            should_stop=lambda: line.server.served.ticks > 100,
            journal=tmp_path / "a.journal",
        )
    assert caught.value.record is None
    assert not list(tmp_path.iterdir())
    assert line.stopped


def test_a_command_that_is_too_large_is_refused_before_the_port_is_opened():
    with pytest.raises(LimitError, match="planned command exceeds its limit"):
        run("nowhere", multisine(600, 40, 3.0), periods=1, limits=RunLimits(command=1.0))


@pytest.mark.parametrize("limit", [0.0, -1.0, np.inf, np.nan])
def test_a_limit_that_limits_nothing_is_refused(limit):
    with pytest.raises(ValueError, match="the limit of rate must be positive and finite"):
        RunLimits(rate=limit)


def test_bug_a_command_at_its_limit_that_the_drive_rounds_up_stopped_the_run():
    step = 20 / 511.6
    u = np.round(20 * np.sin(np.arange(60)) / np.sin(11) / step) * step
    assert 20 < np.abs(u).max() < 20 + step / 2
    y = np.zeros(len(u))
    assert first_excess(RunLimits(command=20.0), u, y) is None
    u[50] += np.sign(u[50]) * (20 + 0.7 * step - abs(u[50]))
    assert first_excess(RunLimits(command=20.0), u, y)[0] == 50


def test_an_unrounded_command_beyond_its_limit_is_found_in_the_first_samples():
    assert first_excess(RunLimits(command=20.0), np.full(3, 21.1), np.zeros(3))[0] == 0
    u = np.linspace(0, 20.01, 2001)
    assert first_excess(RunLimits(command=20.0), u, np.zeros(len(u)))[0] == 2000
