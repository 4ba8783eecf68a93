"""The missing torque: the law of a hidden friction as a curve, and bars that noise keeps to."""

import numpy as np
import pytest
from plants import FS_HZ, axis_period, plant

from gsid import plots
from gsid.diagnosis.torque_residual import torque_residual
from gsid.excitation.multisine import Multisine
from gsid.spectrum.lines import lines_of
from gsid.spectrum.spectra import Spectra

SEED = 20260306
N, BAND, NOISE, PERIODS = 1500, (2.0, 100.0), 0.02, 6
AXIS = {"gain": 7.4, "viscous_rate": 11.0, "spring_stiffness": 170.0, "delay_s": 0.0054}
LEVEL = 0.5  # of the friction [deg/s^2]: small, so that the path is that of the model without it
STACK = {
    "rigid_body": {"gain": 7.4},
    "viscous_friction": {"rate": 11.0},
    "cable_spring": {"stiffness": 170.0},
    "transport_delay": {"delay_s": 0.0054},
}


def measured(rng, coulomb_level, *, seed=SEED, noise=NOISE):
    u = Multisine.design(FS_HZ, N, BAND, phases="random", seed=seed, amplitude=6.0).table()
    y = axis_period(u, coulomb_level=coulomb_level, **AXIS)
    Y = lines_of(np.tile(y, (PERIODS, 1)) + noise * rng.standard_normal((PERIODS, N)))
    U = lines_of(np.tile(u, (PERIODS, 1)))
    excited = np.abs(U[0]) > 0.1
    return Spectra(FS_HZ, N, np.arange(N // 2 + 1), U, Y, 0, 0, excited, "zoh", "command", "deg/s", "r")


def test_a_hidden_friction_shows_against_the_rate():
    rng = np.random.default_rng(SEED)
    records = [measured(rng, LEVEL, seed=SEED + i, noise=1e-3) for i in range(2)]
    residual = torque_residual(plant(STACK), records)
    assert residual.rate.explained > 0.5
    assert residual.rate.explained > 3 * max(residual.angle.explained, residual.command.explained)
    moving = (np.abs(residual.rate.at) > 1) & (residual.rate.share > 0.01)
    # Lines above the band are missing, and the path is only nearly the axis's own.
    law = -LEVEL * np.sign(residual.rate.at[moving])
    np.testing.assert_allclose(residual.rate.torque[moving], law, atol=0.2 * LEVEL)
    assert (residual.rate.unit, residual.angle.unit, residual.command.unit) == ("deg/s", "deg", "command")
    assert "rate" in repr(residual)


def test_noise_keeps_to_the_bars():
    """Over 200 right models, each bin's torque over its standard deviation has variance 1."""
    rng = np.random.default_rng(SEED)
    first = measured(rng, 0.0)
    clean = first.Y.mean(axis=0)
    clean[1:-1] = plant(STACK).predict(first).Y[1:-1]
    ratios = []
    for _ in range(200):
        first.Y = clean + lines_of(NOISE * rng.standard_normal((PERIODS, N)))
        curves = torque_residual(plant(STACK), first).curves
        ratios.append(np.concatenate([curve.torque / curve.std for curve in curves]))
    # Pooled variances of 20 degrees of freedom and more scatter a little; 0.4 is 4 sigma of 200 draws.
    np.testing.assert_allclose(np.var(ratios, axis=0), 1, atol=0.45)
    assert np.mean(np.square(ratios)) == pytest.approx(1, abs=0.1)


def test_picture():
    residual = torque_residual(plant(STACK), measured(np.random.default_rng(SEED), 5.0))
    words = " ".join(
        t.get_text() for t in plots.torque_residual(residual).findobj(lambda a: hasattr(a, "get_text"))
    )
    for part in ("rate [deg/s]", "angle [deg]", "command", "time [s]", "torque / inertia [deg/s²]"):
        assert part in words
    assert "[command]" not in words


def test_no_record():
    with pytest.raises(ValueError, match="no record"):
        torque_residual(plant(STACK), [])
