"""A diagnosis at its limits: no time left within a step, nothing to fit, nothing to look for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plants import axis_record, plant

import gsid
from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import InputError, SimulationError
from gsid.diagnosis.from_records import draft as drafting
from gsid.diagnosis.from_records import (
    drive_laws,
    equal_weights,
    hold_check,
    mend_structure,
    play,
    shown_models,
)
from gsid.diagnosis.from_records import find_structure as finding
from gsid.diagnosis.from_records.confirm import Simulations
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import MISSING, NEAREST, Decision
from gsid.diagnosis.missing_torque import ranking
from gsid.diagnosis.missing_torque.problem import linear_part
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.effects.types import catalogue, find
from gsid.structure import start as starting
from gsid.structure.held_sensor import Measurement

SEED = 20261123
AXIS = {"rigid_body": {"gain": 7.4}, "viscous_friction": {"rate": 9.0}}


@pytest.fixture(scope="module")
def record():
    print("seed", SEED)
    u = 30 * np.random.default_rng(SEED).standard_normal(1000)
    return axis_record(u, 8, 0.01, SEED, gain=7.4, viscous_rate=11.0)


# ---- nothing to fit, nothing to look for -----------------------------------------------------------


def fixed():
    model = plant(AXIS)
    for effect in model.effects:
        for param in effect.params.values():
            param.free = False
    return model


def test_bug_a_linear_part_without_free_values_ended_in_an_index_error(record):
    found = first_stage(record, fixed())
    assert found.conclusion.kind == "unknown"  # the damping is wrong by a fifth
    assert found.ranking


def test_a_given_model_without_a_free_parameter_is_refused(record):
    with pytest.raises(InputError, match="no free parameter"):
        gsid.diagnose(fixed(), record)


def test_bug_a_catalogue_without_effects_ended_in_an_error_of_min(record):
    with pytest.raises(InputError, match="no effect of the catalogue can be fitted"):
        gsid.diagnose(plant(AXIS), record, without=list(catalogue()))


def test_bug_an_unknown_effect_to_leave_out_was_ignored(record):
    with pytest.raises(InputError, match="unknown effect"):
        gsid.diagnose_records(record, without=["coulomb_frictoin"])


@pytest.mark.parametrize("model", [None, plant(AXIS)])
def test_bug_a_reference_of_spectra_ended_in_an_attribute_error(record, model):
    with pytest.raises(ValueError, match="give records, not their spectra"):
        gsid.diagnose_records(gsid.spectra(record), model, reference="r")


@pytest.mark.parametrize("model", [None, plant(AXIS)])
def test_bug_a_missing_reference_ended_in_a_key_error(record, model):
    with pytest.raises(InputError, match="no column named r"):
        gsid.diagnose_records(record, model, reference="r")


def test_bug_a_third_mode_took_the_place_of_the_second():
    modes = [{"f_hz": f_hz, "zeta": 0.02, "residue": 0.3} for f_hz in (10.0, 20.0, 30.0)]
    part = linear_part(plant({"rigid_body": {"gain": 1.0}}))
    for mode in modes:
        part = ranking._enlarged(part, find("flexible_mode"), mode)
    assert [part.stack[label] for label in ("flexible_mode", "flexible_mode#2", "flexible_mode#3")] == modes
    assert len(set(part.names)) == len(part.names) == len(part.values) == 10


def test_bug_a_wrong_unit_stayed_in_the_records_of_a_closed_loop(record, monkeypatch):
    """An angle in deg/s: the fits by simulation inside the loop were refused."""
    found = plant(AXIS, output="angle")
    start = SimpleNamespace(has_model=True, model=lambda: found, measured=None)
    start.measured = SimpleNamespace(f_hz=[1.0], y_unit="deg/s")
    monkeypatch.setattr(finding, "start", lambda *_, **__: start)
    run = Run(Deadline(), DEFAULTS, None, (), lambda text: None)
    run.by_reference = [gsid.spectra(record)]
    monkeypatch.setattr(finding, "_find_loop", lambda *_: None)
    monkeypatch.setattr(finding, "_keep_resonances", lambda run: None)
    finding.find_structure(run, record, None, None, "r")
    assert [one.y_unit for one in (*run.measured, *run.by_reference)] == ["", ""]


def test_bug_a_model_of_another_output_was_refused_after_half_a_minute(record):
    """`gsid start --output angle` made the model of a record in deg/s."""
    steps = []
    rate = replace(record, y_unit="deg/s")
    with pytest.raises(InputError, match="the record's unit is not the model's"):
        gsid.diagnose_records(rate, plant(AXIS, output="angle"), on_step=steps.append)
    assert [step.count("transforming the records") for step in steps] == [1]


# ---- the steps after it -----------------------------------------------------------------------------


def test_bug_a_fit_with_equal_weights_that_was_cut_gave_its_values(monkeypatch):
    """Its values lie between those of two criteria, and the result called them converged."""
    final = SimpleNamespace(model=None, effects=("coulomb_friction",), fit=SimpleNamespace(cost_per_dof=9.0))
    run = Run(Deadline(), DEFAULTS, None, (), lambda text: None)
    run.final, run.laws, run.decision = final, [final], Decision(MISSING, final.effects)
    run.evidence = lambda: SimpleNamespace(is_adequate=lambda one: False)

    def cut(*_, **__):
        run.deadline.stop()
        return SimpleNamespace(converged=False)

    monkeypatch.setattr(equal_weights, "fit_plant", cut)
    equal_weights.weigh_model_error(run)
    assert run.final is final
    assert run.laws == [final]


def test_bug_a_fit_with_equal_weights_that_cannot_be_simulated_ended_the_diagnosis(monkeypatch):
    final = SimpleNamespace(model=None, effects=("coulomb_friction",), fit=SimpleNamespace(cost_per_dof=9.0))
    run = Run(Deadline(), DEFAULTS, None, (), lambda text: None)
    run.final, run.evidence = final, lambda: SimpleNamespace(is_adequate=lambda one: False)
    run.decision = Decision(NEAREST, final.effects)

    def refuse(*_, **__):
        raise SimulationError(-7, "the plant cannot be simulated", "")

    monkeypatch.setattr(equal_weights, "fit_plant", refuse)
    equal_weights.weigh_model_error(run)
    assert run.final is final


@pytest.mark.parametrize(("cost", "fits"), [(2.9, 0), (3.1, 1)])
def test_bug_equal_weights_made_a_law_worse_that_left_little_more_than_noise(monkeypatch, cost, fits):
    """Nearest to a null was drive_saturation (cost 1.19 -> 1.39): 1.18 with the weights of the noise."""
    final = SimpleNamespace(model=None, effects=("drive_saturation",), fit=SimpleNamespace(cost_per_dof=cost))
    run = Run(Deadline(), DEFAULTS, None, (), lambda text: None)
    run.final, run.laws, run.decision = final, [final], Decision(NEAREST, final.effects)
    run.evidence = lambda: SimpleNamespace(is_adequate=lambda one: False)
    fitted = []
    monkeypatch.setattr(equal_weights, "_fit_with_equal_weights", lambda run: fitted.append(run) is None)
    monkeypatch.setattr(equal_weights, "remaining_ripple", lambda *_: "a ripple")
    equal_weights.weigh_model_error(run)
    assert len(fitted) == fits
    assert run.ripple == "a ripple"


def test_bug_the_linear_structure_of_a_draft_was_searched_after_the_deadline(record):
    deadline = Deadline()
    deadline.stop()
    measured = gsid.spectra(record)
    values = drafting._values_from_data([measured], plant(AXIS), None, lambda text: None, deadline)
    assert values is None


def test_bug_the_laws_of_the_drive_were_simulated_after_the_deadline(monkeypatch):
    asked, deadline = [], Deadline()

    def cost_of(model):
        asked.append(model)
        deadline.stop()
        return 0.0

    null = SimpleNamespace(cost=1.0, cost_of=cost_of, model=plant(AXIS), records=[SimpleNamespace()])
    monkeypatch.setattr(type(null.model), "drive_command", lambda *_: np.ones(3))
    null.records = [SimpleNamespace(spectra=None, prediction=None)]
    drive_laws.drive_starts(null, (), deadline)
    assert len(asked) == 1


def test_a_check_of_the_hold_without_time_is_stated(monkeypatch):
    deadline = Deadline()
    deadline.stop()
    run = SimpleNamespace(not_tried={}, measured=[], open=[])
    run.simulations = lambda: Simulations([], None, deadline, DEFAULTS, lambda text: None)
    monkeypatch.setattr(hold_check, "linear_start", lambda model, measured: model)
    assert hold_check._fit(run, plant(AXIS), "zoh") is None
    assert "time was over" in run.not_tried["the check with the input held over each sample"]


def test_bug_two_effects_of_which_neither_had_a_name_alone_lost_the_other_delay():
    """The delay under the other hold is that of the model with both; the given model's was looked for."""
    both, given = SimpleNamespace(other_delay_s=2e-3), SimpleNamespace(other_delay_s=None)
    null, alone = SimpleNamespace(fit=given), SimpleNamespace(fit=both)
    run = SimpleNamespace(null=null, decision=Decision(NEAREST), given="a model", shown=alone)
    kept = [SimpleNamespace(final=SimpleNamespace(fit=both))]
    assert shown_models.fit_shown(run, kept) is both
    assert shown_models.fit_shown(run, ()) is given
    run.given = None  # from the records alone the law is part of the model
    assert shown_models.fit_shown(run, ()) is both


def test_bug_play_that_was_cut_in_its_last_fit_lost_the_fit_before(monkeypatch):
    first = SimpleNamespace(cost=80.0, converged=False, model=None)
    fits = iter([first])

    def fit_plant(*_, **__):
        for fit in fits:
            return fit
        raise OutOfTime("the time is over")

    monkeypatch.setattr(play, "joint_start", lambda *_, **__: "a start")
    monkeypatch.setattr(play, "fit_plant", fit_plant)
    null = SimpleNamespace(cost=100.0)
    assert play.fit_play(null, None, [], None, 90.0, Deadline()) is first


def test_bug_a_structure_beside_the_law_that_fails_numerically_ended_the_diagnosis(record, monkeypatch):
    def fails(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(mend_structure, "start", fails)
    monkeypatch.setattr(mend_structure, "without_laws", lambda measured, model, deadline: measured)
    run = Run(Deadline(), DEFAULTS, None, (), lambda text: None)
    run.final, run.start = SimpleNamespace(model=plant(AXIS)), SimpleNamespace(output="rate")
    assert not mend_structure._mended(run)


# ---- the linear structure ----------------------------------------------------------------------------


def test_bug_a_second_search_out_of_time_lost_the_first(record, monkeypatch):
    """Behind a held sensor the structure is searched again, without the images that the first one shows."""
    likeliest, searches = starting._likeliest, []

    def once(*arguments):
        searches.append(1)
        if len(searches) > 1:
            raise OutOfTime("the time is over")
        return likeliest(*arguments)

    monkeypatch.setattr(starting, "_likeliest", once)
    monkeypatch.setattr(starting, "before_sensor", lambda measured, rate_hz: measured)
    monkeypatch.setattr(Measurement, "sensor_rate_hz", lambda self: 600.0)
    monkeypatch.setattr(Measurement, "without_images", lambda self, *_: self.total_variance())
    found = gsid.start(record)
    assert len(searches) == 2
    assert found.represented
    assert any("best one so far" in text for text in found.assumed)


def test_bug_a_review_had_only_the_work_that_earlier_rounds_left():
    """Its fits were refused, and both of two effects were lost."""
    run = Run(Deadline().bounded(DEFAULTS.moves_most), DEFAULTS, None, (), lambda text: None)
    run.deadline.spend(DEFAULTS.moves_most)
    further = run.beside(plant(AXIS))
    assert further.deadline.moves_left == DEFAULTS.moves_most
    further.deadline.stop()
    assert run.deadline.is_over
