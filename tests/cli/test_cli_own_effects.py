"""gsid add with an expression, a table and a compiled effect; and what is refused, in words."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gsid.excitation.multisine import Multisine
from gsid.models.load import load_model
from gsid.plant.model import PlantModel
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis

ROOT = Path(__file__).parents[2]
FS_HZ, N, BAND, LEVEL = 3000.0, 1000, (3.0, 100.0), 2.0
RECORDS = ["r0.npz", "r1.npz", "r2.npz"]
STACK = {"rigid_body": {"gain": 7.6}, "viscous_friction": {"rate": 10.6}}


def write(name, seed, n_periods=4, **units):
    """Settled periods of an axis with dry friction, without spring, delay, mode, gyro and fan."""
    u = Multisine.design(FS_HZ, N, BAND, phases="random", seed=seed, amplitude=3.0).table()
    off = {"mode_residue": 0.0, "fan_amplitude": 0.0, "noise_low_rms": 0.0, "gyro_lag_s": 0.0, "delay_s": 0.0}
    axis = SimulatedAxis(coulomb_level=LEVEL, noise_rms=0.02, spring_stiffness=0.0, seed=seed, **off)
    u, y, _ = axis.step(np.tile(u, 4 + n_periods))
    units = {"u_unit": "command", "y_unit": "deg/s"} | units
    write_record(name, Record(u, y, FS_HZ, N, 4 * N, hold="zoh", **units))


def save(name, stack=STACK, **more):
    entries = [{"effect": effect, "params": params} for effect, params in stack.items()]
    PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": entries} | more).save(name)


@pytest.fixture(autouse=True)
def files(plain_words):
    for i, name in enumerate(RECORDS):
        write(name, 60 + i)
    save("null.json")


def test_an_expression(undrawn, gsid):
    law = ["--torque", "c*tanh(w/width)", "--param", "c=1", "--param", "width=0.1,0.02:10"]
    result = gsid("add", *law, "--model", "null.json", *RECORDS, "-o", "one.json", "--json")
    assert result.code == 0, result.err
    added = json.loads(result.out)
    assert added["effect"] == "expression c*tanh(w/width)"
    assert added["held_out"]["after"] < 1.2 * added["noise_floor_rms"] < added["held_out"]["before"] / 3
    assert added["params"]["c"]["value"] == pytest.approx(LEVEL, rel=0.05)
    entry = json.loads(Path("one.json").read_text())["effects"][-1]
    assert entry["bounds"] == {"width": [0.02, 10]}

    compared = json.loads(gsid("compare", "--model", "one.json", "r2.npz", "--json").out)
    assert compared["rms_error"] < 1.2 * compared["noise_floor_rms"]
    result = gsid("report", "--model", "one.json", "r2.npz", "-o", "page.html")
    assert result.code == 0, result.err
    assert "expression" in Path("page.html").read_text(encoding="utf-8")
    assert gsid("add", "--undo", "--model", "one.json", "-o", "none.json").code == 0
    assert load_model("none.json").to_dict() == load_model("null.json").to_dict()


def test_the_curve_of_a_diagnosis(gsid):
    result = gsid("diagnose", "--model", "null.json", *RECORDS, "--curve", "curve.csv", "--json")
    assert result.code == 0, result.err
    missing = json.loads(result.out)["missing_torque"]
    assert missing["variable"] == "rate"
    assert len(missing["at"]) == len(missing["torque"]) == len(missing["std"])
    assert "wrote curve.csv: torque against rate" in result.err
    assert Path("curve.csv").read_text().startswith("# unit: deg/s\n")
    result = gsid("add", "--table", "curve.csv", "--model", "null.json", *RECORDS, "-o", "one.json", "--json")
    assert result.code == 0, result.err
    added = json.loads(result.out)
    assert added["held_out"]["after"] < 0.5 * added["held_out"]["before"]


def test_a_compiled_effect(gsid):
    page = (ROOT / "docs/how-to/own_effects.md").read_text(encoding="utf-8")
    Path("harness.c").write_text(re.search(r"^```c\n(.*?)^```", page, re.M | re.S)[1])
    flags = ["-std=c99", "-O2", "-fPIC", "-shared", f"-I{ROOT / 'include'}"]
    subprocess.run([shutil.which("cc") or "gcc", *flags, "harness.c", "-o", "harness.so"], check=True)
    own = ["--library", "./harness.so:harness_spring"]
    edge = 50 * FS_HZ / N + 1e-7
    how = ["--band", f"3:{edge}"]
    result = gsid("add", *own, "--model", "null.json", *RECORDS, *how, "-o", "with spring.json")
    assert result.code == 0, result.err
    assert "+ harness_spring" in result.out
    # Bugs: the command said without the library, the blank not quoted, the band cut to 6 digits.
    command = ["gsid", *own, "diagnose", "--model", "with spring.json", *RECORDS, *how]
    assert f"hint: {shlex.join(command)} tests whether another is missing" in result.err
    assert "--model 'with spring.json'" in result.err
    Path("with spring.json").rename("one.json")
    # A process of its own: in this one the library is loaded.
    other = [Path(sys.executable).parent / "gsid", "compare", "--model", "one.json", "r2.npz"]
    refused = subprocess.run(other, capture_output=True, text=True)
    assert refused.returncode == 3
    assert "library that was not loaded" in refused.stderr
    hint = (
        "hint: load the library explicitly, which runs its code: gsid --library ./harness.so:harness_spring"
    )
    assert hint in refused.stderr
    assert gsid(*own, "compare", "--model", "one.json", "r2.npz", "--json").code == 0


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--torque", "c*tanh(v/0.1)", "--param", "c=1"], 3, "unknown name v"),
        (["--torque", "c*tanh(v/0.1)", "--param", "c=1"], 3, "    c*tanh(v/0.1)\n           ^"),
        (["--torque", "c*sign(w)", "--param", "c=1"], 3, "gsid add coulomb_friction"),
        (["--torque", "c/w", "--param", "c=1"], 3, "too steep"),
        (["--torque", "c*w/(abs(w)+1e-30)", "--param", "c=3000"], 3, "jumps, runs away"),
        (["--torque", "c*w", "--param", "c=1,2:3"], 3, "out of its bounds"),
        (["--torque", "c*w", "--param", "c=1,2"], 2, "is not NAME=VALUE,LO:HI"),
        (["--torque", "c*w", "--table", "curve.csv"], 2, "give one of them"),
        # Bugs: the last value counted; the effect was looked for as a file.
        (["--torque", "c*w", "--param", "c=1", "--param", "c=2"], 2, "--param c is given twice"),
        (["coulomb_friction", "--torque", "c*w", "--param", "c=1"], 2, "one after the other"),
        (["--table", "nowhere.csv"], 3, "cannot read the table"),
        (["--library", "harness.so"], 2, "is not FILE.so:NAME"),
        (["--library", "./nowhere.so:own"], 3, "does not exist"),
        (["coulomb_friction", "--param", "level=1,0:3"], 2, "bounds in --param are for --torque"),
    ],
)
def test_misuse(gsid, arguments, code, words):
    result = gsid("add", *arguments, "--model", "null.json", "r0.npz", "-o", "two.json")
    assert (result.code, result.out) == (code, "")
    assert words in result.err
    assert "hint: " in result.err
    assert not Path("two.json").exists()


# ---- a wrong model or record: an error or a stated limitation, never a wrong number ---------------


VERBS = [["compare"], ["diagnose"], ["add", "coulomb_friction", "-o", "two.json"]]


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
@pytest.mark.parametrize(
    ("model", "record", "words"),
    [
        ({"angle_unit": "rad"}, {}, "deg/s and rad/s"),
        ({"output": "angle"}, {}, "deg/s and deg"),
        ({"u_unit": "V"}, {}, "u_unit of the record is not the model's"),
        ({"y_unit": "counts"}, {}, "y_unit of the record is not the model's"),
        ({}, {"y_unit": "rad/s"}, "rad/s and deg/s"),
    ],
)
def test_units_that_do_not_match(gsid, verb, model, record, words):
    save("units.json", **model)
    write("units.npz", 70, **record)
    result = gsid(*verb, "--model", "units.json", "units.npz")
    assert (result.code, result.out) == (3, "")
    assert words in result.err
    assert "hint: " in result.err


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
def test_an_unknown_effect_in_a_model(gsid, verb):
    entries = [
        {"effect": "rigid_body", "params": {"gain": 7.4}},
        {"effect": "coulomb", "params": {"level": 1}},
    ]
    Path("m.json").write_text(json.dumps({"gsid_model": 1, "fs_hz": FS_HZ, "effects": entries}))
    result = gsid(*verb, "--model", "m.json", "r0.npz")
    assert (result.code, result.out) == (3, "")
    assert "unknown effect" in result.err
    assert "coulomb" in result.err
    assert "hint: " in result.err


def test_the_library_that_a_model_needs_is_named_as_one_types_it(gsid):
    """A bug: the blank was not quoted."""
    own = {"effect": "spring", "params": {"k": 1}, "library": "./my own/spring.so:spring"}
    model = {
        "gsid_model": 1,
        "fs_hz": FS_HZ,
        "effects": [{"effect": "rigid_body", "params": {"gain": 7.4}}, own],
    }
    Path("m.json").write_text(json.dumps(model))
    result = gsid("compare", "--model", "m.json", "r0.npz")
    assert "gsid --library './my own/spring.so:spring' ..." in result.err


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb[0])
def test_a_model_that_runs_away(gsid, verb):
    """A spring that pushes: nothing holds the axis."""
    save("away.json", STACK | {"cubic_spring": {"stiffness": -1e7}})
    result = gsid(*verb, "--model", "away.json", "r0.npz")
    assert (result.code, result.out) == (3, "")
    assert "cannot be simulated" in result.err
    assert "hint: " in result.err


@pytest.mark.parametrize(
    ("verb", "n_periods", "words"),
    [
        (VERBS[0], 1, "fewer than two"),
        (VERBS[1], 1, "fewer than two"),
        (VERBS[2], 1, "fewer than two"),
        (VERBS[2], 3, "too few periods to keep half of them out"),
    ],
)
def test_a_record_too_short_for_the_test(gsid, verb, n_periods, words):
    write("short.npz", 71, n_periods)
    result = gsid(*verb, "--model", "null.json", "short.npz")
    assert (result.code, result.out) == (3, "")
    assert words in result.err
    assert "hint: " in result.err


def test_a_singular_fit_is_reported(gsid):
    """Two frictions that are the same: the sum is determined, neither of them is."""
    law = ["--torque", "b*w", "--param", "b=1"]
    result = gsid("add", *law, "--model", "null.json", *RECORDS, "-o", "two.json")
    assert result.code == 0
    said = re.search(r"^Not determined by these data: (.*)\.$", result.out, re.M)[1]
    assert "expression.b" in said
    assert "viscous_friction.rate" in said
    values = load_model("two.json")
    total = values["viscous_friction.rate"].value + values["expression.b"].value
    alone = json.loads(
        gsid("add", "coulomb_friction", "--model", "null.json", *RECORDS, "-o", "c.json", "--json").out
    )
    assert alone["after"]["cost_per_dof"] < 2
    assert total == pytest.approx(11.0, rel=0.2)  # what the dry friction adds to it is less


def test_a_curve_has_a_unit(gsid):
    Path("curve.csv").write_text("# unit: rad/s\nw,torque\n-1,-1\n0,0\n1,1\n")
    result = gsid("add", "--table", "curve.csv", "--model", "null.json", "r0.npz", "-o", "two.json")
    assert (result.code, result.out) == (3, "")
    assert "the unit of the table is not the model's" in result.err
