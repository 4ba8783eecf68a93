"""Other forms of a model, against its own response and scipy's."""

import numpy as np
import pytest
from scipy import signal
from scipy.io import loadmat

from gsid.models.convert import from_zpk, sampled, save_mat, to_state_space, to_zpk
from gsid.models.rational import RationalModel

F = np.linspace(1.0, 1200.0, 50)
PLANT = RationalModel([3.0, 40.0, 900.0], [1.0, 30.0, 2000.0, 5000.0], 0.0042)
DISCRETE = RationalModel([0.0, 0.02, 0.01], [1.0, -1.8, 0.83], 0.0, "z", 3000.0)


@pytest.mark.parametrize("model", [PLANT, DISCRETE])
def test_zeros_poles_and_gain_there_and_back(model):
    again = from_zpk(*to_zpk(model), model.delay_s, fs_hz=model.fs_hz if model.domain == "z" else None)
    np.testing.assert_allclose(again.response(F), model.response(F), rtol=1e-9)


@pytest.mark.parametrize("model", [PLANT, DISCRETE])
def test_state_space_answers_the_same(model):
    a, b, c, d = to_state_space(model)
    at = np.exp(2j * np.pi * F / 3000.0) if model.domain == "z" else 2j * np.pi * F
    g = np.array([(c @ np.linalg.solve(x * np.eye(len(a)) - a, b) + d)[0, 0] for x in at])
    np.testing.assert_allclose(g * np.exp(-2j * np.pi * F * model.delay_s), model.response(F), rtol=1e-8)


@pytest.mark.parametrize("delay_s", [0.0, 0.4 / 3000, 1.0 / 3000, 0.0042])
@pytest.mark.parametrize("num", [[3.0, 40.0, 900.0], [0.5, 3.0, 40.0, 900.0]])
def test_sampled_with_the_hold(num, delay_s):
    """The matrix exponential in C gives the same response (MOD-2), scipy the same model without delay."""
    held = RationalModel(num, PLANT.den, delay_s, fs_hz=3000.0, hold="zoh")
    model = sampled(held, 3000.0)
    assert model.domain == "z"
    np.testing.assert_allclose(model.response(F), held.response(F), rtol=1e-7)
    if delay_s == 0 and len(num) == 3:
        expected, den, _ = signal.cont2discrete((num, PLANT.den), 1 / 3000.0)
        np.testing.assert_allclose(model.den, den, rtol=1e-10)
        np.testing.assert_allclose(model.num, expected[0], atol=1e-12)


def test_mat_file(tmp_path):
    save_mat(PLANT, tmp_path / "m.mat")
    read = loadmat(tmp_path / "m.mat")
    np.testing.assert_allclose(read["den"].ravel(), PLANT.den)
    np.testing.assert_allclose(np.sort_complex(read["poles"].ravel()), np.sort_complex(np.roots(PLANT.den)))
    assert read["A"].shape == (3, 3)
    assert read["delay_s"].item() == PLANT.delay_s


def test_misuse():
    with pytest.raises(ValueError, match="continuous"):
        sampled(DISCRETE, 3000.0)
    with pytest.raises(ValueError, match="conjugate"):
        from_zpk([1j], [-1.0, -2.0], 1.0)
    with pytest.raises(ValueError, match="at most"):
        from_zpk([0.1, 0.2], [0.5], 1.0, fs_hz=10.0)
    with pytest.raises(ValueError, match="zeros than poles"):
        to_state_space(RationalModel([1.0, 0.0, 0.0], [1.0, 2.0]))
