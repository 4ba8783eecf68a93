"""`gsid.predict`: a model's output over time, against closed forms of sampled systems."""

import dataclasses

import numpy as np
import pytest
from plants import FS_HZ, plant
from scipy.signal import lfilter

import gsid
from gsid.excitation.multisine import Multisine

SEED = 20261201
N, PERIODS, NOISE = 600, 6, 0.02
GAIN, RATE = 40.0, 25.0
POLE = np.exp(-RATE / FS_HZ)


def answer(u, gain=GAIN):
    """Rate of a body with viscous friction under a held command."""
    return lfilter([0, gain / RATE * (1 - POLE)], [1, -POLE], u)


@pytest.fixture
def record():
    print("seed", SEED)
    u = Multisine.design(FS_HZ, N, (10, 400), rms=1.0, phases="random", seed=SEED).table()
    u = np.tile(u, PERIODS + 4)
    y = answer(u) + NOISE * np.random.default_rng(SEED).standard_normal(len(u)) + 0.5
    return gsid.Record(u, y, FS_HZ, N, 4 * N, hold="zoh", y_unit="deg/s", name="axis")


def stack(gain=GAIN, **more):
    return plant({"rigid_body": {"gain": gain}, "viscous_friction": {"rate": RATE}, **more})


def test_the_output_of_a_stack_is_the_closed_form(record):
    (found,) = gsid.predict(stack(), record)
    true = answer(record.u)[-N:]
    assert found.y_model - np.mean(found.y_model) == pytest.approx(
        true - np.mean(true), abs=1e-9 * np.ptp(true)
    )  # rounding, and what is not settled
    assert found.y.ravel() == pytest.approx(record.y[4 * N :], abs=1e-12 * np.ptp(true))
    assert found.t_s[1] == pytest.approx(1 / FS_HZ)


def test_fit_and_rms_error_are_those_of_their_definition(record):
    (found,) = gsid.predict(stack(1.1 * GAIN), record)
    y, error = record.y[4 * N :], record.y[4 * N :] - np.tile(answer(record.u, 1.1 * GAIN)[-N:], PERIODS)
    error -= np.mean(error)  # the offset of the gyro
    assert found.rms_error == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    assert found.fit_percent == pytest.approx(
        100 * (1 - np.linalg.norm(error) / np.linalg.norm(y - np.mean(y))), rel=1e-9
    )


def test_the_bound_by_noise_is_the_noise_that_was_added(record):
    (found,) = gsid.predict(stack(), record)
    dof = N * (PERIODS - 1)
    assert found.rms_noise == pytest.approx(NOISE, rel=4 / np.sqrt(2 * dof))  # four standard deviations
    assert found.fit_percent < found.fit_percent_of_noise < 100


def test_the_offset_of_the_gyro_is_that_of_the_record(record):
    (found,) = gsid.predict(stack(), record)
    assert found.offset_from_record
    assert np.mean(found.y_model) == pytest.approx(np.mean(record.y[4 * N :]), abs=1e-12)


def test_the_mean_of_a_position_loop_is_its_own():
    model = plant(
        {"position_velocity_loop": {"kp": 30.0, "kv": 1e-3}, "rigid_body": {"gain": 9e4}}, output="angle"
    )
    u = np.tile(Multisine.design(FS_HZ, N, (10, 100), phases="random", seed=SEED).table() + 0.3, 4)
    y = np.tile(model.simulate(u[:N]).y, 4) + 1e-6 * np.random.default_rng(SEED).standard_normal(len(u))
    record = gsid.Record(u, y + 0.1, FS_HZ, N, 0, hold="zoh", y_unit="deg")
    (found,) = gsid.predict(model, record)
    assert not found.offset_from_record
    assert np.mean(found.residual) == pytest.approx(0.1, abs=1e-6)


def test_a_transfer_function_gets_the_mean_of_the_record(record):
    axis = gsid.RationalModel([GAIN], [1, RATE], fs_hz=FS_HZ, hold="zoh", y_unit="deg/s")
    (found,) = gsid.predict(axis, record)
    assert found.offset_from_record
    noise_of_mean = NOISE / np.sqrt(PERIODS * N)
    assert np.mean(found.y_model) == pytest.approx(0.5, abs=4 * noise_of_mean)
    assert found.rms_error == pytest.approx(NOISE, rel=0.05)


def test_an_integrator_has_a_finite_output():
    """The response at 0 Hz is infinite, and the mean of the output is not known."""
    u = np.tile(Multisine.design(FS_HZ, N, (10, 400), rms=1.0, phases="random", seed=SEED).table(), 4)
    y = np.cumsum(u - np.mean(u)) + 1e-3 * np.random.default_rng(SEED).standard_normal(len(u))
    record = gsid.Record(u, y, FS_HZ, N, 0, hold="zoh")
    (found,) = gsid.predict(gsid.RationalModel([1.0], [1.0, 0.0], fs_hz=FS_HZ, hold="zoh"), record)
    assert np.all(np.isfinite(found.y_model))


def test_an_open_hold_is_the_one_with_the_smaller_error(record):
    silent = gsid.Record(record.u, record.y, FS_HZ, N, 4 * N, y_unit="deg/s")
    (found,) = gsid.predict(stack(), silent)
    (stated,) = gsid.predict(stack(), record)
    assert (found.hold, found.hold_assumed) == ("zoh", True)
    assert (stated.hold, stated.hold_assumed) == ("zoh", False)
    assert found.rms_error == stated.rms_error


def of_a_held_input(seed, noise, lines=(10, 400)):
    """A record of a held input that does not state it."""
    u = Multisine.design(FS_HZ, N, lines, rms=1.0, phases="random", seed=seed).table()
    u = np.tile(u, PERIODS + 4)
    y = answer(u) + noise * np.random.default_rng(seed).standard_normal(len(u))
    return gsid.Record(u, y, FS_HZ, N, 4 * N, y_unit="deg/s", name="axis")


def test_records_that_do_not_state_their_hold_have_one_hold():
    print("seed", SEED)
    clear = of_a_held_input(SEED, NOISE)
    vague = of_a_held_input(SEED + 1, NOISE)
    vague.y[:] = np.roll(vague.y, 1) + 0.5 * np.random.default_rng(SEED).standard_normal(len(vague.y))
    assert [one.hold for one in gsid.predict(stack(), clear)] == ["zoh"]
    assert [one.hold for one in gsid.predict(stack(), vague)] == ["none"]  # which has more delay
    assert [one.hold for one in gsid.predict(stack(), [clear, vague])] == ["zoh", "zoh"]


def test_a_record_that_states_its_hold_keeps_it(record):
    silent = of_a_held_input(SEED + 1, NOISE)
    found = gsid.predict(stack(), [record, silent])
    assert [(one.hold, one.hold_assumed) for one in found] == [("zoh", False), ("zoh", True)]


def test_periods_without_noise_show_the_hold():
    (found,) = gsid.predict(stack(), of_a_held_input(SEED, 0.0))
    assert found.hold == "zoh"


@pytest.mark.parametrize("seed", range(SEED, SEED + 6))
def test_a_hold_that_hardly_matters_is_none(seed):
    """Up to 0.025 of the sample rate half a sample is far below the noise: either error may be smaller."""
    (found,) = gsid.predict(stack(), of_a_held_input(seed, 2.0, (5, 15)))
    assert (found.hold, found.hold_assumed) == ("none", True)


def test_a_constant_output_has_no_fit():
    from gsid.prediction import fit_percent

    assert np.isnan(fit_percent(1.0, 0.0))


def test_one_result_for_each_record(record):
    found = gsid.predict(stack(), [record, record])
    assert [one.name for one in found] == ["axis", "axis"]


def test_something_else_than_a_model_is_refused(record):
    with pytest.raises(TypeError, match="model must be a gsid model"):
        gsid.predict(record, record)


def test_units_that_differ_are_refused(record):
    model = stack()
    model.y_unit = "rad/s"
    with pytest.raises(gsid.InputError, match="unit"):
        gsid.predict(model, record)


def test_the_picture_shows_each_record(record):
    from gsid.plots import predicted_output

    found = gsid.predict(stack(1.3 * GAIN), [record, record])
    axes = predicted_output(found).axes
    assert len(axes) == 8
    assert "FIT" in axes[0].get_title(loc="left")
    whole, near = axes[0].lines[0].get_xdata(), axes[2].lines[0].get_xdata()
    worst = found[0].t_s[np.argmax(np.abs(np.mean(found[0].residual, axis=0)))]
    assert len(whole) == N
    assert near[0] <= worst <= near[-1]
    assert found[0].plot().axes[0].get_ylabel() == "output [deg/s]"


def test_bug_the_close_ups_of_two_records_shared_one_time(record):
    """The close-up of the first record showed the time of the second one, where it has no curve."""
    from gsid.plots import predicted_output

    other = dataclasses.replace(record, y=np.roll(record.y, N // 2), u=np.roll(record.u, N // 2))
    for ax in predicted_output(gsid.predict(stack(1.3 * GAIN), [record, other])).axes:
        low, high = ax.get_xlim()
        x = ax.lines[0].get_xdata()
        assert low <= x[0] <= x[-1] <= high


def test_a_long_period_is_drawn_as_its_extremes():
    from gsid.plots import predicted_output
    from gsid.prediction import PredictedOutput

    print("seed", SEED)
    n, spike = 1_000_000, 654_321
    y = np.random.default_rng(SEED).standard_normal((2, n))
    y[:, spike] = 1e3
    figure = predicted_output(PredictedOutput(1e3, y, np.zeros(n), True))
    drawn = [line for ax in figure.axes for line in ax.lines]
    assert all(len(line.get_xdata()) <= 20_100 for line in drawn)
    assert max(drawn[0].get_ydata()) == 1e3
    assert drawn[0].get_xdata()[np.argmax(drawn[0].get_ydata())] == spike / 1e3
