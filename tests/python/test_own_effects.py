"""Effects of one's own in plants: fitted, judged, kept in model files, taken back; tables, shared objects."""

import copy
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plants import FS_HZ, axis_record, plant
from scipy.interpolate import PchipInterpolator

import gsid
from gsid import effects
from gsid._lib import ffi, lib
from gsid.base.errors import InputError
from gsid.diagnosis.from_records.what_is_left import FRICTION_OVER_ANGLE, what_is_left
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel

ROOT = Path(__file__).parents[2]
SEED = 20260413
N, BAND, NOISE, LEVEL = 1500, (2.0, 100.0), 0.02, 2.0
AXIS = {"gain": 7.4, "viscous_rate": 11.0, "spring_stiffness": 170.0, "delay_s": 0.0054}


def start(**more):
    stack = {
        "rigid_body": {"gain": 7.7},
        "viscous_friction": {"rate": 10.5},
        "cable_spring": {"stiffness": 175.0},
        "transport_delay": {"delay_s": 0.0052},
    }
    return plant(stack, **more)


@pytest.fixture(scope="module")
def records():
    """Three realisations of an axis with dry friction that the model does not know."""
    print("seeds", SEED, "on")
    made = []
    for seed in range(SEED, SEED + 3):
        u = gsid.Multisine.design(FS_HZ, N, BAND, phases="random", seed=seed, amplitude=3.0).table()
        made.append(gsid.spectra(axis_record(u, 6, NOISE, seed, f"r{seed}", coulomb_level=LEVEL, **AXIS)))
    return made


@pytest.fixture(scope="module")
def fitted(records):
    return gsid.fit_plant(start(), records).model


@pytest.fixture(scope="module")
def curve(fitted, records):
    return gsid.torque_residual(fitted, records).best


# ---- expressions in plants ----------------------------------------------------------------------------


def test_an_expression_is_fitted_validated_saved_and_removed(records, tmp_path):
    law = effects.expression("c*tanh(w/0.02)", {"c": 0.5})
    added = gsid.add(law, start(), records)
    rung = added.rung
    assert rung.effect == "expression c*tanh(w/0.02)"
    assert rung.held_out["before"] > 5 * rung.noise_floor_rms
    assert rung.held_out["after"] < 1.2 * rung.noise_floor_rms  # the transition is 0.02 deg/s wide
    assert rung.params["c"]["value"] == pytest.approx(LEVEL, rel=0.03)
    added.model.save(tmp_path / "m.json")
    entry = json.loads((tmp_path / "m.json").read_text())["effects"][-1]
    assert (entry["effect"], entry["torque"]) == ("expression", "c*tanh(w/0.02)")
    again = gsid.load_model(tmp_path / "m.json")
    assert again.to_dict() == added.model.to_dict()
    compared = [gsid.compare(model, records[2]).rms_error for model in (added.model, again)]
    assert compared[0] == compared[1]
    assert gsid.undo(again).to_dict() == start().to_dict()
    second = gsid.add(effects.expression("k*theta^3", {"k": 1.0}), again, records)
    assert [row[0] for row in second.ladder.rows()][1:] == [
        "+ expression c*tanh(w/0.02)",
        "+ expression#2 k*theta^3",
    ]
    assert gsid.diagnose(added.model, records[0]).cost_per_dof > 0  # it can stand in a model that is searched
    assert copy.deepcopy(again).to_dict() == again.to_dict()


def test_bug_what_a_model_with_an_own_law_leaves_could_not_be_tested(records):
    """A second effect beside such a law ended the diagnosis with KeyError: 'expression'."""
    added = gsid.add(effects.expression("c*tanh(w/0.02)", {"c": 0.5}), start(), records)
    p_values = what_is_left(gsid.fit_plant(added.model, records[:2]))
    assert set(p_values) == {"the angle", "the rate", "the command", FRICTION_OVER_ANGLE}
    assert min(p_values.values()) > 1e-3


def test_sensitivities_of_own_laws_are_those_of_the_answer(records):
    """Against differences of 1e-5 of each parameter; the steps that follow the laws are cut differently by
    them, which leaves 1e-4 of the largest."""
    laws = [
        (effects.expression("c*tanh(w/v)*(1 + 0.1*u*sin(theta))", {"c": 2.0, "v": 0.5}), [2.0, 0.5]),
        (effects.table(("w", np.linspace(-6, 6, 25), 3 * np.tanh(np.linspace(-6, 6, 25)))), [0.7]),
    ]
    model = start()
    for law, values in laws:
        params = {name: Param(value) for name, value in zip(law.names, values, strict=True)}
        model.effects.append(Effect(law.id, params, law))
    answer = model.predict(records[0], sensitivities=True)
    assert answer.settled
    for i, value in enumerate(model.free_values):
        sides = []
        for h in (1e-5 * value, -1e-5 * value):
            moved = model.free_values
            moved[i] += h
            sides.append(model.with_values(moved).predict(records[0]).Y)
        difference = (sides[0] - sides[1]) / (2e-5 * value)
        error = np.linalg.norm(answer.dY[i] - difference) / np.linalg.norm(difference)
        assert error < 1e-3, model.free_names[i]


@pytest.mark.parametrize(
    ("law", "what"),
    [
        ("c/w", "too steep"),
        # Where the axis would stick; one that it only passes is followed.
        ("3000*c*w/abs(w)", "jumps, runs away"),
        ("3000*c*w/(abs(w) + 1e-30)", "jumps, runs away"),
        ("0*c - 1e4*w*abs(w)", "runs away"),
        ("c*log(w)", "has no value"),
    ],
)
def test_a_law_that_cannot_be_simulated_is_refused(records, law, what):
    with pytest.raises(InputError, match="fails from every start") as refused:
        gsid.add(effects.expression(law, {"c": 1.0}), start(), records)
    assert re.search(what, str(refused.value)), refused.value
    assert refused.value.hint


# ---- tables ---------------------------------------------------------------------------------------------


def test_slopes_of_a_table_are_those_of_pchip():
    rng = np.random.default_rng(SEED)
    for n in (3, 4, 30):
        at, torque = np.cumsum(rng.uniform(0.1, 2, n)), rng.standard_normal(n)
        slope = np.empty(n)
        assert lib.gsid_table_slopes(n, *(ffi.from_buffer("double[]", x) for x in (at, torque, slope))) == 0
        np.testing.assert_allclose(slope, PchipInterpolator(at, torque).derivative()(at), rtol=1e-12)


def test_the_curve_that_is_missing_becomes_an_effect(records, fitted, curve, tmp_path):
    """Friction from its residual: nearly all of the error goes, what noise left in the curve stays."""
    assert curve.name == "rate"
    curve.save(tmp_path / "curve.csv")
    law = effects.table(tmp_path / "curve.csv")
    np.testing.assert_allclose(law.definition["torque"], curve.to_effect().definition["torque"], rtol=1e-9)
    # With what the fitted viscous friction has taken of it, it is the dry friction; a bin is 0.25 deg/s wide.
    often = (np.abs(curve.at) > 0.5) & (curve.share > 0.02)
    dry = law.definition["torque"] + (fitted["viscous_friction.rate"].value - 11.0) * curve.at
    np.testing.assert_allclose(dry[often], LEVEL * np.sign(curve.at[often]), atol=0.4 * LEVEL)
    added = gsid.add(law, start(), records)
    assert added.rung.held_out["after"] < 0.3 * added.rung.held_out["before"]
    assert added.rung.params["scale"]["value"] == pytest.approx(1, abs=0.2)
    added.model.save(tmp_path / "m.json")
    again = gsid.load_model(tmp_path / "m.json")
    assert again.to_dict() == added.model.to_dict()
    assert again.predict(records[0]).y == pytest.approx(added.model.predict(records[0]).y, abs=0)


def test_motion_beyond_a_table_is_reported(records, caplog):
    at = np.linspace(-1, 1, 9)
    gsid.add(effects.table(("w", at, LEVEL * np.sign(at))), start(), records)
    assert "outside the table" in caplog.text
    caplog.clear()
    at = np.linspace(-9, 9, 9)
    gsid.add(effects.table(("w", at, LEVEL * np.sign(at))), start(), records)
    assert "outside the table" not in caplog.text


@pytest.mark.parametrize(
    ("text", "what", "where"),
    [
        ("", "no torque column", ""),
        ("w,force\n0,1\n1,2\n2,3\n", "no torque column", ""),
        ("t,torque\n0,1\n1,2\n2,3\n", "not a variable", ""),
        ("w,torque\n0,1\n1,2\n", "two lists of equal length", ""),
        ("w,torque\n0,1\n1,two\n2,3\n", "invalid row", "line 3"),
        ("# unit: deg/s\nw,torque\n0,1\n1\n2,3\n", "invalid row", "line 4"),
        ("w,torque\n0,1\n1,nan\n2,3\n", "not finite", ""),
        ("w,torque\n0,1\n1,2\n1,3\n", "same abscissa", ""),
    ],
)
def test_files_that_are_no_table(tmp_path, text, what, where):
    (tmp_path / "curve.csv").write_text(text)
    with pytest.raises(InputError, match=what) as refused:
        effects.table(tmp_path / "curve.csv")
    assert "curve.csv" in refused.value.where
    assert where in refused.value.where


def test_a_file_that_is_not_there():
    with pytest.raises(InputError, match="cannot read the table"):
        effects.table("nowhere.csv")


def test_units_of_a_table(records):
    at = np.linspace(-5, 5, 11)
    model = start()
    with pytest.raises(InputError, match="unit of the table is not the model's"):
        gsid.add(effects.table(("w", at, at), unit="rad/s"), model, records)
    assert gsid.add(effects.table(("w", at, at), unit="deg/s"), model, records).fit.converged


# ---- model files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "what"),
    [
        ({"effect": "expression", "params": {}}, "lacks 'torque'"),
        ({"effect": "expression", "torque": "c*w"}, "lacks 'params'"),
        ({"effect": "expression", "torque": "c*v", "params": {"c": 1}}, "unknown name v"),
        ({"effect": "expression", "torque": "c*w", "params": {"c": 9}, "bounds": {"c": [0, 1]}}, "bounds"),
        ({"effect": "expression", "torque": "c*w", "params": {"c": "x"}}, "not numbers"),
        ({"effect": "expression", "torque": "c*w", "params": {"c": {"free": True}}}, "lacks 'value'"),
        ({"effect": "expression", "torque": "w", "params": {}, "bounds": 3}, "bounds"),
        ({"effect": "table", "variable": "w", "at": [0, 1, 2], "params": {"scale": 1}}, "lacks 'torque'"),
        ({"effect": "table", "variable": "w", "at": 1, "torque": 2, "params": {"scale": 1}}, "two lists"),
        ({"effect": "table", "variable": 1, "at": [0], "torque": [2], "params": {}}, "not a variable"),
        ({"effect": "my_own", "library": "./my.so:my_own", "params": {}}, "library that was not loaded"),
    ],
)
def test_wrong_descriptions(entry, what):
    data = start().to_dict()
    data["effects"].append(entry)
    with pytest.raises(InputError, match=what) as refused:
        PlantModel.from_dict(data, "m.json")
    assert "m.json effects[4]" in refused.value.where


# ---- shared objects -------------------------------------------------------------------------------------


def compiled(folder, source, name="own"):
    (folder / f"{name}.c").write_text(source)
    cc = shutil.which("cc") or shutil.which("gcc")
    flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Wno-unused",
        "-fPIC",
        "-shared",
        f"-I{ROOT / 'include'}",
    ]
    subprocess.run([cc, *flags, str(folder / f"{name}.c"), "-o", str(folder / f"{name}.so")], check=True)
    return folder / f"{name}.so"


def example():
    """The C code of docs/how-to/own_effects.md."""
    return re.search(r"^```c\n(.*?)^```", (ROOT / "docs/how-to/own_effects.md").read_text(), re.M | re.S)[1]


def test_the_example_of_the_docs(tmp_path):
    """Compiled, loaded, and found in the answer of a plant that has it."""
    library = compiled(tmp_path, example())
    model = start()
    law = effects.load(library, "harness_spring")
    params = {"stiffness": Param(300.0), "angle_deg": Param(0.05)}
    hidden = copy.deepcopy(model)
    hidden.effects.append(Effect(law.id, params, law))
    u = gsid.Multisine.design(FS_HZ, N, BAND, phases="random", seed=SEED, amplitude=3.0).table()
    y = np.tile(hidden.simulate(u).y, 6) + NOISE * np.random.default_rng(SEED).standard_normal(6 * N)
    record = gsid.Record(np.tile(u, 6), y, FS_HZ, N, 0, hold="zoh", y_unit="deg/s")
    added = gsid.add(law, model, record, params={"stiffness": 250.0, "angle_deg": 0.04})
    assert added.rung.held_out["after"] < 1.1 * added.rung.noise_floor_rms < added.rung.held_out["before"] / 5
    for name, param in params.items():
        found = added.rung.params[name]
        assert abs(found["value"] - param.value) < 4 * found["std"]
    added.model.save(tmp_path / "m.json")
    assert gsid.load_model(tmp_path / "m.json").to_dict() == added.model.to_dict()
    # A process of its own: in this one the library is loaded.
    command = [Path(sys.executable).parent / "gsid", "compare", "--model", "m.json", "r.npz"]
    gsid.write_record(tmp_path / "r.npz", record)
    refused = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert refused.returncode == 3
    assert "library that was not loaded" in refused.stderr
    assert f"--library {library}:harness_spring" in refused.stderr


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (
            "GSID_SHARE_EFFECT(harness_spring);",
            "const gsid_effect *shared = &harness_spring;",
            "not contain the effect",
        ),
        ('.id = "harness_spring"', '.id = "hard_stop"', "reserved by gsid"),
        ('.id = "harness_spring"', ".id = 0", "no id"),
        (".n_parameters = 2", ".n_parameters = 9", "9 parameters of at most 4"),
        (".n_parameters = 2", ".n_parameters = 3", "no name or unit"),
        (".stage = GSID_STAGE_TORQUE", ".stage = (gsid_stage)9", "stage or null_kind"),
        (".torque = torque,", "/* none */", "no function"),
        ("#include <math.h>\n", "#include <math.h>\n#define GSID_SINGLE\n", "not contain the effect"),
    ],
)
def test_shared_objects_that_are_no_effect(tmp_path, old, new, what):
    source = example()
    assert old in source
    library = compiled(tmp_path, source.replace(old, new))
    with pytest.raises(InputError, match=what) as refused:
        effects.load(library, "harness_spring")
    assert refused.value.hint


def test_other_files_are_no_shared_object(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        effects.load(tmp_path / "nowhere.so", "x")
    (tmp_path / "text.so").write_text("text")
    with pytest.raises(InputError, match="cannot be loaded"):
        effects.load(tmp_path / "text.so", "x")
    old = "const struct { unsigned long size; void *effect; } own_shared_f64 = {7, 0};"
    with pytest.raises(InputError, match="another version"):
        effects.load(compiled(tmp_path, old), "own")
