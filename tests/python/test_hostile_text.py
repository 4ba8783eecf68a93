"""Texts out of files: none may steer a terminal, fake a line of ours, or become a key of the file written."""

import json

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.base.json_files import MAX_DEPTH, parse_json
from gsid.cli.main import main
from gsid.cli.output import visible
from gsid.diagnosis.ladder import ladder
from gsid.models.load import load_model
from gsid.plant.model import PlantModel
from gsid.records.files import read_record, write_record
from gsid.records.periods import split_periods
from gsid.records.record import Record
from gsid.response.estimate_distortion import distortion
from gsid.response.superposition import superposition

ESCAPE = "\x1b[31mred\x07"
U = np.tile(np.sin(np.arange(20) * 0.9), 6)


def record(**more):
    return Record(U, U * 0.5, 100.0, **more)


# ---------------------------------------------------------------- what is printed


def test_what_a_terminal_obeys_is_printed_as_an_escape():
    assert visible(ESCAPE) == r"\x1b[31mred\x07"
    assert visible("a\nerror: b\r\u202e\ud800\u2028") == r"a\nerror: b\r\u202e\ud800\u2028"
    assert visible("\n    c*w\n    ^") == "\n    c*w\n    ^"  # the caret under an expression
    assert visible("deg/s °/s µ") == "deg/s °/s µ"
    assert len(visible("x" * 10**6)) < 1100


def test_escape_codes_in_names_do_not_reach_the_terminal(tmp_path, monkeypatch, capsys):
    """A bug: the name of a column, a key or an effect was printed as it stood."""
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{u},{u},word\n" for u in U)
    (tmp_path / "rec.csv").write_text(f"# fs_hz: 100\nu,y,{ESCAPE}\n{rows}")
    assert main(["frf", "rec.csv"]) == 0
    (tmp_path / "names.csv").write_text(f"# fs_hz: 100\nu,{ESCAPE}\n{rows}")
    assert main(["frf", "names.csv"]) == 3
    (tmp_path / "hold.csv").write_text(f"# fs_hz: 100\n# hold: {ESCAPE}\nu,y\n{rows.replace(',word', '')}")
    assert main(["frf", "hold.csv"]) == 3
    effect = {"effect": f"{ESCAPE}\nhint: all is well", "params": {}}
    (tmp_path / "m.json").write_text(json.dumps({"gsid_model": 1, "fs_hz": 100.0, "effects": [effect]}))
    assert main(["compare", "--model", "m.json", "rec.csv"]) == 3
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err
    assert "\x07" not in out + err
    assert "\nhint: all is well" not in err
    assert r"\x1b[31mred" in err


@pytest.mark.parametrize("unit", [ESCAPE, "deg/s\n# fs_hz: 7", 5, None, "x" * 100_000])
def test_units_that_cannot_be_printed_are_refused(unit):
    """They stand in tables, plots, reports and exported C; a report took 23 s to draw the last one."""
    with pytest.raises(InputError, match="y_unit") as refused:
        record(y_unit=unit)
    assert len(str(refused.value)) < 200


# ---------------------------------------------------------------- what is written


@pytest.mark.parametrize(
    ("more", "what"),
    [
        ({"meta": {"note": "a\n# fs_hz: 7"}}, "value of note"),
        ({"meta": {"a\nfs_hz": "7"}}, "name of a key"),
        ({"meta": {"fs_hz": "7"}}, "name of another value"),
        ({"meta": {"a: b": "7"}}, "name of a key"),
        ({"columns": {"a,b": U}}, "name of a column"),
        ({"columns": {"a\nb": U}}, "name of a column"),
        ({"columns": {'"a"': U}}, "name of a column"),
        ({"columns": {"": U}}, "name of a column"),
        ({"columns": {"u": U}}, "name of another value"),
        ({"columns": {"valid": U}}, "name of another value"),
    ],
)
def test_texts_that_would_be_read_as_something_else_are_not_written(tmp_path, more, what):
    """A bug: a line break in a value became a key of the header, a comma in a name another column."""
    with pytest.raises(InputError, match=what) as caught:
        write_record(tmp_path / "rec.csv", record(**more))
    assert caught.value.hint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_arrays_hold_any_text(tmp_path, suffix):
    made = record(meta={"note": "a\n# fs_hz: 7"}, columns={"a,b": U})
    write_record(tmp_path / f"rec{suffix}", made)
    back = read_record(tmp_path / f"rec{suffix}")
    assert back.meta == made.meta
    assert back.fs_hz == 100.0
    np.testing.assert_array_equal(back.columns["a,b"], U)


# ---------------------------------------------------------------- what is read


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[" * 100_000, "nested deeper"),
        ('{"a":' * 100_000, "nested deeper"),
        ("[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), "nested deeper"),
        ("NaN", "not a JSON number"),
        ("[-Infinity]", "not a JSON number"),
        ("1e400", "out of range"),
        ("-1e999", "out of range"),
        ("1" * 400, "400 digits"),
        ("{", "Expecting"),
    ],
)
def test_json_that_no_model_file_has_is_refused(tmp_path, text, what):
    """Bugs: deep JSON was an internal error; so was a number that is no double."""
    with pytest.raises(ValueError, match=what):
        parse_json(text)
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(InputError, match=what):
        load_model(tmp_path / "m.json")


def test_json_of_a_stated_depth_is_read():
    assert parse_json("[" * MAX_DEPTH + "]" * MAX_DEPTH)


def test_many_effects_are_refused_at_once(tmp_path):
    """A bug: 70 000 effects took more than a minute."""
    effects = [{"effect": "viscous_friction", "params": {"rate": 0.1}}] * 70_000
    (tmp_path / "m.json").write_text(json.dumps({"gsid_model": 1, "fs_hz": 100.0, "effects": effects}))
    with pytest.raises(InputError, match=r"too many effects.*70000, at most 100"):
        load_model(tmp_path / "m.json")


@pytest.mark.parametrize("key", ["u_unit", "y_unit", "fs_hz", "fit"])
@pytest.mark.parametrize("value", [[], [1, "x"], {"a": 1}, True, ESCAPE, "x" * 100_000])
@pytest.mark.parametrize("kind", ["rational", "matrix"])
def test_values_of_the_wrong_kind_are_bad_input(tmp_path, kind, key, value):
    """Bugs: a list for a unit was an internal error, a list for the rate a usage error."""
    if key == "fit" and value in ([], {"a": 1}):
        return
    of_kind = {
        "rational": {"rational": {"num": [1.0], "den": [1.0, 1.0]}},
        "matrix": {"common_denominator": {"sections": [1.0], "num": [[[1.0]]], "delay_s": [[0.0]]}},
    }
    name = {"u_unit": "u_units", "y_unit": "y_units"}.get(key, key) if kind == "matrix" else key
    value = [value] if name.endswith("units") else value
    (tmp_path / "m.json").write_text(json.dumps({"gsid_model": 1, **of_kind[kind], name: value}))
    with pytest.raises(InputError, match="not usable"):
        load_model(tmp_path / "m.json")


@pytest.mark.parametrize("key", ["num", "den", "covariance"])
@pytest.mark.parametrize("value", [1e308, "1.0", None, [1.0]])
def test_coefficients_that_are_no_moderate_numbers_are_bad_input(tmp_path, key, value):
    """A bug: a numerator of 1e308 was an internal error of `gsid compare`; texts were taken for numbers."""
    rational = {"num": [1.0], "den": [1.0, 1.0], "covariance": [[1.0, 0.0], [0.0, 1.0]]}
    rational[key][-1] = value
    (tmp_path / "m.json").write_text(json.dumps({"gsid_model": 1, "rational": rational}))
    with pytest.raises(InputError, match="not usable"):
        load_model(tmp_path / "m.json")


@pytest.mark.parametrize("value", ["0", "-60", "1e30", "nan", "inf", "0.5", "", "9" * 20])
def test_a_period_that_none_can_have_is_bad_input(tmp_path, value):
    """Bugs: 0 was an internal error, 1e30 a usage error."""
    rows = "".join(f"{u},{u}\n" for u in U)
    (tmp_path / "rec.csv").write_text(f"# fs_hz: 100\n# period_samples: {value}\nu,y\n{rows}")
    with pytest.raises(InputError, match="period_samples is not a whole number"):
        read_record(tmp_path / "rec.csv")


@pytest.mark.parametrize("period", [0, 3, -5, 121, 10**6, 2**62])
def test_a_period_beyond_the_record_is_bad_input(period):
    with pytest.raises(InputError, match=r"out of range|fewer than two good periods"):
        split_periods(record(period_samples=period))


@pytest.mark.parametrize(
    "channels", [None, -1, "u", {"a": 1}, [None], [{"name": ["u"]}], [{"name": "u", "unit": 5}]]
)
def test_channels_of_the_wrong_kind_are_bad_input(tmp_path, channels):
    """A bug: `channels: null` was an internal error."""
    beside = {"fs_hz": 100.0, "files": ["rec.csv"], "channels": channels}
    (tmp_path / "meta.json").write_text(json.dumps(beside))
    (tmp_path / "rec.csv").write_text("u,y\n" + "".join(f"{u},{u}\n" for u in U))
    with pytest.raises(InputError, match="channels is not a list") as caught:
        read_record(tmp_path / "rec.csv")
    assert "meta.json" in caught.value.where


@pytest.mark.parametrize("scale", [1e300, 1e120, 1e-120, 1e-310])
@pytest.mark.parametrize("name", ["u", "y"])
def test_samples_whose_squares_are_no_doubles_are_bad_input(name, scale):
    samples = {"u": U, "y": U * 0.5}
    samples[name] = samples[name] * scale
    with pytest.raises(InputError, match=f"samples of {name} are too"):
        split_periods(Record(**samples, fs_hz=100.0))


HISTORY = {
    "effect": "viscous_friction",
    "params": {"rate": {"value": 200.0, "std": None}},
    "before": {"cost_per_dof": 2.0, "rms_error": 0.2, "noise_floor_rms": 0.1},
    "after": {"cost_per_dof": 1.0, "rms_error": 0.1, "noise_floor_rms": 0.1},
    "held_out": {"before": 0.2, "after": 0.1},
    "noise_floor_rms": 0.1,
    "kept_out": "the later periods",
}


def test_a_history_is_read_with_each_value_of_its_kind():
    """A bug: a text for a number of a step was an internal error when the ladder was printed."""
    effects = [{"effect": "rigid_body", "params": {"gain": 500.0}}]

    def rows(**wrong):
        step = {"add": "viscous_friction", "rung": HISTORY | wrong}
        data = {"gsid_model": 1, "fs_hz": 100.0, "effects": effects, "history": [step]}
        return ladder(PlantModel.from_dict(data)).rows()

    assert rows()
    for key in HISTORY:
        for value in ([1], {"a": "b"}, True, ESCAPE):
            with pytest.raises(InputError, match="history cannot be read"):
                rows(**{key: value})


@pytest.mark.parametrize("constant", [0.0, 1.0])
def test_a_constant_output_has_no_level_to_compare(constant):
    """A bug: `gsid distortion --other-level` of a constant output was an internal error."""
    rng = np.random.default_rng(3)
    sound = distortion(Record(U, U + 0.1 * rng.standard_normal(len(U)), 100.0, period_samples=20))
    still = distortion(Record(2 * U, np.full(len(U), constant), 100.0, period_samples=20))
    with pytest.raises(InputError, match="output is constant"):
        superposition(sound, still)
