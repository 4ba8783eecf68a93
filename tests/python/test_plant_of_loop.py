"""The plant behind a known controller, and unstable plants."""

import json

import numpy as np
import pytest

from gsid.cli.main import main
from gsid.excitation.multisine import Multisine
from gsid.models.rational import RationalModel
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.response.closed_loop import closed_loop_frf, plant_of_loop
from gsid.response.estimate import frf

FS_HZ, N = 500.0, 500
POLE, GAIN, KP = 1.02, 0.1, 1.5  # y[n] = 1.02 y[n-1] + 0.1 u[n-1] is unstable; u = 1.5 (r - y) stabilises it


def true_plant(f_hz):
    z = np.exp(-2j * np.pi * f_hz / FS_HZ)
    return GAIN * z / (1 - POLE * z)


def loop(seed, noise=0.02, n_periods=10):
    """The closed loop, sample by sample, with noise on the output."""
    rng = np.random.default_rng(seed)
    r = np.tile(Multisine.design(FS_HZ, N, (2, 100), phases="random", seed=3).table(), n_periods + 2)
    y, u, state, last = np.zeros(len(r)), np.zeros(len(r)), 0.0, 0.0
    for n in range(len(r)):
        state = POLE * state + GAIN * last
        y[n] = state + noise * rng.standard_normal()
        last = u[n] = KP * (r[n] - y[n])
    return r, u, y


def records(seed, **options):
    r, u, y = loop(seed, **options)
    through = Record(u, y, FS_HZ, N, 2 * N, hold="none", columns={"r": r})
    return Record(r, y, FS_HZ, N, 2 * N, hold="none"), through


def test_the_plant_behind_a_known_controller_is_that_of_the_other_route():
    behind, through = records(1)
    t = frf(behind)
    direct = plant_of_loop(t, np.full(len(t.g), KP))
    other = closed_loop_frf(through, "r")
    np.testing.assert_allclose(direct.g, other.g, rtol=1e-6)
    np.testing.assert_allclose(direct.var_g, other.var_g, rtol=0.2)


def test_its_variance_is_the_scatter():
    ratio = []
    for seed in range(60):
        t = frf(records(seed)[0])
        plant = plant_of_loop(t, np.full(len(t.g), KP))
        ratio.append(np.mean(np.abs(plant.g - true_plant(plant.f_hz)) ** 2 / plant.var_g))
    # |error|^2 over its sample variance of 9 degrees of freedom: 9/8 on average
    assert np.mean(ratio) == pytest.approx(9 / 8, abs=0.1)


def test_an_unstable_plant_is_fitted_if_it_is_allowed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_record("loop.csv", records(2)[0])
    RationalModel([KP], [1.0], fs_hz=FS_HZ).save("c.json")
    assert main(["frf", "loop.csv", "--controller", "c.json", "-o", "plant.csv"]) == 0
    capsys.readouterr()
    fit = ["fit", "plant.csv", "--order", "1/0", "--domain", "z", "--delay", "0.002", "--json"]
    assert main([*fit, "--allow-unstable"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["stable"] is False
    assert values["poles"][0][0] == pytest.approx(POLE, abs=3e-3)


def test_a_controller_that_does_not_fit_is_refused():
    t = frf(records(1)[0])
    with pytest.raises(ValueError, match="the controller has"):
        plant_of_loop(t, [1.0])
    with pytest.raises(ValueError, match="do not determine"):
        plant_of_loop(t, np.zeros(len(t.g)))
