"""gsid fleet: the whole path with a verb, its exit codes, shards, and what is computed again."""

import importlib.util
import json
import os
import sys

import pyarrow.parquet
import pytest

from gsid.cli.main import main

pytestmark = pytest.mark.xdist_group("fleet")
RECIPE = """verb = "noise"
[options]
"""


@pytest.fixture
def gsid(capsys, tmp_path, monkeypatch, records):
    """Run the command in a folder with records and a recipe: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipe.toml").write_text(RECIPE)

    def run(*words):
        capsys.readouterr()
        code = main(list(map(str, words)))
        return code, *capsys.readouterr()

    return run


def table(name):
    return pyarrow.parquet.read_table(name).to_pylist()


def test_shards_merge_to_the_table_of_all(gsid, tmp_path):
    for i in (1, 2):
        assert gsid("fleet", "recipe.toml", "records", "--shard", f"{i}/2", "--out", f"part{i}")[0] == 0
    code, out, _ = gsid("fleet", "merge", "part1", "part2", "--out", "all")
    assert (code, out.splitlines()[:3]) == (0, ["done: 3", "failed: 0", "missing: 0"])
    rows = table("all/units.parquet")
    assert sorted(row["unit"] for row in rows) == ["SN0000", "SN0001", "SN0002"]
    assert {row["status"] for row in rows} == {"done"}
    # one part again is not counted twice; without the other the fleet is not complete
    assert gsid("fleet", "merge", "part1", "part1", "part2", "--out", "all")[1].startswith("done: 3")
    code, _, err = gsid("fleet", "merge", "part1")
    assert (code, "shards are missing" in err) == (3, True)


def test_only_what_is_missing_is_computed(gsid, tmp_path):
    run = ("fleet", "recipe.toml", "records", "--shard", "1/1", "--json")
    assert json.loads(gsid(*run)[1])["status"]["done"] == 3
    assert json.loads(gsid(*run)[1])["status"]["done"] == 0
    (tmp_path / "records/SN0001/record.npz").rename(tmp_path / "records/SN0001/renamed.npz")
    assert json.loads(gsid(*run)[1])["status"]["done"] == 0  # the content counts
    (tmp_path / "recipe.toml").write_text(RECIPE + "u = 'u'\n")
    assert json.loads(gsid(*run)[1])["status"]["done"] == 3
    code, out, err = gsid("fleet", "clean")
    assert (code, out.count("3 results")) == (0, 2)
    assert "repeat with --yes" in err
    gsid("fleet", "clean", "--yes")
    assert "removable: 0 results" in gsid("fleet", "clean")[1]


def test_a_bad_record_is_named_and_the_others_are_done(gsid, tmp_path):
    (tmp_path / "records/SN0001/record.npz").write_bytes(b"PK\3\4 damaged")
    assert gsid("fleet", "recipe.toml", "records", "--shard", "1/1")[0] == 1
    code, out, _ = gsid("fleet", "merge", "fleet")
    assert (code, out.splitlines()[:2]) == (1, ["done: 2", "failed: 1"])
    assert "failed: SN0001: exception: VerbFailed: error:" in out
    assert (
        json.loads(gsid("fleet", "recipe.toml", "records", "--shard", "1/1", "--json")[1])["status"]["done"]
        == 0
    )
    again = gsid("fleet", "recipe.toml", "records", "--shard", "1/1", "--json", "--retry-failed")
    assert json.loads(again[1])["status"] == {"done": 0, "failed": 1, "changed": 0}


@pytest.mark.parametrize(
    ("recipe", "what"),
    [
        ("verb = 'run'", "does not run on a fleet"),
        ("verb = 'fit'\n[options]\nordre = '1/0'", "did you mean order?"),
        ("verb = 'fit'\n[options]\norder = 'x'", "is not POLES/ZEROS"),
        ("verb = 'fit'\n[options]\nplot = 'x.png'", "no such option for a fleet"),
        ("verb = 'diagnose'\n[options]\nmodel = [1, 2]\noutput = 'nothing'", "is not one of"),
    ],
)
def test_a_bad_recipe_ends_with_3(gsid, tmp_path, recipe, what):
    (tmp_path / "recipe.toml").write_text(recipe)
    code, _, err = gsid("fleet", "recipe.toml", "records", "--shard", "1/1")
    assert code == 3
    assert what in err
    assert not (tmp_path / "fleet").exists()


def test_without_the_extra_the_message_names_it(gsid, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    code, _, err = gsid("fleet", "recipe.toml", "records")
    assert code == 3
    assert "pip install 'gsid[fleet]'" in err


def test_the_base_command_does_not_import_the_extra(gsid):
    imported = "sys, gsid.cli.main, gsid.cli.fleet, gsid.fleet.run, gsid.fleet.table, gsid.fleet.cluster"
    script = f"import {imported}; print({{'dask', 'pyarrow'}} & set(sys.modules))"
    assert os.popen(f'{sys.executable} -c "{script}"').read() == "set()\n"
