"""Bouc-Wen's hysteresis, against its usual equations integrated by scipy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gsid
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.effects.types import catalogue
from gsid.greybox.fit import fit_plant

pytestmark = pytest.mark.xdist_group("bouc_wen")  # the module's fixture is made once
FS_HZ, N, SETTLE = 500.0, 250, 10
GAIN, RATE, STIFFNESS = 500.0, 25.0, 13000.0
# z' = ALPHA w - BETA (GAMMA |w| z + DELTA w |z|)
ALPHA, BETA, GAMMA, DELTA = 2000.0, 1.5, 0.8, -1.1
LAW = {"stiffness": ALPHA, "unloading": BETA * (GAMMA - DELTA), "loading": BETA * (GAMMA + DELTA)}


def model(**effects):
    known = {
        "rigid_body": {"gain": GAIN},
        "viscous_friction": {"rate": RATE},
        "cable_spring": {"stiffness": STIFFNESS},
    }
    stack = [{"effect": name, "params": params} for name, params in (known | effects).items()]
    return gsid.PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": stack})


def command(seed, amplitude=30.0):
    return (
        gsid.Multisine.design(FS_HZ, N, (2, 60), grid="odd", phases="random", seed=seed).table() * amplitude
    )


def integrated(u):
    """Rate and z at the samples of one settled period."""

    def slope(_, x, now):
        angle, w, z = x
        against = RATE * w + STIFFNESS * angle + z
        return [w, GAIN * now - against, ALPHA * w - BETA * (GAMMA * abs(w) * z + DELTA * w * abs(z))]

    x, found = np.zeros(3), np.empty((len(u), 3))
    for _ in range(SETTLE):
        for n, now in enumerate(u):
            found[n] = x
            x = solve_ivp(slope, (0, 1 / FS_HZ), x, "DOP853", args=(now,), rtol=1e-9, atol=1e-9).y[:, -1]
    return found[:, 1], found[:, 2]


@pytest.fixture(scope="module")
def settled():
    return [(u, *integrated(u)) for u in (command(seed) for seed in range(2))]


def records(settled, noise):
    """The integrated axis with white noise, a share of the output's rms."""
    found, rng = [], np.random.default_rng(3)
    for u, y, _ in settled:
        noisy = np.tile(y, 8) + noise * np.std(y) * rng.standard_normal(8 * N)
        found.append(gsid.Record(np.tile(u, 8), noisy, FS_HZ, N, 0, hold="zoh", y_unit="deg/s"))
    return found


def test_the_simulation_is_the_integrated_equation(settled):
    u, y, z = settled[0]
    assert np.ptp(z) > 3 * ALPHA / LAW["unloading"]  # the law is far from a spring
    answer = model(bouc_wen=LAW).simulate(u)
    np.testing.assert_allclose(answer.y, y, atol=2e-4 * np.max(np.abs(y)))


def test_equal_rates_are_dahls_law():
    u, stiffness = command(0), 2.0
    same = {"stiffness": 2500.0 * stiffness, "unloading": stiffness, "loading": stiffness}
    y = model(presliding_friction={"level": 2500.0, "stiffness": stiffness}).simulate(u).y
    np.testing.assert_allclose(model(bouc_wen=same).simulate(u).y, y, atol=1e-9 * np.max(np.abs(y)))


def test_a_fit_finds_its_values(settled):
    off = {name: value * factor for (name, value), factor in zip(LAW.items(), (1.1, 0.9, 1.2), strict=True)}
    found = fit_plant(model(bouc_wen=off), records(settled, 0.01))
    assert found.cost_per_dof == pytest.approx(1, abs=0.15)
    for name, value in LAW.items():
        fitted = found.model[f"bouc_wen.{name}"]
        assert abs(fitted.value - value) < 4 * fitted.std, name
        assert fitted.std < 0.2 * abs(value), name


def test_the_first_stage_names_it(settled):
    found = first_stage(records(settled, 0.05), model())
    print(found, found.ranking[0].params)
    assert (found.conclusion.kind, found.conclusion.effects) == ("named", ("bouc_wen",))
    params = found.ranking[0].params
    # Stiffness and rates trade against the linear spring: for values see the hysteretic benchmark.
    assert params["loading"] < 0 < params["unloading"]


def test_it_is_in_the_catalogue_with_its_units():
    known = catalogue()["bouc_wen"]
    assert [p.unit for p in known.parameters] == ["1/s^2", "1/deg", "1/deg"]
    assert known["loading"].lower < 0 < known["unloading"].lower
    assert known.simpler == "presliding_friction"
