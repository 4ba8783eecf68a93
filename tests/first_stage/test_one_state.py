"""The parts of a result tell one state: ranking, models, what was not tried, the delay of the hold."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_from_records import linear_loop

import gsid
from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import InputError
from gsid.diagnosis.from_records import find_structure as finding
from gsid.diagnosis.from_records import mend_structure as mending
from gsid.diagnosis.from_records import shown_models, summary
from gsid.diagnosis.from_records.confirm import LINEAR_PART, Simulated
from gsid.diagnosis.from_records.draw_up import give_up
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DEFAULTS, DecisionSettings
from gsid.diagnosis.from_records.verdict import MISSING, NEAREST, UNKNOWN, Decision
from gsid.plant.units import angle_unit_of, kind_of_unit
from gsid.structure import start as structure

LAW = "coulomb_friction"


def fit_of(*effects, cost=100.0, **fit):
    return Simulated(effects, SimpleNamespace(cost=cost, **fit), True, 1.0, 0.0, 0.0)


def a_run(decision):
    run = Run(Deadline(), DecisionSettings(), None, (), lambda text: None)
    run.decision = decision
    return run


def test_bug_a_mended_structure_was_not_that_of_the_ranking(monkeypatch):
    """The stack without an element that had become zero was the model; the ranking had the one before."""
    run = a_run(Decision(MISSING, (LAW,)))
    whole, rival = fit_of(LAW, model=SimpleNamespace(without_effect=lambda name: "smaller")), fit_of("other")
    smaller = fit_of(LAW, cost=100.5)
    run.laws, run.final = [rival, whole], whole
    run.simulations = lambda: SimpleNamespace(fit=lambda model, effects: smaller)
    monkeypatch.setattr(mending, "insignificant", lambda model, settings: ["cable_spring"])
    mending._drop_zeros(run)
    assert run.final is smaller
    assert run.laws == [rival, smaller]


def test_bug_a_law_that_was_found_was_also_not_tried():
    """Its fit beside a constant torque had no work left; that without one is the result."""
    run = a_run(Decision(MISSING, (LAW,)))
    run.null, run.laws = fit_of(), [fit_of(LAW)]
    run.not_tried = {LAW: "no work", LINEAR_PART: "no work", "bouc_wen": "no work", "motor_lag": "no work"}
    of_round = SimpleNamespace(null=None, laws=[fit_of("motor_lag")])
    assert summary._not_tried(run, [of_round]) == {"bouc_wen": "no work"}


def test_bug_effects_that_were_only_nearest_stayed_in_the_model():
    """Two modes of a series were taken from the names, but not from the model with the effects found."""
    removed, fitted = [], fit_of(LAW, model="friction alone")
    given = SimpleNamespace(decision=Decision(MISSING, (LAW,)), settings=DEFAULTS)
    given.deadline, given.final = Deadline(), fit_of(LAW, model="friction and mode")
    given.simulations = lambda: Simulations(removed, fitted)
    rounds = Rounds(given)
    rounds.near = [SimpleNamespace(final=fit_of("flexible_mode"))]
    with_mode = gsid.PlantModel.from_dict(
        {
            "gsid_model": 1,
            "fs_hz": 1000.0,
            "effects": [
                {"effect": "rigid_body", "params": {"gain": 1.0}},
                {"effect": LAW, "params": {"level": 1.0}},
                {"effect": "flexible_mode", "params": {"f_hz": 100.0, "zeta": 0.01, "residue": 0.1}},
            ],
        }
    )
    rounds.fit_named(fit_of(model=with_mode))
    assert [effect.id for effect in removed[0].effects] == ["rigid_body", LAW]
    assert rounds.final.model == "friction alone"
    assert rounds.joint.model is with_mode


@pytest.mark.parametrize("is_same", [True, False])
def test_bug_without_work_for_a_last_fit_the_model_was_one_of_other_effects(is_same):
    """The fit beside the last of two nearest effects contains the other, or lacks the one that is named."""
    given = SimpleNamespace(decision=Decision(MISSING, (LAW,)), settings=DEFAULTS)
    given.deadline, given.final = Deadline(), fit_of(LAW)
    given.simulations = lambda: Simulations([], None)
    rounds = Rounds(given)
    body = {"effect": "rigid_body", "params": {"gain": 1.0}}
    friction = {"effect": LAW, "params": {"level": 1.0}}
    mode = {"effect": "flexible_mode", "params": {"f_hz": 100.0, "zeta": 0.01, "residue": 0.1}}
    whole, beside = (
        gsid.PlantModel.from_dict({"gsid_model": 1, "fs_hz": 1000.0, "effects": effects})
        for effects in ([body, friction, mode], [body, friction] if is_same else [body])
    )
    rounds.near = [SimpleNamespace(final=fit_of("flexible_mode"), null=fit_of(model=beside))]
    rounds.fit_named(fit_of(model=whole))
    assert rounds.final.model is (beside if is_same else whole)


@dataclass
class Simulations:
    """Stands for the fits by simulation: keeps the model it is asked for."""

    asked: list
    answer: Simulated
    deadline: Deadline | None = None

    def fit(self, model, effects):
        self.asked.append(model)
        return self.answer


def test_bug_the_end_of_time_took_a_draft_its_verdict():
    """The second draft, without the lines where noise rings, came too late: 'before the first draft'."""
    run = a_run(Decision(NEAREST, (LAW,)))
    run.draft, run.stack = object(), object()
    give_up(run)
    assert run.decision == Decision(NEAREST, (LAW,))
    assert (run.cut, run.not_tried) == (True, {"further steps": "the time was over"})
    run.draft = None
    give_up(run)
    assert run.decision.verdict == UNKNOWN
    assert run.decision.reasons == ("The time was over before the first draft.",)


def test_bug_a_structure_was_lost_where_no_time_was_left_for_other_outputs(monkeypatch):
    """No stack represents this output as its unit states; all outputs are tried then."""
    rng = np.random.default_rng(20261128)
    u = np.tile(rng.standard_normal(400), 4)
    record = gsid.Record(
        u, np.roll(u, 3) ** 3 + 0.01 * rng.standard_normal(1600), 1000.0, 400, 0, y_unit="rad"
    )
    likeliest, asked = structure._likeliest, []

    def once(*arguments):
        asked.append(arguments[2])
        if len(asked) > 1:
            raise OutOfTime("the time is over")
        best, found = likeliest(*arguments)
        best.selection.represents = False
        return best, found

    monkeypatch.setattr(structure, "_likeliest", once)
    found = gsid.start(record)
    assert len(asked) == 2
    assert found.output == "angle"


def test_bug_a_number_that_is_no_number_in_the_reference_was_a_numerical_error():
    """LinAlgError: SVD did not converge."""
    record = linear_loop(1, periods=2)
    r = record.columns["r"].copy()
    r[2500] = np.nan
    with pytest.raises(InputError, match=r"not finite(.|\n)*sample 2500, r"):
        gsid.diagnose_records(replace(record, columns={"r": r}), reference="r")


@pytest.mark.parametrize(("unit", "noted"), [("V", True), ("mm/s", False), ("", False)])
def test_laws_of_turning_that_are_not_tried_are_named(unit, noted):
    """Also with a model of `gsid start`: an output in V is that of an axis that does not turn."""
    run = a_run(Decision(UNKNOWN))
    run.measured, run.stack = [SimpleNamespace(y_unit=unit)], SimpleNamespace(angle_unit="m")
    finding._note_laws_of_turning(run)
    assert ("mass_unbalance" in run.not_tried) is noted


@pytest.mark.parametrize(
    ("unit", "kind", "of_model"),
    [
        ("deg", "angle", "deg"),
        ("rad/s", "rate", "rad"),
        ("mm", "angle", "m"),
        ("nm/s", "rate", "m"),
        ("arcsec", "angle", "deg"),
        ("urad/s^2", "acceleration", "deg"),
        ("turns", "angle", "deg"),
        ("V", None, "m"),
        ("", None, "deg"),
    ],
)
def test_bug_a_linear_stage_turned_after_a_start_and_not_from_its_records(unit, kind, of_model):
    """`gsid start` wrote a model in degrees for y in mm, and did not know that arcseconds are angles."""
    assert (kind_of_unit(unit), angle_unit_of(unit)) == (kind, of_model)


def test_bug_the_step_of_a_rounded_command_was_undetermined():
    """The search finds it, and no fit has a derivative by it: it is fixed, as `gsid add` has it."""
    effects = [
        {"effect": "rigid_body", "params": {"gain": {"value": 1.0, "free": True}}},
        {"effect": "drive_quantization", "params": {"step": {"value": 3.0, "free": True}}},
        {"effect": "viscous_friction", "params": {"rate": {"value": 2.0, "free": True}}},
    ]
    model = gsid.PlantModel.from_dict({"gsid_model": 1, "fs_hz": 1000.0, "effects": effects})
    model.cov, model.cov_names = np.diag([1.0, np.inf, 4.0]), model.free_names
    found = shown_models.with_fixed(model)
    assert found.free_names == ["rigid_body.gain", "viscous_friction.rate"]
    np.testing.assert_array_equal(found.covariance, np.diag([1.0, 4.0]))
    assert "drive_quantization.step" in model.free_names
    assert shown_models.with_fixed(None) is None
