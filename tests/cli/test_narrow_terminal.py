"""On a narrow terminal no name that has to be typed is cut."""

import importlib
import re

import click
import pytest

import gsid.cli.output
from gsid.base.tables import Table
from gsid.cli.main import VERBS
from gsid.cli.output import column_widths, print_table
from gsid.effects.types import catalogue
from gsid.plant.model import PlantModel

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*[a-z]")
WIDTHS = (80, 60)


@pytest.fixture(params=WIDTHS)
def terminal(request, monkeypatch):
    """A terminal of so many columns on stdout."""
    monkeypatch.setenv("COLUMNS", str(request.param))
    monkeypatch.setattr(gsid.cli.output, "is_terminal", lambda stream: True)
    return request.param


def words(text):
    return set(re.findall(r"\w+", text))


def commands():
    """Every command with the words by which it is called."""
    for verb in VERBS:
        word = verb.replace("-", "_")
        command = getattr(importlib.import_module(f"gsid.cli.{word}"), word)
        yield (verb,), command
        if isinstance(command, click.Group):
            yield from (((verb, kind), one) for kind, one in command.commands.items())


def test_effects_shows_every_name_whole(gsid, terminal):
    """Bug: `gsid effects` on 80 columns printed position_velocity_…"""
    result = gsid("effects")
    names = {e.id for e in catalogue().values()} | {
        p.name for e in catalogue().values() for p in e.parameters
    }
    assert names <= words(result.out)
    assert "…" not in result.out
    assert max(map(len, result.out.splitlines())) <= terminal


@pytest.mark.parametrize("called", [called for called, _ in commands()], ids=" ".join)
@pytest.mark.parametrize("columns", WIDTHS)
def test_help_shows_every_option_whole(gsid, monkeypatch, called, columns):
    """Bug: a line of a help text ended within the name of an option."""
    command = dict(commands())[called]
    texts = [command.help or "", *(p.help or "" for p in command.params if isinstance(p, click.Option))]
    monkeypatch.setenv("COLUMNS", str(columns))
    shown = OPTION.findall(gsid(*called, "--help").out)
    for name in {name for text in texts for name in OPTION.findall(text)}:
        written = sum(OPTION.findall(text).count(name) for text in texts)
        rows = sum(name in p.opts for p in command.params)
        assert shown.count(name) >= written + rows, name


def test_fit_and_add_show_every_parameter_whole(gsid, rec_csv, terminal):
    effects = [
        {"effect": "rigid_body", "params": {"gain": 7.4}},
        {"effect": "viscous_friction", "params": {"rate": 11.0}},
        {"effect": "transport_delay", "params": {"delay_s": {"value": 0.0051, "free": False}}},
    ]
    PlantModel.from_dict({"gsid_model": 1, "fs_hz": 1000, "effects": effects}).save("m.json")
    names = {"rigid_body", "gain", "viscous_friction", "rate", "transport_delay", "delay_s"}
    fitted = gsid("fit", rec_csv, "--model", "m.json")
    assert fitted.code == 0, fitted.err
    assert names <= words(fitted.out)
    added = gsid("add", "torque_bias", rec_csv, "--model", "m.json", "-o", "m2.json")
    assert added.code == 0, added.err
    assert names | {"torque_bias"} <= words(added.out)
    assert "…" not in fitted.out + added.out


def test_the_table_of_diagnose_shows_every_effect_whole(capsys, terminal):
    effects = [e.id for e in catalogue().values()]
    header = ["round", "probability", "effects", "cost per d.o.f. before", "after"]
    print_table(Table(header, [["1", "99.9%", " or ".join(effects), "1234.5", "1.002"]], left=["effects"]))
    assert set(effects) <= words(capsys.readouterr().out)


def test_columns_give_way_as_far_as_their_words():
    columns = [("effect", "a_long_name"), ("what", "one two three")]
    assert column_widths(columns, 30) == [11, 13]
    assert column_widths(columns, 18) == [11, 7]
    assert column_widths(columns, 16) == [11, 5]
    assert column_widths(columns, 15) is None
