"""The page docs/how-to/fleet.md, and the page of a fleet."""

import csv
import re
import shlex
import shutil
from pathlib import Path

import pytest
from drift_study import DRIFTED, write_fleet
from fleet_works import write_records
from numpy.random import default_rng

from gsid.cli.main import main
from gsid.fleet.findings import find
from gsid.fleet.page import write_page
from gsid.fleet.table import Merged

PAGE = Path(__file__).parents[2] / "docs/how-to/fleet.md"


def rows_of(folder):
    """Rows of units.csv."""
    return list(csv.DictReader((folder / "units.csv").read_text().splitlines()))


def test_the_recipe_of_the_page_runs(tmp_path, monkeypatch, capsys):
    """By the shards of the page: the cluster takes longer to start, and has its own test."""
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text()
    recipe = re.search(r"```toml\n(.*?)```", text, re.S)[1]
    assert len(recipe.splitlines()) <= 10
    Path("recipe.toml").write_text(recipe)
    for i, folder in enumerate(sorted(write_records(tmp_path / "made", 2).iterdir())):
        Path("records/line1").mkdir(parents=True, exist_ok=True)
        shutil.move(folder / "record.npz", f"records/line1/SN{i:04d}_2026-01-0{i + 1}.npz")
    typed = re.findall(r"^gsid (fleet .*(?:--shard|merge).*)$", text, re.M)
    assert len(typed) == 3
    assert [main(shlex.split(line)) for line in typed] == [0, 0, 0]
    assert capsys.readouterr().out.startswith("done: 2\nfailed: 0\nmissing: 0\n")
    rows = rows_of(Path("fleet"))
    assert [(row["unit"], row["group"], row["status"]) for row in rows] == [
        ("SN0000", "line1", "done"),
        ("SN0001", "line1", "done"),
    ]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """Folder of a simulated fleet with its page."""
    folder = tmp_path_factory.mktemp("fleet")
    write_fleet(folder, default_rng(2), n=60, n_times=2, drifts=False)
    write_page(folder, find(folder, 0.01), Merged({"done": 120}, [("<b>SN9</b>", "signal: SIGSEGV")]))
    return folder


def test_the_page_has_its_pictures_and_tables(fleet):
    page = (fleet / "fleet.html").read_text()
    titles = re.findall(r"<h2>(.*?)</h2>", page)
    assert titles == [
        "Missing effects",
        "Units against the fleet",
        "Drift",
        "Failed units",
        "Parameters over the fleet",
    ]
    assert page.count("<svg") == 6  # three for each width of the screen
    assert "&lt;b&gt;SN9" in page
    assert "<script" not in page
    assert not re.search(r'(?:src|href)="https?:', page)


def test_every_unit_has_a_row(fleet):
    rows = rows_of(fleet)
    assert len(rows) == 60
    assert {row["drift"] for row in rows} == {"False"}
    assert DRIFTED not in {row["unit"] for row in rows}
