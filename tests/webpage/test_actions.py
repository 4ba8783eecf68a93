"""Wishes of the page and their commands."""

import click
import pytest

import gsid
from gsid.base.errors import InputError
from gsid.base.tables import templates
from gsid.cli.main import Verbs
from gsid.study.folder import Study
from gsid.webpage.actions import ACTIONS, FACTORS, FORM, UNITS, command_of, reading_of

ALL = {
    "--u": "i_q",
    "--y": "rate",
    "--r": "ref",
    "--fs": "2000",
    "--period": "4000",
    "--settle": "0",
    "--hold": "zoh",
    "--output": "rate",
    "--u-unit": "A",
    "--y-unit": "deg/s",
    "--u-factor": "0.5",
    "--y-factor": "2",
    "--r-factor": "2",
}
CONVERSIONS = {*UNITS, *FACTORS}


@pytest.fixture
def study(tmp_path):
    study = Study(tmp_path / "study")
    (tmp_path / "rec.csv").write_text("u,y\n1,2\n")
    study.add_file(tmp_path / "rec.csv")
    for name in ("1-start", "1-add"):
        (study.folder / f"models/{name}.json").write_text("{}")
    return study


def request_of(verb, **more):
    action = ACTIONS[verb]
    model = {"model": "models/1-start.json"} if action.needs_model else {}
    own = {
        "add": {"effect": "coulomb_friction"},
        "cut": {"from": "0.5", "to": 2},
    }.get(verb, {})
    return {"verb": verb, "records": ["records/rec.csv"], **model, **own, **more}


def options_of(verb):
    """Options of a command of gsid, that which names what y is as `--output` only."""
    command = Verbs().get_command(None, verb)
    return {
        name
        for option in command.params
        if isinstance(option, click.Option)
        for name in option.opts
        if name != "--output" or isinstance(option.type, click.Choice)
    }


@pytest.mark.parametrize("verb", ACTIONS)
def test_each_action_has_the_options_of_its_command(verb):
    own = set(ACTIONS[verb].options)
    assert own - CONVERSIONS == options_of(verb) & set(FORM)
    converts = {"--unit", "--factor"} <= options_of(verb) and verb != "cut"  # a part is kept as measured
    wanted = CONVERSIONS - (set() if "--r" in own else {"--r-factor"}) if converts else set()
    assert own & CONVERSIONS == wanted


@pytest.mark.parametrize("verb", ACTIONS)
def test_options_that_a_verb_lacks_are_dropped(study, verb):
    _, arguments, _ = command_of(study, request_of(verb, options=ALL))
    given = {word.partition("=")[0] for word in arguments if "=" in word} - {"--from", "--to"}
    converts = {"--unit", "--factor"} if CONVERSIONS & set(ACTIONS[verb].options) else set()
    assert given == set(ACTIONS[verb].options) - CONVERSIONS | converts
    command = Verbs().get_command(None, verb)
    # A command keeps the help option of the first context that it sees: it has to be that of `gsid`.
    context = click.Context(command, help_option_names=["-h", "--help"])
    command.make_parser(context).parse_args(arguments[1:])  # raises on an unknown option


def test_bug_what_the_output_is_could_not_be_chosen_on_the_page():
    """A linear model of the angle was found for a record in deg/s, and no step accepted it."""
    page = templates().get_template("studio.html").render(folder="st", effects=[])
    assert [option for option in FORM if f'name="{option}"' not in page] == []


def test_values_follow_their_names(study):
    _, arguments, _ = command_of(study, request_of("start", options=ALL))
    assert {"--u=i_q", "--fs=2000.0", "--period=4000", "--settle=0", "--hold=zoh"} <= set(arguments)


def test_a_unit_and_a_factor_have_the_name_of_their_column(study):
    options = {"--y": "gyro [rad/s]", "--y-unit": "deg/s", "--y-factor": "57.3", "--u-unit": "A"}
    _, arguments, _ = command_of(study, request_of("look", options=options))
    assert {"--unit=gyro [rad/s]=deg/s", "--factor=gyro [rad/s]=57.3", "--unit=u=A"} <= set(arguments)
    assert reading_of(options)["units"] == {"gyro [rad/s]": "deg/s", "u": "A"}
    assert reading_of(options)["factors"] == {"gyro [rad/s]": 57.3}


@pytest.mark.parametrize(
    ("name", "value"),
    [("--y-factor", "nan"), ("--y-factor", "two"), ("--u-unit", "a\nb"), ("--u-unit", ["V"])],
)
def test_a_conversion_of_the_wrong_type_is_refused(study, name, value):
    with pytest.raises(gsid.InputError):
        command_of(study, request_of("start", options={name: value}))


def test_a_column_with_a_non_breaking_space_is_selected_on_the_page(study):
    _, arguments, _ = command_of(study, request_of("look", options={"--u": "Drive\u00a0[V]"}))
    assert "--u=Drive\u00a0[V]" in arguments


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("--period", 3.7),
        ("--period", "3.7"),
        ("--period", float("inf")),  # 1e400 in JSON
        ("--period", "1e400"),
        ("--period", 10**400),
        ("--period", True),
        ("--period", [4]),
        ("--settle", "x"),
        ("--fs", "nan"),
        ("--fs", {}),
        ("--fs", {"a": 1}),
        ("--u", ["u"]),
        ("--u", "a\0b"),
        ("--u", "a\u2028b"),
        ("--u", "a\x85b"),
        ("--u", "a" * 201),
        ("--hold", "maybe"),
        ("--hold", ["zoh"]),
        ("--output", "m.json"),
        ("--library", "./evil.so:f"),
        ("--library", ""),
    ],
)
def test_values_of_the_wrong_type_are_refused(study, name, value):
    with pytest.raises(gsid.InputError):
        command_of(study, request_of("start", options={name: value}))


@pytest.mark.parametrize("value", [None, "", "8", 8, 8.0])
def test_an_empty_field_is_no_option(study, value):
    _, arguments, _ = command_of(study, request_of("look", options={"--period": value}))
    assert ("--period=8" in arguments) == (value not in (None, ""))


@pytest.mark.parametrize(
    "wrong",
    [
        {"verb": ["look"]},
        {"verb": {}},
        {"verb": None},
        {"effect": ["coulomb_friction"]},
        {"effect": {}},
        {"records": [["records/rec.csv"]]},
        {"records": [None]},
        {"model": ["models/1-start.json"]},
        {"model": "models/a\0b"},
        {"model": "records/rec.csv"},
        {"options": "--u"},
    ],
)
def test_requests_of_the_wrong_type_are_refused(study, wrong):
    with pytest.raises(gsid.InputError):
        command_of(study, request_of("add") | wrong)


@pytest.mark.parametrize("name", ["notes.txt", "meta.json", "page.html", "none"])
def test_a_file_that_is_no_record_is_refused(study, name):
    (study.folder / "records" / name).write_text("")
    with pytest.raises(gsid.InputError, match="not a record"):
        command_of(study, request_of("look", records=[f"records/{name}"]))


def test_the_case_of_the_extension_does_not_matter(study):
    (study.folder / "records/REC.CSV").write_text("")
    assert command_of(study, request_of("look", records=["records/REC.CSV"]))


def test_each_request_has_a_number_of_its_own(study):
    requests = [command_of(study, request_of("start")) for _ in range(2)]
    assert [number for number, _, _ in requests] == [2, 3]  # models/1-start.json is there
    assert requests[0][2] == ["verdicts/2-start.json", "models/2-start.json"]


def test_a_part_is_cut_of_one_record_at_finite_times(study):
    _, arguments, outputs = command_of(study, request_of("cut", options={"--fs": "100"}))
    assert arguments[:3] == ["cut", "records/rec.csv", "--from=0.5"]
    assert outputs == ["records/2-cut.csv"]
    for wrong in ({"from": "1e999"}, {"to": None}, {"to": "--undo"}, {"records": ["records/rec.csv"] * 2}):
        with pytest.raises(gsid.InputError):
            command_of(study, request_of("cut") | wrong)


def test_c_is_written_with_its_header_and_reads_no_record(study):
    _, arguments, outputs = command_of(study, request_of("export-c", records=[]))
    assert arguments == ["export-c", "models/1-start.json", "-o", "models/axis_2.c", "--json"]
    assert outputs == ["models/axis_2.c", "models/axis_2.h"]


def test_a_report_may_have_a_model(study):
    model = {"model": "models/1-start.json"}
    assert "--model" not in command_of(study, request_of("report"))[1]
    _, arguments, outputs = command_of(study, request_of("report") | model)
    assert arguments[arguments.index("--model") + 1] == model["model"]
    assert outputs == ["verdicts/3-report.html"]


START, ADD = "models/1-start.json", "models/1-add.json"


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({}, []),
        ({"sigma": "0.002", "realisation": "2"}, ["--sigma=0.002", "--realisation=2"]),
        (
            {"limit_command": 5, "limit_travel_deg": 20, "model": START},
            ["--limit-command=5", "--limit-travel-deg=20", "--model", START],
        ),
        (
            {"goal": "parameters", "sigma": 0.05, "model": START, "rival": ADD},
            ["--parameter-sigma=0.05", "--model", START],
        ),
        (
            {"goal": "rival", "sigma": 0.05, "realisation": 2, "model": START, "rival": ADD},
            ["--model", START, "--rival", ADD],
        ),
    ],
)
def test_a_next_experiment_has_the_words_of_its_goal(study, more, words):
    number, arguments, outputs = command_of(study, request_of("next", **more))
    assert arguments[:-5] == ["next", "records/rec.csv", *words]
    assert outputs == [f"verdicts/{number}-next.json", f"excitation/{number}-next.csv"]


@pytest.mark.parametrize(
    "more",
    [
        {"goal": "rival", "model": START, "rival": START},
        {"goal": "rival", "model": START, "rival": "../secret"},
        {"goal": "rival", "model": START, "rival": None},
        {"goal": "rival", "model": "", "rival": START},
        {"goal": "parameters", "model": START},
        {"goal": "parameters", "sigma": 0.05},
        {"goal": ["response"]},
        {"limit_travel_deg": 20},
        {"limit_command": "--plot=x"},
        {"limit_command": float("nan")},
    ],
)
def test_a_next_experiment_that_is_not_complete_is_refused(study, more):
    with pytest.raises(InputError):
        command_of(study, request_of("next", **more))
