"""`--hold`, and what the command prints of records that do not state it."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

from gsid.excitation.multisine import Multisine
from gsid.records.files import write_record
from gsid.records.record import Record

FS_HZ, N, GAIN, RATE = 3000.0, 3000, 40.0, 25.0
KEYS = ("hold", "hold_assumed", "delay_hold_uncertainty_s")
DELAY_S = 3 / FS_HZ


@pytest.fixture
def files():
    """A held command on a lag and three samples of delay, in closed form; its file is silent."""
    u = np.tile(Multisine.design(FS_HZ, N, (5, 900), rms=1.0).table(), 9)
    pole = np.exp(-RATE / FS_HZ)
    y = lfilter([0, GAIN / RATE * (1 - pole)], [1, -pole], np.roll(u, 3))
    y += 1e-3 * np.random.default_rng(3).normal(size=len(y))
    write_record("silent.csv", Record(u, y, FS_HZ, N, N, y_unit="deg/s"))
    stack = {
        "rigid_body": {"gain": 1.1 * GAIN},
        "viscous_friction": {"rate": RATE},
        "transport_delay": {"delay_s": DELAY_S},
    }
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    with open("axis.json", "w") as file:
        json.dump({"gsid_model": 1, "fs_hz": FS_HZ, "effects": effects}, file)


@pytest.mark.parametrize("kind", [("--order", "1/0"), ("--model", "axis.json")])
def test_fit_compare_and_export_of_a_silent_record(gsid, files, kind):
    result = gsid("fit", "silent.csv", *kind, "-o", "m.json", "--json")
    found = json.loads(result.out)
    assert [found[key] for key in KEYS[:2]] == ["zoh", True]
    assert found["delay_hold_uncertainty_s"] == pytest.approx(0.5 / FS_HZ, rel=0.3)
    other = f"the delay would be {1e3 * found['other_delay_s']:.5g} ms"
    assert other in result.err
    assert "`# hold: zoh`" in result.err
    assert "--hold zoh|none" in result.err
    compare = ("compare", "silent.csv", "--model", "m.json", "--fitted")
    for verb in (compare, ("export-c", "m.json", "-o", "m.c")):
        result = gsid(*verb, "--json")
        values = json.loads(result.out)
        assert [values[key] for key in KEYS] == [found[key] for key in KEYS]
        assert values.get("adequate", True)
        assert other in result.err


@pytest.mark.parametrize("kind", [("--order", "1/0"), ("--model", "axis.json")])
@pytest.mark.parametrize("hold", ["zoh", "none"])
def test_hold_states_it(gsid, files, kind, hold):
    result = gsid("fit", "silent.csv", *kind, "--hold", hold, "--json")
    assert [json.loads(result.out)[key] for key in KEYS] == [hold, False, None]
    assert "hold" not in result.err


def test_diagnose_of_a_silent_record(gsid, files):
    result = gsid("diagnose", "silent.csv", "--model", "axis.json", "-o", "found.json", "--json")
    values = json.loads(result.out)
    assert (values["verdict"], values["found"]) == ("adequate", [])
    assert [values[key] for key in KEYS[:2]] == ["zoh", True]
    assert "the records do not state whether the input was held" in result.err
    with open("found.json") as file:
        assert json.load(file)["fit"]["hold_assumed"]


def test_an_unknown_hold_is_refused(gsid, files):
    assert gsid("fit", "silent.csv", "--order", "1/0", "--hold", "foh").code == 2
