"""The position as the integral of the gyro: a closed form, and the true angle of the simulated axis."""

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.plots.record import records
from gsid.records.position import position
from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis
from gsid.spectrum.realisation import spectra

FS_HZ, N = 3000.0, 6000


def driven(periods=6, **axis):
    u = np.tile(Multisine.design(FS_HZ, N, (0.5, 250), amplitude=1.0).table(), periods)
    u_applied, y, angle = SimulatedAxis(**axis).step(u)
    return u_applied, y, angle


def test_a_sine_has_its_integral_whatever_the_offset():
    t = np.arange(5 * N) / FS_HZ
    rate = 2.0 * np.cos(2 * np.pi * t) + 0.3
    u = np.cos(2 * np.pi * t)
    found = position(Record(u, rate, FS_HZ, N, 0, y_unit="deg/s"))
    # the rule of trapezoids is exact but for (2 pi f h)^2 / 12 = 4e-7
    np.testing.assert_allclose(found.angle, np.sin(2 * np.pi * t) / np.pi, atol=1e-6)
    assert found.offset == pytest.approx(0.3, abs=1e-12)
    assert (found.unit, found.std_offset) == ("deg", pytest.approx(0, abs=1e-12))
    assert (found.lo, found.hi) == pytest.approx((-1 / np.pi, 1 / np.pi), abs=1e-5)


def test_the_angle_of_the_simulated_axis_is_found_with_an_offset_of_the_gyro():
    """Without lag and mode the gyro shows the rate of the angle; its delay moves both."""
    quiet = {"noise_rms": 0.0, "noise_low_rms": 0.0, "fan_amplitude": 0.0}
    u, y, angle = driven(gyro_lag_s=0.0, mode_f_hz=0.0, mode_residue=0.0, **quiet)
    found = position(Record(u, y + 0.05, FS_HZ, N, 2 * N, y_unit="deg/s"))
    assert np.abs(found.angle - angle).max() < 2e-3 * np.abs(angle).max()
    assert found.offset == pytest.approx(0.05, abs=1e-4)


def test_the_error_of_the_offset_has_its_standard_deviation():
    """300 seeds of white noise: the standard deviation of the offsets is the one stated."""
    t = np.arange(12 * 300) / 300.0
    u = np.cos(2 * np.pi * t)
    found = [
        position(Record(u, u + np.random.default_rng(seed).standard_normal(len(t)), 300.0, 300, 0))
        for seed in range(300)
    ]
    offsets = np.array([one.offset for one in found])
    stated = np.sqrt(np.mean([one.std_offset**2 for one in found]))
    assert offsets.std() / stated == pytest.approx(1, abs=4 / np.sqrt(2 * 300))
    assert abs(offsets.mean()) < 4 * stated / np.sqrt(300)
    assert found[0].std_end == pytest.approx(found[0].std_offset * (len(t) - 1) / 300)


def test_lost_samples_do_not_move_the_axis():
    u, y, _ = driven()
    valid = np.ones(len(y), bool)
    valid[14000:14003] = False
    whole = position(Record(u, y, FS_HZ, N, 2 * N, y_unit="deg/s"))
    broken = position(Record(u, np.where(valid, y, 1e6), FS_HZ, N, 2 * N, valid=valid, y_unit="deg/s"))
    given = position(
        Record(u, np.where(valid, y, 1e6), FS_HZ, valid=valid, y_unit="deg/s"), offset=whole.offset
    )
    assert np.abs(given.angle - whole.angle).max() < 0.02
    assert abs(broken.offset - whole.offset) < 5 * whole.std_offset
    assert np.isnan(given.std_offset)


def test_limits_may_be_on_one_side():
    t = np.arange(5 * N) / FS_HZ
    found = position(Record(np.cos(t * 2 * np.pi), -np.sin(2 * np.pi * t), FS_HZ, N, 0, y_unit="deg/s"))
    lowest = -1 / np.pi  # cos - 1, over 2 pi
    assert found.within(-0.4, 0.1)
    assert found.within(-0.4, np.inf)
    assert not found.within(0.9 * lowest, np.inf)


def test_what_is_no_rate_is_refused():
    with pytest.raises(InputError, match="not a rate"):
        position(Record(np.ones(8), np.ones(8), 1.0, y_unit="deg"))
    with pytest.raises(InputError):  # no period, and no offset
        position(Record(np.arange(99.0), np.ones(99), 1.0, y_unit="deg/s"))


def test_a_far_limit_does_not_flatten_the_picture():
    t = np.arange(5 * N) / FS_HZ
    record = Record(np.cos(2 * np.pi * t), np.cos(2 * np.pi * t), FS_HZ, N, 0, y_unit="deg/s")
    figure = records([(record, spectra(record))], travel=(-135.0, 0.2))
    axes = next(ax for ax in figure.axes if ax.get_ylabel().startswith("position"))
    assert -1 < axes.get_ylim()[0] < -1 / (2 * np.pi)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels[1:] == [
        "limit of the travel, -135 deg (outside the picture)",
        "limit of the travel, 0.2 deg",
    ]


def test_bug_the_offset_of_a_drifting_gyro_was_that_of_its_first_period():
    """The mean rate over the periods is zero after the offset, so that the position ends where it began."""
    t = np.arange(5 * N) / FS_HZ
    rate = 2.0 * np.cos(2 * np.pi * t) + 0.3 + 0.05 * t
    found = position(Record(np.cos(2 * np.pi * t), rate, FS_HZ, N, 0, y_unit="deg/s"))
    assert found.offset == pytest.approx(rate.mean(), abs=1e-9)
    assert found.angle[-1] == pytest.approx(0, abs=2e-3)
