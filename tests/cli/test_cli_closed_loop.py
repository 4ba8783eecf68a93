"""`--r NAME` of `gsid add` and `gsid compare`: closed loops whose controller is not in the model.

The truth is an axis with viscous friction and a drive with a dead zone, carried from sample to sample by its
closed form; the controller reads its noisy encoder.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from gsid.comparison import compare
from gsid.diagnosis.closed_loop import in_closed_loop
from gsid.excitation.multisine import Multisine
from gsid.models.load import load_model
from gsid.records.files import read_record, write_record
from gsid.records.record import Record

SEED = 20261123
FS, N, PERIODS, SETTLE = 3000.0, 1500, 6, 4  # the loop forgets as exp(-50 t)
GAIN, RATE, KP, KV, DEAD = 9e4, 12.0, 30.0, 1e-3, 5e-4


def write_loop(name, seed, noise=1e-5):
    """r, u and y of PERIODS periods in steady state."""
    print("seed", seed)
    one = Multisine.design(FS, N, (2, 60), phases="random", seed=seed, amplitude=1.0).table()
    r = np.tile(one, SETTLE + PERIODS)
    v = noise * np.random.default_rng(seed).standard_normal(len(r))
    decay = np.exp(-RATE / FS)
    glide = (1 - decay) / RATE
    angle = rate = 0.0
    past = [0.0, 0.0, 0.0]
    u, y = np.empty((2, len(r)))
    for i in range(len(r)):
        y[i] = angle + v[i]
        past = [y[i], *past[:2]]
        u[i] = KV * (KP * (r[i] - y[i]) - (past[0] - past[2]) * FS / 2)
        push = GAIN * np.sign(u[i]) * max(abs(u[i]) - DEAD, 0.0)
        angle, rate = angle + glide * rate + push * (1 / FS - glide) / RATE, decay * rate + push * glide
    write_record(name, Record(u, y, FS, N, SETTLE * N, hold="zoh", y_unit="deg", columns={"r": r}))


@pytest.fixture(autouse=True)
def files(plain_words):
    write_loop("loop.csv", SEED)
    write_loop("new.csv", SEED + 1)
    save("axis.json")


def save(name, **more):
    stack = {"rigid_body": {"gain": GAIN * 1.05}, "viscous_friction": {"rate": RATE * 0.9}}
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    Path(name).write_text(
        json.dumps({"gsid_model": 1, "fs_hz": FS, "output": "angle", "effects": effects} | more)
    )


def test_an_effect_is_added_inside_the_loop_that_the_record_shows(gsid):
    added = (
        "add",
        "drive_dead_zone",
        "loop.csv",
        "--r",
        "r",
        "--model",
        "axis.json",
        "--held-out",
        "new.csv",
    )
    result = gsid(*added, "-o", "m.json")
    assert result.code == 0, result.err
    model = load_model("m.json")
    assert model["position_velocity_loop.kp"].value == pytest.approx(KP, rel=1e-3)
    assert model["position_velocity_loop.kv"].value == pytest.approx(KV, rel=1e-3)
    assert model["position_velocity_loop.rate_samples"].value == 2
    assert not model["position_velocity_loop.kp"].free
    dead = model["drive_dead_zone.half_width"]
    assert abs(dead.value - DEAD) < 5 * dead.std
    # The same model and record by the reference as the input of the loop.
    found = json.loads(gsid("compare", "new.csv", "--r", "r", "--model", "m.json", "--json").out)
    same = json.loads(
        gsid("compare", "new.csv", "--u", "r", "--model", "m.json", "--band", "2:60", "--json").out
    )
    assert found["rms_error"] < 2 * found["noise_floor_rms"]
    assert found["rms_error"] == pytest.approx(same["rms_error"], rel=0.3)


def test_the_values_are_fitted_inside_the_loop_that_the_record_shows(gsid):
    model = json.loads(Path("axis.json").read_text())
    model["effects"].append({"effect": "drive_dead_zone", "params": {"half_width": DEAD * 1.4}})
    Path("dead.json").write_text(json.dumps(model))
    result = gsid("fit", "loop.csv", "--r", "r", "--model", "dead.json", "-o", "fitted.json")
    assert result.code == 0, result.err
    found = load_model("fitted.json")
    assert found["position_velocity_loop.kp"].value == pytest.approx(KP, rel=1e-3)
    for name, true in (
        ("rigid_body.gain", GAIN),
        ("viscous_friction.rate", RATE),
        ("drive_dead_zone.half_width", DEAD),
    ):
        assert abs(found[name].value - true) < 5 * found[name].std, name
    assert gsid("compare", "new.csv", "--r", "r", "--model", "fitted.json", "--check").code == 0


def test_a_model_without_a_controller_is_compared_inside_the_loop(gsid):
    """Driven by the measured command, the simulated axis drifts: its error is larger."""
    inside = json.loads(gsid("compare", "loop.csv", "--r", "r", "--model", "axis.json", "--json").out)
    driven = json.loads(gsid("compare", "loop.csv", "--model", "axis.json", "--json").out)
    assert inside["rms_error"] < 0.3 * driven["rms_error"]


def test_a_rational_model_is_compared_at_the_lines_of_the_reference(gsid):
    assert gsid("fit", "loop.csv", "--r", "r", "--order", "2/0", "-o", "tf.json").code == 0
    found = gsid("compare", "new.csv", "--r", "r", "--model", "tf.json", "--json")
    assert found.code == 0, found.err
    record = read_record("new.csv")
    model, (measured,) = in_closed_loop(load_model("tf.json"), record, "r")
    np.testing.assert_array_equal(np.flatnonzero(measured.excited), np.arange(1, 31))
    periods = record.u[SETTLE * N :].reshape(PERIODS, N)
    np.testing.assert_allclose(measured.U[:, 1:31], np.fft.rfft(periods)[:, 1:31] * (2 / N), rtol=1e-9)
    assert json.loads(found.out)["rms_error"] == pytest.approx(compare(model, measured).rms_error)


def test_without_a_known_controller_the_loop_is_refused(gsid):
    save("rate.json", output="rate")
    for verb in (("compare",), ("add", "coulomb_friction", "-o", "m.json")):
        result = gsid(*verb, "loop.csv", "--r", "r", "--model", "rate.json")
        assert result.code == 3
        assert "the controller of the closed loop is not known" in result.err
        assert "hint: write position_velocity_loop" in result.err
    missing = gsid("compare", "loop.csv", "--r", "rr", "--model", "axis.json")
    assert missing.code == 3
    assert "no column named rr" in missing.err


def test_undo_takes_no_reference(gsid):
    result = gsid("add", "--undo", "--r", "r", "--model", "axis.json", "-o", "m.json")
    assert result.code == 2
    assert "leave out effect, records and options" in result.err
