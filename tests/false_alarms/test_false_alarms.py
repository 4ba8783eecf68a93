"""Every study in its short form, and the counting itself."""

import importlib
import json
from dataclasses import replace

import numpy as np
import pytest
import run_studies
import study as studying
from page import put
from study import CELL_CONFIDENCE, Cell, Results, Study, rates, studies

KNOWN = studies()


@pytest.mark.long
@pytest.mark.parametrize("name", KNOWN)
def test_level_is_kept_in_the_short_form(name):
    """At 99.9 % of each cell: the same few seeds are looked at after each change.

    Four of the first 12 stacks fitted to 4 periods are rejected, 36 of the first 600 (4.2 to 8.2 %).
    """
    study = replace(KNOWN[name], confidence=CELL_CONFIDENCE)
    seeds = range(studying.FIRST_SEED, studying.FIRST_SEED + study.n_short)
    outcomes = {
        (cell.name, seed): studying.experiment(study, cell, seed) for cell in study.cells for seed in seeds
    }
    found = rates(study, outcomes)
    missed = [rate for rate in found if rate.met is False]
    assert not missed, f"seeds {seeds.start} to {seeds.stop - 1}"
    assert sum(rate.met is not None for rate in found) >= len(study.cells)


@pytest.mark.parametrize("name", KNOWN)
def test_page_has_a_block_for_every_study(name):
    page = (run_studies.ROOT / "docs/explanation/false_alarms.md").read_text()
    assert f"<!-- {name} -->\n" in page
    assert f"<!-- end {name} -->" in page


def _uniform(cell: Cell, seed: int) -> dict:
    p = cell.rng(seed).random()
    return {"p_value": p**cell.setting, "named": bool(p < 0.001)}


def a_study(**changes):
    cells = (Cell("right", 1.0), Cell("as right", 1.0), Cell("wrong", 1.5))
    given = {"name": "a_study", "title": "A study", "about": "Made of uniform numbers.", "cells": cells}
    given |= {"run": _uniform, "levels": (0.01, 0.05), "n_seeds": 2000, "n_short": 10}
    return Study(**given | changes)


def outcomes_of(study):
    return {
        (cell.name, seed): studying.experiment(study, cell, seed)
        for cell in study.cells
        for seed in range(1, study.n_seeds + 1)
    }


def test_a_wrong_level_is_found_and_a_right_one_is_not():
    study = a_study()
    found = {(rate.cell, rate.level): rate for rate in rates(study, outcomes_of(study))}
    assert found["right", 0.05].met
    assert found["as right", 0.01].met
    assert found["wrong", 0.05].met is False
    assert found["wrong", 0.05].rate == pytest.approx(0.05 ** (1 / 1.5), abs=0.03)
    assert found[studying.POOLED, 0.05].n == 6000
    assert found[studying.POOLED, 0.05].met is False
    assert found["right", None].met is None  # an event, counted only


def test_events_that_must_not_happen_and_rates_that_are_bounds():
    study = a_study(never=("named",))
    assert any(r.met is False for r in rates(study, outcomes_of(study)) if r.outcome == "named")
    below = a_study(cells=(Cell("right", 1.0), Cell("careful", 0.2, at_most=True)))
    found = {(rate.cell, rate.level): rate for rate in rates(below, outcomes_of(below))}
    assert found["careful", 0.05].met
    assert found["careful", 0.05].high < 0.05
    assert (studying.POOLED, 0.05) not in found


def test_cells_outside_of_what_a_test_assumes_are_shown_only():
    study = a_study(cells=(Cell("right", 1.0), Cell("wrong", 1.5, judged=False)))
    found = {(rate.cell, rate.level): rate for rate in rates(study, outcomes_of(study))}
    assert found["wrong", 0.05].met is None
    assert found["wrong", 0.05].low > 0.05
    assert (studying.POOLED, 0.05) not in found


def test_experiments_of_cells_are_independent():
    """With the same noise in two cells the pooled rate would rest on fewer experiments than it states."""
    a, b = ([Cell(name).rng(seed).random() for seed in range(300)] for name in ("a", "b"))
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.2


def test_a_run_that_was_cut_goes_on(tmp_path):
    path = tmp_path / "superposition.jsonl"
    line = {"cell": "c", "seed": 1, "outcome": {"p_value": 0.5}, "commit": "abc"}
    path.write_text(json.dumps(line) + "\n" + json.dumps(line | {"seed": 2})[:20])
    results = Results.load(path)
    assert list(results.outcomes) == [("c", 1)]
    results.append("c", 2, {"p_value": 0.25}, "def")
    assert Results.load(path).outcomes == {("c", 1): {"p_value": 0.5}, ("c", 2): {"p_value": 0.25}}
    assert Results.load(path).commits == ["abc", "def"]


TINY = """
from study import Cell, Study
def run(cell, seed):
    return cell.rng(seed).random()
STUDY = Study("tiny", "Tiny", "", (Cell("a"), Cell("b")), run, (0.05,), 100, 10)
"""


def test_no_experiment_runs_twice(tmp_path, monkeypatch):
    (tmp_path / "tiny.py").write_text(TINY)
    monkeypatch.syspath_prepend(tmp_path)
    tiny, path = importlib.import_module("tiny").STUDY, tmp_path / "results/tiny.jsonl"
    first = studying.run(tiny, path, 2, lambda n, n_all: None)
    written = path.read_text()
    assert len(written.splitlines()) == 4
    assert studying.run(tiny, path, 2, lambda n, n_all: None).outcomes == first.outcomes
    assert path.read_text() == written
    studying.run(tiny, path, 3, lambda n, n_all: None)
    assert path.read_text().startswith(written)
    assert len(path.read_text().splitlines()) == 6


def test_blocks_of_the_page_are_replaced_apart(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Rates\n<!-- a -->\nold\n<!-- end a -->\n\n<!-- b -->\nkept\n<!-- end b -->\n")
    put(str(page), "a", "new\n")
    assert (
        page.read_text() == "# Rates\n<!-- a -->\nnew\n<!-- end a -->\n\n<!-- b -->\nkept\n<!-- end b -->\n"
    )


def test_table_states_denominators_and_intervals(tmp_path):
    study = a_study(n_seeds=200)
    text = run_studies.block(study, Results(tmp_path, outcomes_of(study), ["abc"]), 200)
    assert "Seeds 1 to 200 of each cell, code abc." in text
    assert "| wrong | p value | 0.05 | 200 |" in text
    assert "MISSED" in text
