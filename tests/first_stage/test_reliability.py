"""Probabilities of a diagnosis: their calibration, and its tables."""

import json
import math
import re
from itertools import product
from types import SimpleNamespace

import from_records_study as study
import numpy as np
import probability_study
import pytest
import reliability
from scipy.special import expit
from test_from_records_study import row

from gsid.diagnosis.from_records import fit_laws, shown_ranking, summary
from gsid.diagnosis.from_records.basis import Basis
from gsid.diagnosis.from_records.probability import (
    CALIBRATION,
    Calibration,
    Probabilities,
    features,
    probabilities,
)
from gsid.diagnosis.from_records.result import RankedLaw
from gsid.diagnosis.from_records.verdict import Decision

BASIS = {"effects": ("coulomb_friction",), "lead": 500.0, "share": 0.99, "margin": 20.0}
BASIS |= {"scatter": 0.01, "scatter_error": 0.01, "adequate": True, "converged": True}
BASIS |= {"beaten": False, "taken_over": False}


def best(**changes):
    return probabilities(Basis(**BASIS | changes)).best


@pytest.mark.parametrize("lead", [-100.0, 0.0, 30.0, 1e3, 1e9])
@pytest.mark.parametrize("share", [-3.0, 0.5, 1.0])
def test_probabilities_are_bounded_and_sum_to_one(lead, share):
    found = probabilities(Basis(**BASIS | {"lead": lead, "share": share}))
    assert found.best + found.other + found.none == pytest.approx(1.0)
    assert min(found.best, found.other, found.none) >= 0
    least = 1 / (CALIBRATION.n_trials + 2)
    assert least <= found.best <= 1 - least < 1


def test_more_evidence_is_never_less_probable():
    grids = {"lead": [0.0, 10.0, 100.0, 1e3, 1e4], "margin": [0.0, 1.0, 6.0, 60.0]}
    grids["share"] = [-1.0, 0.5, 0.95, 1.0]
    for name, values in grids.items():
        others = {key: value for key, value in grids.items() if key != name}
        for fixed in product(*others.values()):
            known = dict(zip(others, fixed, strict=True))
            found = [best(**known, **{name: value}) for value in values]
            assert found == sorted(found), (name, known)
    assert best(lead=1e4) > best(lead=10.0)
    assert best(beaten=True) <= best()
    assert best(taken_over=True, adequate=False) <= best()


def test_a_free_function_counts_only_where_more_than_noise_is_left():
    """Where only noise is left, it followed an error of the measured motion."""
    assert best(taken_over=True) == best()


def summary_of(of_laws, verdict="missing_effect", **changes):
    """The ranking with its probabilities, and whether there were trials like this diagnosis."""
    run = {"cut": False, "interrupted": False, "in_closed_loop": False, "known": [], "given": None} | changes
    names = [("coulomb_friction",), ("stribeck_friction",), (), ("cubic_spring",), ("hard_stop",)]
    ranking = [RankedLaw(name, {}, 1.0, 1.0, 1.0, 0.0, True) for name in names]
    basis = Basis(**BASIS | {"effects": ("coulomb_friction", "stribeck_friction")})
    run = SimpleNamespace(**run)
    like = summary._is_like_trials(run, run, Decision(verdict))
    return {
        one.effects: one.probability for one in shown_ranking.with_probabilities(ranking, basis, of_laws)
    }, like


def test_the_entries_of_the_ranking_sum_to_one_and_members_of_a_group_share_theirs():
    found, like = summary_of(Probabilities(0.9, 0.04, 0.06))
    assert like
    assert sum(found.values()) == pytest.approx(1.0)
    assert found[("coulomb_friction",)] == found[("stribeck_friction",)] == pytest.approx(0.45)
    assert found[("cubic_spring",)] == found[("hard_stop",)] == pytest.approx(0.02)
    assert found[()] == pytest.approx(0.06)


WITHOUT = [{"cut": True}, {"interrupted": True}, {"in_closed_loop": True}, {"known": ["a law"]}]
WITHOUT.append({"given": SimpleNamespace(has_controller=True)})


@pytest.mark.parametrize("case", [*WITHOUT, {"verdict": "adequate"}])
def test_without_trials_like_it_a_diagnosis_states_no_probability(case):
    found, like = summary_of(None, **case)
    assert not like
    assert set(found.values()) == {None}


@pytest.mark.parametrize(("is_fitted", "is_over", "cut"), [(1, 1, False), (0, 1, True), (0, 0, False)])
def test_bug_a_fit_that_the_time_stopped_hid_the_probability(monkeypatch, is_fitted, is_over, cut):
    """Only a law that was left out for lack of time hides it; a fit that was stopped was given up."""
    monkeypatch.setattr(fit_laws, "_add_bias", lambda run, fits: None)
    fitted = SimpleNamespace(cost=1.0) if is_fitted else None
    fits = SimpleNamespace(fit=lambda *_: fitted)
    run = SimpleNamespace(
        laws=[],
        final=None,
        cut=False,
        deadline=SimpleNamespace(is_over=bool(is_over), is_used_up=bool(is_over)),
        decide=lambda: None,
        given=None,
        null=SimpleNamespace(noise_p_value=0.0),
        alpha=0.05,
    )
    fit_laws._fit_laws(run, fits, [SimpleNamespace(model=None, effect="coulomb_friction")])
    assert run.cut is cut


def synthetic(rng, n, slope):
    """Rows of diagnoses whose best law is right with the logistic probability of their lead."""
    rows = []
    for index in range(n):
        lead = 10 ** rng.uniform(0, 4)
        right = rng.random() < expit(slope * (math.log10(1 + lead) - 2))
        basis = BASIS | {"lead": lead, "effects": ["coulomb_friction"], "margin": 0.0, "share": 0.0}
        rows.append(row("single" if right else "removed", basis=basis, index=index))
    return rows


def test_the_fit_finds_the_coefficients_that_made_the_rows():
    seed = 20261123
    rows = synthetic(np.random.default_rng(seed), 3000, 3.0)
    found = probability_study.fit(rows, "test")
    assert found.lead == pytest.approx(3.0, abs=0.3), seed
    assert found.intercept == pytest.approx(-6.0, abs=0.7), seed
    assert (found.margin, found.share, found.outside, found.n_trials) == (0, 0, 0, 3000)


def test_the_mix_is_that_of_the_calibration():
    rows = [row(basis=BASIS | {"effects": ["coulomb_friction"]})] * 3 + [row("null", basis=BASIS)] * 12
    weights = probability_study.weights(rows)
    assert weights[:3].sum() == pytest.approx(weights.sum() / 2)
    assert weights.sum() == pytest.approx(len(rows))


def test_no_trial_is_predicted_by_a_fit_that_contains_it(monkeypatch):
    rows = synthetic(np.random.default_rng(1), 40, 3.0)
    rows += [one | {"kind": "removed"} for one in rows]  # of the same trials
    used, plain = [], probability_study.fit

    def fit(some, source):
        used.append({probability_study.trial_of(one) for one in some})
        return plain(some, source)

    monkeypatch.setattr(probability_study, "fit", fit)
    checked = probability_study.cross_validated(rows)
    assert len(checked) == len(rows)
    assert all(sum(probability_study.trial_of(one) not in part for part in used) == 1 for one in rows)


def test_the_same_row_has_the_same_probability_after_json():
    known = json.loads(json.dumps(row(basis=BASIS)))
    again = probabilities(reliability.basis_of(known))
    assert again == probabilities(Basis(**BASIS))
    assert features(reliability.basis_of(known)) == features(Basis(**BASIS))


def stated(p, right, kind="single"):
    effects = ["coulomb_friction"] if right else ["cubic_spring"]
    probability = {"best": p, "other": 0.0, "none": 1 - p}
    return row(kind, basis=BASIS | {"effects": effects}, probability=probability)


def test_the_bins_add_up_and_their_interval_is_that_of_clopper_and_pearson():
    rows = [stated(0.97, True)] * 9 + [stated(0.97, False)] + [stated(0.2, False)] * 5 + [row()]
    some = reliability.pairs(rows)
    lines = reliability.lines(some)
    assert [line[1:4] for line in lines] == [["0.200", 0, 5], ["0.970", 9, 10], ["0.713", 9, 15]]
    assert lines[1][-1] == "0.555 to 0.997"
    assert reliability.brier(some) == pytest.approx((9 * 0.03**2 + 0.97**2 + 5 * 0.2**2) / 15)


def test_a_law_found_with_its_family_taken_out_is_not_right():
    assert reliability.is_first_right(stated(0.9, True))
    assert not reliability.is_first_right(stated(0.9, True, "removed"))
    assert reliability.pairs([stated(0.9, True, "removed")], reliability.NONE) == [(pytest.approx(0.1), True)]


def test_the_page_has_the_reliability_of_each_start_and_the_sums(tmp_path):
    rows = [stated(0.9, True) | {"start": start} for start in study.STARTS]
    rows += [stated(0.2, False, "removed"), row(kind="null", hidden=None, drop=0.0, verdict="adequate")]
    text = study.table(rows, "make it")
    assert "| all | 3 | 1 | 0 | 0 | 4 | 3 | 2.9 of 4 |" in text
    assert "4 of 5 diagnoses state one" in text
    picture = tmp_path / "r.png"
    reliability.draw(
        {of: reliability.pairs(rows, of) for of in (reliability.FIRST, reliability.NONE)}, picture
    )
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_study_states_the_probabilities_of_the_present_coefficients():
    """Coefficients may change after a long study: they move no decision."""
    before = stated(0.123, True)
    after = reliability.by_present_coefficients(before)
    assert after["probability"]["best"] == best()
    assert after["probability"].keys() == before["probability"].keys()
    assert reliability.by_present_coefficients(row()) == row()


def test_the_coefficients_name_their_study():
    assert isinstance(CALIBRATION, Calibration)
    assert re.search(r"study, seeds? .*: \d+ diagnoses of \d+ trials", CALIBRATION.source)
    assert CALIBRATION.n_trials > 0
    assert 0 <= CALIBRATION.other < 1
