"""Which files belong to which unit, addresses, and recipes that are refused."""

import json
import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from gsid.base.errors import InputError
from gsid.cli.fleet_verb import VerbOfRecipe
from gsid.cli.main import gsid
from gsid.fleet import address as addresses
from gsid.fleet.address import address, record_digest
from gsid.fleet.plan import Shard, Unit, read_plan, units_of, write_plan
from gsid.fleet.recipe import Recipe, read_recipe
from gsid.fleet.unit import Job


def files(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    return str(folder)


def found(paths, pattern=None):
    recipe = Recipe(Path("r.toml"), "diagnose", pattern=re.compile(pattern) if pattern else None)
    return [(u.name, u.time, u.group, [Path(r).name for r in u.records]) for u in units_of(paths, recipe)]


def test_the_files_of_a_folder_are_a_unit(tmp_path):
    top = files(tmp_path, "SN2/b.csv", "SN2/a.csv", "SN10/x/a.npz", "lone.csv", "SN2/notes.txt")
    assert found([top]) == [
        (tmp_path.name, None, None, ["lone.csv"]),
        ("SN10/x", None, None, ["a.npz"]),
        ("SN2", None, None, ["a.csv", "b.csv"]),
    ]
    assert found([f"{top}/SN2"]) == [("SN2", None, None, ["a.csv", "b.csv"])]
    assert found([f"{top}/SN2/a.csv"]) == [("a", None, None, ["a.csv"])]


def test_a_pattern_finds_unit_time_and_group(tmp_path):
    top = files(
        tmp_path,
        "A/7_2026-01_0.csv",
        "A/8_2026-01_0.csv",
        "A/7_2026-02_0.csv",
        "A/7_2026-01_1.csv",
        "A/z.csv",
    )
    pattern = r"(?P<group>[^/]+)/(?P<unit>\d+)_(?P<time>[\d-]+)_"
    assert found([top], pattern) == [
        ("7", "2026-01", "A", ["7_2026-01_0.csv", "7_2026-01_1.csv"]),
        ("7", "2026-02", "A", ["7_2026-02_0.csv"]),
        ("8", "2026-01", "A", ["8_2026-01_0.csv"]),
    ]


def test_a_unit_whose_records_are_apart_is_refused(tmp_path):
    top = files(tmp_path, "day1/7.csv", "day2/7.csv")
    with pytest.raises(InputError, match="several folders"):
        found([top], r"(?P<unit>\d+)\.csv")
    with pytest.raises(InputError, match="no record"):
        found([top], r"(?P<unit>[A-Z]+)\.csv")


def test_an_address_is_the_content(tmp_path):
    files(tmp_path, "a.csv", "other/a.csv")
    (tmp_path / "other/a.csv").write_text("a.csv")
    same = [record_digest(tmp_path / name) for name in ("a.csv", "other/a.csv")]
    assert same[0] == same[1]
    (tmp_path / "other/meta.json").write_text("{}")  # it may hold the rate
    assert record_digest(tmp_path / "other/a.csv") != same[0]
    keys = {
        address(work, options, digests)
        for work in "ab"
        for options in ({}, {"c": 1})
        for digests in (["1"], ["1", "2"], ["2", "1"])
    }
    assert len(keys) == 12


def test_an_address_changes_with_the_version_of_the_answers(monkeypatch):
    before = address("a", {}, [])
    monkeypatch.setattr(addresses, "ANSWERS", 10**6)
    assert address("a", {}, []) != before


def test_shards_are_a_partition(tmp_path):
    units = [Unit(str(i), (f"{i}.csv",)) for i in range(300)]

    def job_of(unit):
        return Job(address("a", {}, [unit.name]), "m:f", unit.name)

    names = []
    for i in range(1, 5):
        plan = write_plan(tmp_path, Shard(i, 4), {}, units, job_of)
        names += [planned.unit.name for planned in read_plan(plan)]
    assert sorted(names, key=int) == [unit.name for unit in units]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("verb = ", "not TOML"),
        ("verbs = 'diagnose'", "unknown key"),
        ("seconds = 3", "no verb"),
        ("verb = 'diagnose'\nseconds = -1", "positive"),
        ("verb = 'diagnose'\nmemory_mb = true", "positive"),
        ("verb = 'diagnose'\nunit = '('", "regular expression"),
        ("verb = 'diagnose'\nunit = 'SN'", "needs the group unit"),
        ("verb = 'diagnose'\noptions = 3", "not a table"),
    ],
)
def test_a_bad_recipe_is_refused(tmp_path, text, what):
    path = tmp_path / "r.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=what) as caught:
        read_recipe(path)
    assert "r.toml" in caught.value.where


def test_a_damaged_plan_is_refused(tmp_path):
    path = write_plan(tmp_path, Shard(), {}, [Unit("a", ())], lambda unit: Job("0" * 64, "m:f", "a"))
    lines = path.read_text().splitlines()
    path.write_text(lines[0] + "\n" + lines[1][:20])
    with pytest.raises(InputError, match="damaged"):
        list(read_plan(path))
    path.write_text(json.dumps({"gsid_fleet": 99}))
    with pytest.raises(InputError, match="not a plan of this version"):
        list(read_plan(path))


def test_bug_the_recipe_took_h_from_the_help_of_its_verb(tmp_path, monkeypatch):
    """A command keeps the help option of its first use, and a recipe parses the words of its verb."""
    path = tmp_path / "recipe.toml"
    path.write_text('verb = "noise"\n')
    command = gsid.get_command(click.Context(gsid), "noise")
    monkeypatch.setattr(command, "_help_option", None, raising=False)
    VerbOfRecipe(read_recipe(path))
    assert "-h, --help" in CliRunner().invoke(gsid, ["noise", "--help"]).output
