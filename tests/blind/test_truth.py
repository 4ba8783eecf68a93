"""The truth simulator and the trials against closed forms: what judges others has to be right itself."""

import numpy as np
import pytest
import trials
import truth
from scipy.signal import welch

N = 6000
AXIS = {
    "fs_hz": 3000.0,
    "gain": 7.4,
    "delay_s": 0.00513,
    "viscous_rate": 2.0,
    "spring_stiffness": 25.0,
    "mode_hz": 179.0,
    "mode_zeta": 0.015,
    "mode_residue": 0.3,
    "sensor_lag_s": 1 / (2 * np.pi * 120),
}
DRY = {"coulomb_level": 3.0, "stribeck_extra": 2.0, "stribeck_velocity": 1.0}


def multisine(seed=1, rms=20.0, n=N):
    """(lines, command): odd lines to 194.5 Hz, falling below 2 Hz like nothing in particular."""
    lines = np.arange(1, 390, 2)
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * np.random.default_rng(seed).random(len(lines)))
    spectrum[lines[:2]] *= 4
    u = np.fft.irfft(spectrum, n)
    return lines, u * rms / np.std(u)


@pytest.mark.parametrize(
    "change",
    [{}, {"delay_s": 0.002}, {"motor_lag_s": 0.003}, {"motor_lag_s": 4e-6}, {"spring_stiffness": 0.0}],
)
def test_the_linear_axis_answers_as_in_closed_form(change):
    params = AXIS | change
    lines, u = multisine()
    y, *_ = truth.steady(params, u, tolerance=1e-8)
    measured = trials.amplitudes(y)[lines] / trials.amplitudes(u)[lines]
    exact = truth.linear_response(params, lines * 0.5)
    # Runge-Kutta at 48 kHz: (w h)^5 / 120 a step gives 3e-7 at the mode over its memory
    np.testing.assert_allclose(measured, exact, rtol=1e-6)


def test_closed_form_of_a_rate_integrator():
    """gain/s behind a hold, sampled: gain T / (z - 1), delayed by one sample."""
    params = {"fs_hz": 3000.0, "gain": 5.0, "delay_s": 1 / 3000, "viscous_rate": 1e-9}
    f_hz = np.array([1.0, 10.0, 300.0])
    z = np.exp(2j * np.pi * f_hz / 3000)
    # viscous_rate 1e-9 /s stands for none: 1e-10 of the answer at 1 Hz
    np.testing.assert_allclose(truth.linear_response(params, f_hz), 5 / 3000 / (z - 1) / z, rtol=1e-8)


def test_free_decay_stops_when_coulomb_friction_says():
    params = {"fs_hz": 3000.0, "gain": 1.0, "viscous_rate": 2.0, "coulomb_level": 30.0}
    x = np.zeros(len(truth.STATES))
    x[truth.STATES.index("rate")] = 10.0
    _, theta, rate, _ = truth.run(params, np.zeros(3000), x)
    t = np.arange(3000) / 3000
    moving = 15 * np.log(1 + 10 / 15) / 30  # ln(1 + 2 w0 / level) / 2
    expected = np.where(t < moving, 25 * np.exp(-2 * t) - 15, 0)
    np.testing.assert_allclose(rate, expected, atol=1e-10)
    assert np.all(rate[t > moving] == 0)
    np.testing.assert_allclose(theta[-1], 12.5 * (1 - np.exp(-2 * moving)) - 15 * moving, atol=1e-10)


def test_an_axis_at_rest_breaks_away_at_its_static_friction():
    params = {"fs_hz": 3000.0, "gain": 1.0, **DRY}
    below, above = truth.run(params, np.full(600, 4.999))[2], truth.run(params, np.full(600, 5.001))[2]
    assert np.all(below == 0)
    assert above[-1] > 0


def test_undamped_stop_gives_the_rate_back():
    """Free flight to the stop, half a sine in it, and back at the same rate."""
    k, angle, w0 = 4000.0, 1.0, 20.0
    params = {"fs_hz": 3000.0, "gain": 1.0, "stop_angle_deg": angle, "stop_stiffness": k}
    x = np.zeros(len(truth.STATES))
    x[truth.STATES.index("rate")] = w0
    _, theta, rate, _ = truth.run(params, np.zeros(450), x)
    t = np.arange(450) / 3000
    inside = (t - angle / w0) * np.sqrt(k)
    exact = np.where(inside < 0, w0, np.where(inside < np.pi, w0 * np.cos(inside), -w0))
    np.testing.assert_allclose(rate, exact, atol=1e-6)  # (w h)^5: 3e-15 a step, and a kink located to 1e-13
    assert theta.max() == pytest.approx(angle + w0 / np.sqrt(k), rel=1e-4)  # sampled beside the peak


def test_dahl_friction_follows_its_own_law_of_the_angle():
    """Between reversals z = s - (s - z0) exp(-stiffness |theta - theta0|)."""
    params = {"fs_hz": 3000.0, "gain": 1.0, "presliding_level": 3.0, "presliding_stiffness": 40.0}
    x = np.zeros(len(truth.STATES))
    x[truth.STATES.index("rate")] = 3.0
    _, _, rate, end = truth.run(params, np.zeros(60), x)
    assert np.all(rate > 0)
    bristle, angle = end[truth.STATES.index("bristle")], end[truth.STATES.index("theta")]
    assert bristle == pytest.approx(1 - np.exp(-40 * angle), rel=1e-8)  # order 4 at 3/s: 1e-9


THETA, RATE = np.meshgrid([-3.1, -0.7, 0.2, 2.9], [-20.0, -0.5, 0.3, 11.0])
LAWS = {
    "viscous": ({"viscous_rate": 2.0}, lambda t, w: 2 * w),
    "coulomb": ({"coulomb_level": 3.0}, lambda t, w: 3 * np.sign(w)),
    "stribeck": (DRY, lambda t, w: (3 + 2 * np.exp(-(w**2))) * np.sign(w)),
    "drag": ({"quadratic_drag_rate": 0.1}, lambda t, w: 0.1 * w * np.abs(w)),
    "spring": ({"spring_stiffness": 25.0}, lambda t, w: 25 * t),
    "cubic": ({"cubic_stiffness": 0.3}, lambda t, w: 0.3 * t**3),
    "unbalance": (
        {"unbalance_level": 50.0, "unbalance_angle_deg": 30.0},
        lambda t, w: 50 * (np.sin(np.deg2rad(t + 30)) - 0.5),
    ),
    "cogging": (
        {"cogging_level": 4.0, "cogging_cycles": 36.0, "cogging_phase_rad": 0.4},
        lambda t, w: 4 * np.sin(36 * np.deg2rad(t) + 0.4),
    ),
    "stop": (
        {"stop_angle_deg": 1.0, "stop_stiffness": 500.0},
        lambda t, w: 500 * (np.maximum(t - 1, 0) + np.minimum(t + 1, 0)),
    ),
    "bias": ({"bias_level": -2.0}, lambda t, w: -2 + 0 * t),
    "snap": (
        {"snap_level": 5.0, "snap_angle_deg": 0.1, "snap_width_deg": 0.3},
        lambda t, w: 5 * (t - 0.1) / 0.3 * np.exp((1 - ((t - 0.1) / 0.3) ** 2) / 2),
    ),
    "eddy": ({"eddy_rate": 0.2}, lambda t, w: 0.2 * 7 * w),
    "friction of angle": (
        {"coulomb_level": 3.0, "friction_ripple": 0.9, "friction_ripple_cycles": 60.0},
        lambda t, w: 3 * (1 + 0.9 * np.sin(60 * np.deg2rad(t))) * np.sign(w),
    ),
}


@pytest.mark.parametrize("law", LAWS)
def test_static_torque(law):
    params, formula = LAWS[law]
    for theta, rate in zip(THETA.ravel(), RATE.ravel(), strict=True):
        expected = formula(theta, rate)
        assert truth.torque(params, theta, rate, actuator=-7.0) == pytest.approx(
            expected, rel=1e-12, abs=1e-12
        )


def test_command_maps():
    u = multisine()[1]
    np.testing.assert_allclose(
        truth.command({"quantization_step": 0.3}, u), 0.3 * np.round(u / 0.3), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(
        truth.command({"dead_zone_half_width": 2.0}, u), u - np.clip(u, -2, 2), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_array_equal(truth.command({"saturation_limit": 15.0}, u), np.clip(u, -15, 15))
    slow = truth.command({"command_rate_limit": 3.0}, u)
    assert np.abs(np.diff(slow, append=slow[0])).max() <= 3.0 + 1e-12
    assert np.any(slow != u)


@pytest.mark.parametrize(
    "extra",
    [
        {"coulomb_level": 3.0},
        {"coulomb_level": 40.0},
        DRY,
        {"presliding_level": 3.0, "presliding_stiffness": 60.0},
        {"creep_stiffness": 10.0, "creep_time_s": 0.5},
        {"stop_angle_deg": 1.5, "stop_stiffness": 400.0},
        {"gear_stiffness": 7e5, "gear_inertia_ratio": 0.3, "gear_damping": 80.0, "gear_gap_deg": 0.01},
        {"cogging_level": 5.0, "cogging_cycles": 60.0},
    ],
    ids=lambda extra: next(iter(extra)),
)
def test_energy_and_steady_state(extra):
    """Over a steady period the motor's work is what is dissipated; the next period is the same."""
    params = AXIS | extra
    u = multisine()[1]
    tolerance = 5e-6  # of trials: 1e-4 of the noise
    y, _, _, start = truth.steady(params, u, tolerance=tolerance)
    again, _, _, end = truth.run(params, u, start.x, n_periods=2)
    assert np.sqrt(np.mean((again - y) ** 2)) < 10 * tolerance
    work, dissipated = end[truth.STATES.index("work")], end[truth.STATES.index("dissipated")]
    assert work == pytest.approx(dissipated, rel=1e-5)  # stored energy moves by rate times tolerance


def test_sample_hold_repeats_the_last_sample():
    u = multisine()[1]
    y, *_ = truth.steady(AXIS, u, tolerance=1e-7)
    held, *_ = truth.steady(AXIS | {"sample_hold_hz": 1000.0}, u, tolerance=1e-7)
    np.testing.assert_allclose(held, np.repeat(y[::3], 3), atol=1e-6)


@pytest.mark.parametrize("unlisted", trials._UNLISTED)
def test_noise_is_as_large_and_as_coloured_as_it_says(unlisted):
    noise = trials.Noise(0.05, 0.4, 20.0, unlisted, 0.02, 0.1, None)
    rng = np.random.default_rng(3)
    y = 10 * np.sin(2 * np.pi * np.arange(N) / N * 7)
    samples = noise.random(rng, y, 40)
    expected = np.hypot(0.05, trials.UNLISTED * np.std(y))
    assert np.std(samples) == pytest.approx(
        expected, rel=0.05
    )  # low noise: about 40 x 2 s x 60 Hz free values
    variance = noise.variance(rng, y)
    total = np.sum(variance[1:-1]) / 2  # mean squares of the lines, DC apart
    assert total == pytest.approx(expected**2 + 0.02**2 / 12, rel=0.05)


def test_colour_of_low_passed_noise():
    samples = trials.low_passed(np.random.default_rng(4), 600_000, 30.0)
    f_hz, density = welch(samples, 3000.0, nperseg=6000)
    exact = 2 / (np.pi * 30) / (1 + (f_hz / 30) ** 2)
    band = (f_hz > 1) & (f_hz < 300)  # higher up the sampled filter is not the continuous one
    np.testing.assert_allclose(np.mean(density[band] / exact[band]), 1, atol=0.03)


def test_gyro_word():
    noise = trials.Noise(0.05, 0.2, 20.0, "spikes", 0.02, 0.1, (30.9, 0.05))
    y = noise.measured(np.random.default_rng(5), np.zeros(N) + np.sin(np.arange(N)), 2)
    np.testing.assert_allclose(y / 0.02, np.rint(y / 0.02), atol=1e-9)


def test_predicted_drop_is_the_noncentrality_of_the_likelihood_ratio():
    """The mean over noise seeds, from the refitted null to the truth, is it less the null's parameters."""
    rng = np.random.default_rng(6)
    base = trials.draw_base(rng, "viscous_friction")
    lines, commands = trials.draw_commands(rng, base, 1)
    s2 = np.full((2, N // 2 + 1), 1e-6)
    hidden = base | {"viscous_rate": 0.02}
    answers = [truth.steady(hidden, u, tolerance=1e-8)[0] for u in commands]
    predicted = trials.Nulls(base, lines, commands, s2, 8).refit(answers)[0]
    assert predicted > 100
    exact = [trials.amplitudes(y) for y in answers]
    drops = []
    for _ in range(50):
        noisy, left = [], 0.0
        for spectrum in exact:
            error = np.zeros(N // 2 + 1, complex)
            error[1:401] = (rng.standard_normal((2, 400)).T @ [1, 1j]) * np.sqrt(1e-6 / 8 / 2)
            noisy.append(np.fft.irfft((spectrum + error) * N / 2, N))
            left += np.sum(2 * 8 / 1e-6 * np.abs(error) ** 2)
        drops.append(trials.Nulls(base, lines, commands, s2, 8).refit(noisy)[0] - left)
    n_null = len(base) - 1
    # One drop scatters by 2 sqrt(predicted); 4 standard errors of the mean of 50.
    assert np.mean(drops) == pytest.approx(predicted - n_null, abs=4 * 2 * np.sqrt(predicted / 50))


@pytest.mark.long
def test_trials_are_what_they_are_drawn_to_be(tmp_path):
    """Same seed, same trial; travel and drop as drawn; the model off by 5 %; the product reads the files."""
    from gsid.records.files import read_record

    trial, again = (trials.make_trial(2, 3, {"single": 1}) for _ in range(2))
    assert trials.seal(trial.key, 2) == trials.seal(again.key, 2)
    np.testing.assert_array_equal(trial.fit[0][1], again.fit[0][1])
    for (u, _), level in zip(trial.fit, (6, 6, 20, 20), strict=True):
        assert np.std(u) == pytest.approx(level, rel=1e-6)
    truths = trial.key["truth"]
    for effect in trial.model["effects"]:
        for name, param in effect["params"].items():
            right = truths[trials.CATALOGUE[effect["effect"]][name]]
            assert abs(param["value"] / right - 1) == pytest.approx(0.05)
    place = trials.write_trial(trial, tmp_path)
    record = read_record(place / "fit_0.npz")
    assert (record.fs_hz, record.period_samples, record.settle_samples, record.hold) == (3000, N, 0, "zoh")
    np.testing.assert_array_equal(record.y, trial.fit[0][1])


def test_travel():
    rng = np.random.default_rng(8)
    base = trials.draw_base(rng, None)
    _, commands = trials.draw_commands(rng, base, 2)
    peaks = [np.abs(truth.steady(base, u, tolerance=1e-5, n_steps=truth.COARSE)[1]).max() for u in commands]
    assert max(peaks[:2]) < 1.2
    assert 1.5 < max(peaks[2:]) < 3.7
