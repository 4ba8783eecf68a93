"""The quadratic spring, against a closed form and an integration that shares no code with the plant."""

import numpy as np
import pytest

import gsid

FS_HZ, N = 3000.0, 1500
GAIN, RATE, STIFFNESS, QUADRATIC = 900.0, 12.0, 400.0, 60.0


def model(**effects):
    known = {
        "rigid_body": {"gain": GAIN},
        "viscous_friction": {"rate": RATE},
        "cable_spring": {"stiffness": STIFFNESS},
    }
    stack = [{"effect": name, "params": params} for name, params in (known | effects).items()]
    return gsid.PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": stack})


def test_its_second_harmonic_and_mean_are_the_closed_form():
    """To first order in k: a motion A cos(w t) makes the torque k A^2 / 2 (1 + cos(2 w t))."""
    line, k = 3, 1e-3
    w = 2 * np.pi * line * FS_HZ / N
    s = np.array([1j * w, 2j * w])
    to_angle = 1 / (s**2 + RATE * s + STIFFNESS)
    hold = (1 - np.exp(-s[0] / FS_HZ)) / (s[0] / FS_HZ)
    angle = 0.05 * GAIN * hold * to_angle[0]
    answer = model(quadratic_spring={"stiffness": k}).simulate(
        0.05 * np.cos(2 * np.pi * line * np.arange(N) / N)
    )
    second = -s[1] * to_angle[1] * k * angle**2 / 2
    np.testing.assert_allclose(answer.Y[2 * line], second, rtol=1e-3)
    assert np.mean(answer.angle) == pytest.approx(-k * abs(angle) ** 2 / 2 / STIFFNESS, rel=1e-3)


def integrated(u, settle=12, substeps=2):
    """Rate at the samples of one settled period: Runge and Kutta's method, and no line of the library."""

    def slope(angle, rate, now):
        return GAIN * now - RATE * rate - STIFFNESS * angle - QUADRATIC * angle**2

    h, angle, rate, y = 1 / FS_HZ / substeps, 0.0, 0.0, np.empty(len(u))
    for _ in range(settle + 1):
        for n, now in enumerate(u.tolist()):
            y[n] = rate
            for _ in range(substeps):
                k1, l1 = rate, slope(angle, rate, now)
                k2, l2 = rate + h / 2 * l1, slope(angle + h / 2 * k1, rate + h / 2 * l1, now)
                k3, l3 = rate + h / 2 * l2, slope(angle + h / 2 * k2, rate + h / 2 * l2, now)
                k4, l4 = rate + h * l3, slope(angle + h * k3, rate + h * l3, now)
                angle += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                rate += h / 6 * (l1 + 2 * l2 + 2 * l3 + l4)
    return y


@pytest.fixture(scope="module")
def records():
    """Two realisations of the integrated axis with white noise, and one that is kept out of the fit."""
    found = []
    for seed in range(3):
        u = gsid.Multisine.design(
            FS_HZ, N, (2, 100), grid="odd", phases="random", seed=seed, amplitude=0.15
        ).table()
        y, rng = np.tile(integrated(u), 6), np.random.default_rng(seed)
        y += 0.05 * rng.standard_normal(len(y))
        found.append(gsid.Record(np.tile(u, 6), y, FS_HZ, N, 0, hold="zoh", y_unit="deg/s"))
    return found


def test_it_is_added_and_found(records):
    added = gsid.add("quadratic_spring", model(), records[:2], held_out=records[2:])
    stiffness = added.model["quadratic_spring.stiffness"]
    assert abs(stiffness.value - QUADRATIC) < 4 * stiffness.std
    assert stiffness.std < 0.05 * QUADRATIC
    found = added.to_dict()
    assert found["before"]["cost_per_dof"] > 3
    assert found["after"]["cost_per_dof"] == pytest.approx(1, abs=0.15)


def test_the_class_the_json_and_the_exported_code_know_it():
    from gsid.effects.types import catalogue

    known = catalogue()["quadratic_spring"]
    assert known["stiffness"].unit == "1/(s^2 deg)"
    assert known.to_dict()["law"] == "stiffness theta^2"
    assert known.not_searched
    assert "measured without it" in repr(known)
