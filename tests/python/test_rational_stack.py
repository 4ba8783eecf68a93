"""Laws on a rational response: y = G (u - torque / gain), against an integration of the same equations."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import tf2ss

import gsid
from gsid.base.errors import InputError
from gsid.models.load import load_model, load_plant
from gsid.models.rational import RationalModel
from gsid.models.rational_stack import stack_of
from gsid.plant.linear_response import linear_view

FS_HZ, N = 1000.0, 400
DELAY_S = 0.0023
F_HZ = np.arange(1.0, 150.0)
CASES = {  # poles, zeros [rad/s], output
    "complex zeros": ([-20, -9 + 300j, -9 - 300j, -160], [-3 + 200j, -3 - 200j, -100], "rate"),
    "a lag": ([-20, -5 + 300j, -5 - 300j, -900], [-3 + 200j, -3 - 200j], "rate"),
    "a spring": ([-2 + 10j, -2 - 10j, -9 + 300j, -9 - 300j], [-3 + 200j, -3 - 200j], "angle"),
    "free": ([0, -10, -9 + 300j, -9 - 300j], [-3 + 200j, -3 - 200j], "angle"),
    "zeros on the right": (
        [-2 + 10j, -2 - 10j, -9 + 300j, -9 - 300j, -700, -800],
        [-3 + 200j, -3 - 200j, 510, 600],
        "angle",
    ),
}
NEGATIVE_DAMPING = ([-20, -5 + 300j, -5 - 300j, -60], [-3 + 200j, -3 - 200j, -100], "rate")


def rational(poles, zeros, delay_s=DELAY_S, **more):
    return RationalModel(37 * np.poly(zeros).real, np.poly(poles).real, delay_s, fs_hz=FS_HZ, **more)


def excitation(size):
    rng = np.random.default_rng(2)
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[1:60] = np.exp(2j * np.pi * rng.random(59))
    u = np.fft.irfft(spectrum, N)
    return u * size / np.std(u)


@pytest.mark.parametrize("case", CASES)
def test_the_stack_has_the_response_of_the_rational_model(case):
    poles, zeros, output = CASES[case]
    model = rational(poles, zeros)
    stack = stack_of(model, output)
    found = linear_view(stack.stack(), F_HZ, FS_HZ, output_angle=output == "angle", held=False).command
    assert np.max(np.abs(found / model.response(F_HZ) - 1)) < 1e-9


def test_a_negative_damping_is_constant_in_the_band():
    poles, zeros, output = NEGATIVE_DAMPING
    model = rational(poles, zeros)
    found = linear_view(stack_of(model, output).stack(), F_HZ, FS_HZ, held=False).command
    assert np.max(np.abs(found / model.response(F_HZ) - 1)) < 5e-4


def integrated(poles, zeros, u, law, gain):
    """The periodic rate of G (u - law(angle, rate) / gain) with the delay in the command, by solve_ivp."""
    a, b, c, _ = tf2ss(37 * np.poly(zeros).real, np.poly(poles).real)
    b, c, n = b[:, 0], c[0], len(b)

    def slope(time_s, x):
        command = u[int(np.floor((time_s - DELAY_S) * FS_HZ)) % N]
        rate = c @ x[:n]
        return np.append(a @ x[:n] + b * (command - law(x[n], rate) / gain), rate)

    x, y = np.zeros(n + 1), np.zeros(N)
    for k in range(6 * N):
        y[k % N] = c @ x[:n]
        for first, last in ((0.0, 0.3), (0.3, 1.0)):  # the delayed command steps in between
            ends = ((k + first) / FS_HZ + 1e-12, (k + last) / FS_HZ - 1e-12)
            x = solve_ivp(slope, ends, x, rtol=1e-7, atol=1e-15).y[:, -1]
    return y


def test_laws_on_a_rational_response_are_those_of_the_integrated_equations():
    poles, zeros, output = CASES["complex zeros"]
    stack = stack_of(rational(poles, zeros), output)
    gain = stack["rigid_body.gain"].value
    plant = stack.with_effect("quadratic_drag", {"rate": 1.0}).with_effect(
        "cable_spring", {"stiffness": 900.0}
    )
    u = excitation(30.0)
    expected = integrated(poles, zeros, u, lambda angle, rate: 1.0 * rate * abs(rate) + 900.0 * angle, gain)
    found = plant.simulate(u)
    linear = stack.simulate(u).y
    assert found.settled
    assert np.std(linear - expected) > 0.1 * np.std(expected)  # the laws show
    assert np.max(np.abs(found.y - expected)) < 1e-4 * np.std(expected)


def test_a_file_with_a_rational_linear_part_and_laws(tmp_path):
    poles, zeros, _ = CASES["a spring"]
    model = rational(poles, zeros, y_unit="deg")
    file = tmp_path / "model.json"
    data = model.to_dict()
    law = {"effect": "cubic_spring", "params": {"stiffness": 50.0}}
    file.write_text(
        json.dumps(
            {
                "gsid_model": 1,
                "fs_hz": FS_HZ,
                "y_unit": "deg",
                "output": "angle",
                "linear": {"rational": data["rational"]},
                "effects": [law],
            }
        )
    )
    found = load_model(file)
    assert found["cubic_spring.stiffness"].value == 50.0
    assert found.output == "angle"
    model.save(tmp_path / "rational.json")
    alone = load_plant(tmp_path / "rational.json")
    assert alone.stack() == found.without_effect("cubic_spring").stack()
    found.save(tmp_path / "again.json")
    assert load_plant(tmp_path / "again.json").stack() == found.stack()


def refusals():
    angle = rational(*CASES["a spring"][:2]).to_dict()["rational"]
    base = {"gsid_model": 1, "fs_hz": FS_HZ}
    yield base | {"linear": {}}, "not a rational one"
    yield base | {"linear": {"rational": angle}, "effects": {}}, "not a list"
    yield base | {"linear": {"rational": angle}, "output": "speed"}, "output must be one of"
    yield base | {"linear": {"rational": angle | {"delay_s": -0.01}}}, "negative delay"
    yield base | {"linear": {"rational": angle | {"domain": "z"}}}, "in s"
    yield base | {"linear": {"rational": angle | {"num": [1.0, 0, 0, 0, 0]}}}, "a torque changes at once"
    yield base | {"linear": {"rational": angle | {"num": [1.0]}}}, "so few zeros"
    yield base | {"linear": {"rational": angle | {"num": [1.0, 2.0, 1.0]}}, "output": "angle"}, "equal zeros"
    stiff = angle | {"num": [1.0, 0.0, 4e4], "den": [1.0, 22.0, 9e4, 4e5, -9e6]}
    yield base | {"linear": {"rational": stiff}, "output": "angle"}, "negative spring"


@pytest.mark.parametrize(("data", "words"), list(refusals()))
def test_a_response_on_which_laws_cannot_act_is_refused(tmp_path, data, words):
    (tmp_path / "bad.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=words):
        load_plant(tmp_path / "bad.json")


def test_the_output_of_a_fitted_transfer_function_is_taken_from_its_unit(tmp_path):
    poles, zeros, _ = CASES["a lag"]
    rational(poles, zeros, y_unit="deg/s").save(tmp_path / "rate.json")
    assert load_plant(tmp_path / "rate.json").output == "rate"
    rational(poles, zeros).save(tmp_path / "none.json")
    with pytest.raises(InputError, match="names neither"):
        load_plant(tmp_path / "none.json")


def test_a_law_on_a_rational_response_is_found_and_fitted(tmp_path):
    poles, zeros, output = CASES["complex zeros"]
    stack = stack_of(rational(poles, zeros), output)
    true = stack.with_effect("coulomb_friction", {"level": 2.0})
    rng = np.random.default_rng(4)
    records = []
    for size in (60.0, 120.0):
        u = excitation(size) * rng.choice([-1, 1])
        y = np.tile(true.simulate(u).y, 6)
        y += 1e-3 * np.std(y) * rng.standard_normal(len(y))
        records.append(gsid.Record(np.tile(u, 6), y, FS_HZ, N, 0, hold="zoh"))
    found = gsid.diagnose_records(records, stack)
    assert (found.verdict, found.effects[0]) == ("missing_effect", "coulomb_friction")
    assert set(found.effects[1:]) <= {"stribeck_friction"}  # not excluded: the linear part has many values
    assert found.model["coulomb_friction.level"].value == pytest.approx(2.0, rel=0.02)
