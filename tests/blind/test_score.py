"""The scorer, with tools that are known to be right, wrong or broken."""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pandas as pd
import pytest
import score
import trials
import truth
from hidden import CONTAINED
from unexplained import unexplained_by_cogging

from gsid.diagnosis.from_records import diagnose as from_records
from gsid.models import load


def says(verdict, *found, probability=0.99, p_value=0.3):
    """A tool's answer: groups found, the first of them first in the ranking too."""
    ranking = [{"effects": list(found[0]), "probability": probability}] if found else []
    return score.NOTHING_SAID | {
        "adequate": verdict == "adequate",
        "p_value": p_value,
        "verdict": verdict,
        "ranking": ranking,
        "found": [list(group) for group in found],
        "seconds": 1.0,
        "error_over_floor": 1.0,
    }


def row(kind, result, hidden=(), drops=()):
    key = {
        "kind": kind,
        "effects": [{"id": effect} for effect in hidden],
        "predicted_drop": list(drops),
        "unexplained": 0.5 * max(drops, default=0),
        "n_periods": 8,
        "n_realisations": 4,
        "noise": {"fan": None, "unlisted": "spikes"},
    }
    return score.Row(key, result)


GOOD = says("adequate")


def single(group, drop=100.0, probability=0.99):
    said = says("missing_effect", group, probability=probability)
    return row("single", said, ["coulomb_friction"], [drop])


def met(figures):
    return {v["text"]: v["met"] for v in score.verdicts(figures)}


def test_single_effects_are_counted_by_group_and_drop():
    rows = [single(["coulomb_friction"])] * 6 + [single(["stribeck_friction", "coulomb_friction"])] * 2
    rows += [single(["cubic_spring"], probability=0.6), single(["cubic_spring"])]
    rows += [row("single", GOOD, ["coulomb_friction"], [5.0])] * 3  # too small to be missed
    figures = score.summary(rows)
    assert figures["first_group"]["hits"] == 8
    assert figures["first_group"]["n"] == 10
    assert figures["alone"]["hits"] == 6
    assert (figures["wrong"]["hits"], figures["confidently_wrong"]["hits"]) == (2, 1)
    assert figures["confusion"] == {
        "coulomb_friction": {
            "coulomb_friction": 6,
            "coulomb_friction or stribeck_friction": 2,
            "cubic_spring": 2,
        }
    }
    power = {tuple(line["drop"]): line for line in figures["power"]}
    assert (power[0, 6]["n"], power[0, 6]["detected"]["hits"]) == (3, 0)
    assert (power[96, 192]["n"], power[96, 192]["in_first_group"]["hits"]) == (10, 8)


def test_an_effect_must_be_named_alone_where_no_other_explains_it():
    near, far = single(["stribeck_friction", "coulomb_friction"], 100.0), single(["coulomb_friction"], 200.0)
    assert (near.separable, far.separable) == (False, True)  # 50 and 100 left by the best other effect
    figures = score.summary([near, far])
    assert (figures["alone_if_separable"]["hits"], figures["alone_if_separable"]["n"]) == (1, 1)


def test_an_effect_that_another_contains_is_never_separable():
    """A bug: of large ones the key, which knows the other as linear, said that they were."""
    key = trials.make_trial(1016, 62, {"single": 1}).key
    assert key["effects"][0]["id"] in CONTAINED
    assert key["predicted_drop"][0] > 9000
    assert key["unexplained"] == 0


@pytest.mark.trial
def test_of_a_pair_that_one_effect_does_as_well_nothing_is_left():
    """A bug: of a cubic spring and an unbalance, which cogging fits within noise, the key, which knew cogging
    as linear, said that it leaves 87; so both were asked for, and cogging was called wrong (seed 1020)."""
    rng = np.random.default_rng(27)
    base = trials.draw_base(rng, None)
    pair = {"cubic_stiffness": 0.4, "unbalance_level": 640.0, "unbalance_angle_deg": 65.0}
    lines, commands = trials.draw_commands(rng, base, 1)
    bench = trials.Bench(commands, tolerance=1e-5)
    variance = np.full((2, trials.N // 2 + 1), 1e-6)
    nulls = trials.Nulls(base, lines, commands, variance, 8)
    drop, *_ = nulls.refit([y for y, *_ in bench.answers(base | pair, truth.COARSE)])
    assert drop > 5000
    assert unexplained_by_cogging(nulls, base | pair, bench, 2) < trials.SEPARABLE / 2


def test_stated_probabilities_are_set_against_what_came_true():
    rows = [single(["coulomb_friction"], probability=0.75)] * 3 + [single(["cubic_spring"], probability=0.75)]
    rows += [single(["coulomb_friction"], probability=1.0)]
    table = {(line["from"], line["to"]): line for line in score.summary(rows)["reliability"]}
    assert table[0.7, 0.8]["stated"] == pytest.approx(0.75)
    assert table[0.7, 0.8]["right"]["share"] == 0.75
    assert table[0.99, 1.0]["right"]["n"] == 1


def test_names_without_a_stated_probability_are_not_called_confident():
    figures = score.summary(
        [single(["coulomb_friction"], probability=None)] * 3 + [single(["cubic_spring"], probability=None)]
    )
    assert figures["wrong"]["hits"] == 1
    assert figures["confidently_wrong"]["n"] == 0
    assert met(figures)["wrong with a stated probability >= 0.95"] is None
    assert all(line["right"]["n"] == 0 for line in figures["reliability"])
    score.page(figures, "make blind")


def test_the_tool_states_the_probability_of_the_group_that_it_names(monkeypatch, tmp_path):
    group = ("coulomb_friction", "stribeck_friction")
    facts = {"adequate": False, "p_value": 0.0, "verdict": "missing_effect", "found": [group], "model": None}
    facts["nearest"] = []
    named = SimpleNamespace(effects=group, probability=0.9, **facts)
    monkeypatch.setattr(from_records, "diagnose", lambda *_, **__: named)
    monkeypatch.setattr(load, "load_model", lambda path: None)
    monkeypatch.setattr(score, "error_over_floor", lambda *_: 1.0)
    assert score.gsid_tool(tmp_path)["ranking"] == [{"effects": list(group), "probability": 0.9}]


@pytest.mark.parametrize(("n_rejected", "kept"), [(5, True), (0, False), (40, False)])
def test_false_alarms_are_held_against_the_binomial_interval(n_rejected, kept):
    rejected = row("null", says("missing_effect", ["cubic_spring"], p_value=0.01))
    rows = [rejected] * n_rejected + [row("null", GOOD)] * (120 - n_rejected)
    figures = score.summary(rows)
    assert met(figures)["null files rejected"] is kept
    assert figures["false_alarms"]["effect_named"]["hits"] == n_rejected


def test_two_effects_count_when_both_are_found():
    def two(*found):
        said = says("missing_effect", *([effect] for effect in found))
        return row("two", said, ["coulomb_friction", "cubic_spring"], [100, 200])

    figures = score.summary(
        [
            two("cubic_spring", "coulomb_friction"),
            two("cubic_spring", "quadratic_drag", "coulomb_friction"),
            two("cubic_spring"),
        ]
    )
    assert figures["both_found"]["hits"] == 2
    assert figures["nothing_else_added"]["hits"] == 1
    near = two("cubic_spring")
    near.result["nearest"] = [["coulomb_friction"]]
    wrong = two("quadratic_drag")
    wrong.result["nearest"] = [["coulomb_friction"], ["cubic_spring"]]
    figures = score.summary([two("cubic_spring", "coulomb_friction"), near, wrong])
    assert figures["both_found"]["hits"] == 1
    assert figures["both_in_answer"]["hits"] == 2


def test_foreign_effects_have_to_be_flagged():
    flagged = row("foreign", says("unknown_effect", ["motor_lag"]), ["creep"], [1e4])
    missed = row("foreign", says("missing_effect", ["motor_lag"]), ["creep"], [1e4])
    figures = score.summary([flagged, missed])
    assert figures["foreign_flagged"]["share"] == 0.5
    assert figures["foreign_by_effect"]["creep"]["n"] == 2
    assert met(figures)["foreign effect flagged"] is False


def test_an_effect_in_an_unlisted_one_s_company_may_be_called_unknown_too():
    said = says("unknown_effect", ["coulomb_friction"])
    assert score.summary([row("dirty", said, ["coulomb_friction"], [1e6])])["dirty_named"]["hits"] == 1
    assert score.summary([row("single", said, ["coulomb_friction"], [1e4])])["first_group"]["hits"] == 0


def test_a_broken_tool_has_not_found_anything():
    said = score.NOTHING_SAID | {"broken": "ValueError: no"}
    figures = score.summary([row("single", said, ["coulomb_friction"], [100.0])])
    assert figures["first_group"]["hits"] == 0
    assert figures["held_out_at_floor"]["hits"] == 0
    assert met(figures)["trials that diagnose did not break off"] is False
    assert score.summary([row("null", said)])["false_alarms"]["n"] == 0
    assert "ValueError: no (1)" in score.page(figures, "make blind")


def test_what_was_not_tried_is_not_called_met():
    figures = score.summary([single(["coulomb_friction"])])
    assert met(figures)["foreign effect flagged"] is None
    assert met(figures)["effect in the first group, drop >= 64"] is True
    assert "not tested" in score.page(figures, "make blind")


def test_held_out_error_is_one_noise_floor_for_the_truth():
    trial = trials.make_trial(2, 1, {"fan": 1})

    class Record:
        def __init__(self, u, y):
            self.u, self.y = u, y

    def truth(u):
        return trials.truth.steady(trial.key["truth"], u, tolerance=1e-6)[0]

    ratio = score.error_over_floor(truth, [Record(u, y) for u, y in trial.held])
    # 2 x 400 complex lines scatter by 2.5 %; the fan's skirts add some 5 % to the floor
    assert ratio == pytest.approx(1, abs=0.12)


def honest_tool(place: Path) -> dict:
    """Peeps at the key: what it says is right."""
    key = json.loads((place.parents[1] / "keys" / f"{place.name}.json").read_text())
    records = sorted(path.name for path in place.iterdir())
    assert records == sorted([f"fit_{i}.npz" for i in range(key["n_realisations"])] + HELD)
    return says("missing_effect", *([effect["id"]] for effect in key["effects"])) if key["effects"] else GOOD


HELD = ["held_0.npz", "held_1.npz", "null.json"]


def failing_tool(place: Path) -> dict:
    raise ArithmeticError(place.name)


@pytest.mark.long
def test_run_continues_where_it_stopped_and_checks_hashed_keys(tmp_path):
    kinds = {"null": 1, "single": 1}
    score.run(tmp_path, 2, 7, kinds, tool=honest_tool, n_processes=1)
    rows = score.run(tmp_path, 4, 7, kinds, tool=failing_tool, n_processes=1)
    assert [("broken" in r.result) for r in rows] == [False, False, True, True]
    assert all(r.right or not r.hidden for r in rows[:2])
    assert not list((tmp_path / "records").iterdir())
    with pytest.raises(click.UsageError, match="other settings"):
        score.run(tmp_path, 4, 8, kinds, tool=honest_tool)
    path = tmp_path / "keys" / "trial_7_00000.json"
    path.write_text(path.read_text().replace('"kind"', '"Kind"'))
    with pytest.raises(RuntimeError, match="not the one that was sealed"):
        score.run(tmp_path, 2, 7, kinds, tool=honest_tool)


def crashing_tool(place: Path) -> dict:
    os.abort()


def test_a_tool_that_crashes_is_broken_and_the_others_run(tmp_path):
    kinds = {"null": 1}
    rows = score.run(tmp_path, 1, 7, kinds, tool=crashing_tool, n_processes=1)
    rows = score.run(tmp_path, 2, 7, kinds, tool=honest_tool, n_processes=1)
    assert [r.result.get("broken") for r in rows] == ["signal: SIGABRT", None]
    assert not list((tmp_path / "fleet").rglob("*.json"))


def test_the_table_of_all_seeds_grows(tmp_path):
    rows = [single(["coulomb_friction"]), row("null", GOOD)]
    for i, one in enumerate(rows):
        one.result["name"] = f"trial_1_{i:05d}"
    path = tmp_path / "trials.parquet"
    assert [score.add_to_table(path, rows[: i + 1], 1) for i in range(2)] == [1, 2]
    for one in rows:
        one.result["name"] = one.result["name"].replace("_1_", "_2_")
    assert score.add_to_table(path, rows, 2) == 4
    table = pd.read_parquet(path)
    assert list(table["right"]) == [True, False, True, False]
    assert set(table["seed"]) == {1, 2}


def test_kinds_come_in_their_shares():
    kinds = [trials._draw_kind(np.random.default_rng([1, i]), trials.KINDS) for i in range(400)]
    for kind, part in trials.KINDS.items():
        assert abs(kinds.count(kind) - 400 * part) < 4 * np.sqrt(400 * part)
