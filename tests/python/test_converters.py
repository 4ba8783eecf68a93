"""Objects of python-control, scipy.signal and pandas, in and out: same responses, the delay kept apart."""

import subprocess
import sys

import control
import numpy as np
import pytest
from scipy import signal

from gsid import RationalModel

F_HZ = np.geomspace(0.1, 200, 30)
NUM, DEN, DELAY_S = [3.0, 2e3], [1.0, 40.0, 9e4, 1e5], 0.0051
CONTINUOUS = RationalModel(NUM, DEN, DELAY_S)
DISCRETE = RationalModel([0.0, 0.2, 0.1], [1.0, -1.6, 0.7], 2e-3, "z", 1000.0)


def without_delay(model):
    return model.response(F_HZ) * np.exp(2j * np.pi * F_HZ * model.delay_s)


def test_control_and_scipy_lack_the_delay_of_a_continuous_model():
    own = without_delay(CONTINUOUS)
    np.testing.assert_allclose(CONTINUOUS.to_control()(2j * np.pi * F_HZ), own, rtol=1e-9)
    np.testing.assert_allclose(CONTINUOUS.to_scipy().freqresp(2 * np.pi * F_HZ)[1], own, rtol=1e-9)


def test_pade_only_on_request():
    low = F_HZ[F_HZ < 100]
    approximate = CONTINUOUS.to_control(pade_order=6)(2j * np.pi * low)
    np.testing.assert_allclose(approximate, CONTINUOUS.response(low), rtol=2e-3)
    assert len(CONTINUOUS.to_control().poles()) == len(DEN) - 1
    assert len(CONTINUOUS.to_control(pade_order=6).poles()) == len(DEN) - 1 + 6


def test_a_discrete_model_has_its_delay_in_control_and_scipy():
    own, z = DISCRETE.response(F_HZ), np.exp(2j * np.pi * F_HZ / 1000)
    np.testing.assert_allclose(DISCRETE.to_control()(z), own, rtol=1e-9)
    assert DISCRETE.to_scipy().dt == 1e-3
    np.testing.assert_allclose(DISCRETE.to_scipy().freqresp(2 * np.pi * F_HZ / 1000)[1], own, rtol=1e-9)


@pytest.mark.parametrize("model", [CONTINUOUS, DISCRETE], ids=["s", "z"])
@pytest.mark.parametrize("form", ["to_tf", "to_zpk", "to_ss"])
def test_every_form_of_scipy_comes_back(model, form):
    system = model.to_scipy()
    system = system if form == "to_tf" else getattr(system, form)()
    back = RationalModel.from_scipy(system, model.delay_s if model.domain == "s" else 0.0)
    assert back.domain == model.domain
    np.testing.assert_allclose(back.response(F_HZ), model.response(F_HZ), rtol=1e-6)


@pytest.mark.parametrize("model", [CONTINUOUS, DISCRETE], ids=["s", "z"])
def test_a_state_space_of_control_comes_back(model):
    a, b, c, d = signal.tf2ss(model.to_control().num[0][0], model.to_control().den[0][0])
    system = control.ss(a, b, c, d, *([1 / model.fs_hz] if model.domain == "z" else []))
    back = RationalModel.from_control(system, model.delay_s if model.domain == "s" else 0.0)
    np.testing.assert_allclose(back.response(F_HZ), model.response(F_HZ), rtol=1e-6)


@pytest.mark.parametrize(
    "system", [signal.dlti([1.0], [1.0, 0.5]), signal.StateSpace(*np.ones((3, 2, 2)), np.ones((2, 2)))]
)
def test_what_a_model_cannot_hold_is_refused(system):
    with pytest.raises(ValueError, match=r"sample time|one input"):
        RationalModel.from_scipy(system)


def test_gsid_is_imported_without_them():
    code = "import gsid, sys; print({'control', 'pandas', 'scipy.signal'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"
