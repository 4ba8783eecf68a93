"""A sensor that is sampled and held: detected without a model, removed before the structure is found."""

import axes
import numpy as np
import pytest
import truth

import gsid
from gsid.response.sample_hold import held_output, held_rate, held_response, mean_outputs

SEED = 20261126


def drawn(*seed, coulomb=0.0):
    print("seed", SEED, *seed)
    rng = np.random.default_rng([SEED, *seed])
    return axes.drawn(rng, coulomb), rng


def record(axis, rng):
    u, y = axes.measured(axis, rng)
    return gsid.Record(u, y, axes.FS_HZ, axes.N, 0, hold="zoh")


def elements(axis):
    """Effects that the axis has."""
    names = {"rigid_body", "viscous_friction", "transport_delay"}
    names |= {"sensor_sample_hold"} if axis.refresh_samples > 1 else set()
    names |= {"cable_spring"} if axis.stiffness else set()
    names |= {"sensor_lag"} if axis.lag_s else set()
    return names | {"flexible_mode" if i == 0 else f"flexible_mode#{i + 1}" for i in range(len(axis.modes))}


@pytest.mark.parametrize("refresh_samples", [4, 6, 8, 10])
def test_structure_and_delay_behind_a_held_sensor(refresh_samples):
    """At 8 and 10 samples (375 and 300 Hz) images of some lines fall on other lines."""
    axis, rng = drawn(refresh_samples)
    axis.refresh_samples = refresh_samples
    found = gsid.start(record(axis, rng))
    assert found.sensor_rate_hz == pytest.approx(axes.FS_HZ / refresh_samples)
    assert set(found.effects) == elements(axis)
    delay_s, std_s = (of["transport_delay"]["delay_s"] for of in (found.effects, found.std))
    assert abs(delay_s - axis.delay_s) < 5 * std_s
    f_hz = [params["f_hz"] for effect, params in found.effects.items() if effect.startswith("flexible")]
    assert f_hz == pytest.approx([f for f, _, _ in axis.modes], rel=5e-3)


def test_friction_beside_a_held_sensor():
    axis, rng = drawn(20, coulomb=0.05)
    axis.refresh_samples = 5
    found = gsid.start(record(axis, rng))
    assert found.sensor_rate_hz == pytest.approx(600.0)
    assert set(found.effects) == elements(axis)


def test_bug_the_second_harmonic_was_taken_as_the_rate():
    """Around 300 Hz few images are above the lines of 0.5 to 250 Hz, around 600 Hz all are."""
    for seed in range(3):
        axis, rng = drawn(30, seed)
        axis.refresh_samples = 10
        assert held_rate(mean_outputs(record(axis, rng))) == pytest.approx(300.0)


def test_a_sensor_that_is_refreshed_between_samples():
    """400 Hz at 3000 samples a second, by the simulator's own sensor."""
    axis, rng = drawn(40)
    axis.modes, axis.lag_s = [], 0.0
    u = axes.command(rng)
    y, *_ = truth.steady(axis.params() | {"sample_hold_hz": 400.0}, u, tolerance=1e-5, n_steps=8)
    y = np.tile(y, 6) + 1e-2 * np.std(y) * rng.standard_normal(6 * axes.N)
    found = gsid.start(gsid.Record(np.tile(u, 6), y, axes.FS_HZ, axes.N, 0, hold="zoh"))
    assert found.sensor_rate_hz == pytest.approx(400.0)
    assert set(found.effects) == elements(axis) | {"sensor_sample_hold"}
    assert found.effects["transport_delay"]["delay_s"] == pytest.approx(axis.delay_s, abs=5e-5)


@pytest.mark.parametrize("coulomb", [0.0, 0.05, 0.2])
def test_no_held_sensor_is_detected_without_one(coulomb):
    for seed in range(4):
        axis, rng = drawn(50, seed, coulomb=coulomb)
        assert held_rate(mean_outputs(record(axis, rng))) is None


@pytest.mark.parametrize("seed", range(4))
def test_bug_harmonics_of_a_hysteresis_were_taken_for_images(seed):
    """They are as large as those of a sensor at 888 to 940 Hz, but of other phases."""
    law = {"stiffness": 2000.0, "unloading": 2.85, "loading": -0.45}
    axis = {
        "rigid_body": {"gain": 500.0},
        "viscous_friction": {"rate": 25.0},
        "cable_spring": {"stiffness": 13000.0},
    }
    stack = [{"effect": name, "params": params} for name, params in (axis | {"bouc_wen": law}).items()]
    model = gsid.PlantModel.from_dict({"gsid_model": 1, "fs_hz": 1000.0, "effects": stack})
    design = gsid.Multisine.design(1000.0, 500, (2, 60), grid="odd", phases="random", seed=seed)
    u = design.table() * 30
    y = np.tile(model.simulate(u).y, 8)
    y += 1e-3 * np.std(y) * np.random.default_rng(seed).standard_normal(len(y))
    assert held_rate(mean_outputs(gsid.Record(np.tile(u, 8), y, 1000.0, 500, 0, hold="zoh"))) is None


def test_the_model_and_the_response_have_the_held_sensor():
    axis, rng = drawn(60)
    axis.refresh_samples = 5
    found = gsid.start(record(axis, rng))
    model = found.model()
    assert model["sensor_sample_hold.rate_hz"].value == pytest.approx(600.0)
    assert "sensor_sample_hold.rate_hz" not in model.free_names
    assert found.to_dict()["sensor_rate_hz"] == pytest.approx(600.0)
    assert any("600 times a second" in text for text in found.assumed)
    error = np.abs(found.response(found.measured.f_hz) - found.measured.g) ** 2 / found.measured.var_total
    assert np.mean(error) == pytest.approx(found.cost_per_line, rel=1e-3)


@pytest.mark.parametrize(("n", "rate_hz"), [(3000, 375.0), (3000, 400.0), (3001, 600.0), (2999, 412.3)])
def test_held_output_is_the_signal_at_the_refreshes(n, rate_hz):
    """Against a sum of sines; the last rate does not repeat with the period."""
    rng = np.random.default_rng(SEED)
    y = rng.standard_normal(n // 2 + 1) + 1j * rng.standard_normal(n // 2 + 1)
    y[0] = y[0].real
    if n % 2 == 0:
        y[-1] = y[-1].real
    line = np.arange(-((n - 1) // 2), n // 2 + 1)
    refresh = np.floor(np.arange(n) * rate_hz / axes.FS_HZ + 1e-9) * axes.FS_HZ / rate_hz  # samples
    both_sides = np.where(line < 0, np.conj(y[np.abs(line)]), y[np.abs(line)])
    expected = np.fft.rfft((np.exp(2j * np.pi / n * np.outer(refresh, line)) @ both_sides).real / n)
    held = held_output(y, rate_hz, axes.FS_HZ, n)
    assert held == pytest.approx(expected, abs=1e-8)  # of lines about 1, rounding in a transform of n


def test_the_direct_response_of_a_held_sensor_is_that_of_its_output():
    n, line, rate_hz = axes.N, 101, 400.0
    y = np.zeros(n // 2 + 1, complex)
    y[line] = n / 2 * np.exp(0.3j)
    direct = held_response(np.array([line * axes.FS_HZ / n]), rate_hz, axes.FS_HZ, n)
    assert held_output(y, rate_hz, axes.FS_HZ, n)[line] / y[line] == pytest.approx(direct[0], abs=1e-4)
