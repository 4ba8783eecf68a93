"""Decisions of the diagnosis from records between the fits: each from both sides of its limit."""

from types import SimpleNamespace

import hard
import numpy as np
import pytest
import trials

from gsid.diagnosis.from_records import summary
from gsid.diagnosis.from_records.draft import with_stack
from gsid.diagnosis.from_records.loop import identified_loop
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import MISSING, NEAREST, Decision
from gsid.diagnosis.missing_torque import stage
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.plant.model import PlantModel
from gsid.plant.units import angle_unit_of
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of

STACK = {"rigid_body": {"gain": 10.0}, "viscous_friction": {"rate": 3.0}}


def model(stack):
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": 1000.0, "output": "rate", "effects": effects})


def test_bug_the_rate_of_a_held_sensor_moved_off_its_images():
    """The fit moved it from 2000 to 2028 Hz, where the simulation refuses it: a null was rejected."""
    larger = with_stack(
        model(STACK),
        STACK | {"sensor_sample_hold": {"rate_hz": 400.0}, "sensor_lag": {"time_constant_s": 1e-3}},
    )
    free = larger.free_names
    assert "sensor_sample_hold.rate_hz" not in free
    assert "sensor_lag.time_constant_s" in free
    assert "rigid_body.gain" in free


def test_bug_a_mode_at_the_end_of_the_band_stood_in_for_a_lag():
    """It was named, though the lag fits better; without lags in the catalogue it was named as well."""
    trial = hard.make_hard(21710, 1, "single")
    assert [effect["id"] for effect in trial.key["effects"]] == ["motor_lag"]
    records = [Record(u, y, trials.FS_HZ, trials.N, 0, hold="zoh") for u, y in trial.records]
    given = PlantModel.from_dict(trial.models[0.05], "null")
    found = first_stage(spectra_of(records), given)
    assert found.conclusion.effects == ("motor_lag",)
    found = first_stage(spectra_of(records), given, without={"motor_lag", "sensor_lag"})
    print(found.conclusion)
    assert found.conclusion.kind != "named"
    assert "flexible_mode" not in found.conclusion.effects


NOISE = SimpleNamespace(fit=SimpleNamespace(cost_per_dof=1.09, n_dof=100_000))
MORE = SimpleNamespace(fit=SimpleNamespace(cost_per_dof=1.11, n_dof=100_000))
FEW = SimpleNamespace(fit=SimpleNamespace(cost_per_dof=1.11, n_dof=200))  # 3 sqrt(2 / n_dof) is 0.3


@pytest.mark.parametrize(
    ("null", "laws", "draft", "verdict"),
    [
        (NOISE, [], "unknown_effect", "adequate"),
        (MORE, [], "unknown_effect", "unknown_effect"),
        (FEW, [], "unknown_effect", "adequate"),
        (NOISE, ["a fit"], "unknown_effect", "unknown_effect"),
        (NOISE, [], "nearest_effect", "nearest_effect"),  # its fits were not made in time
        (None, [], "unknown_effect", "unknown_effect"),
    ],
)
def test_bug_a_slow_held_sensor_was_unknown_though_the_simulation_left_noise(null, laws, draft, verdict):
    """The first stage, which has no images above the band, left four times the noise."""
    run = SimpleNamespace(null=null, laws=laws, cut=False, decision=Decision(draft), settings=DEFAULTS)
    Run.accept_noise(run)
    assert run.decision.verdict == verdict


@pytest.mark.parametrize(
    ("cost", "draft", "verdict"),
    [
        (0.97, "unknown_effect", "adequate"),
        (1.05, "unknown_effect", "adequate"),  # 1.05 of 1990 numbers: p = 0.057
        (1.06, "unknown_effect", "unknown_effect"),
        (0.97, "nearest_effect", "nearest_effect"),
    ],
)
def test_bug_a_linear_loop_had_a_missing_effect_that_no_simulation_could_deny(cost, draft, verdict):
    """At p = 0.96; the controller was not known."""
    stage = SimpleNamespace(n_rows=2000, cost_per_dof=cost)
    draft_of = SimpleNamespace(stage=stage, model=SimpleNamespace(free_names=["a"] * 10))
    run = SimpleNamespace(draft=draft_of, decision=Decision(draft), alpha=0.05)
    Run.accept_noise_of_draft(run)
    assert run.decision.verdict == verdict


def test_bug_without_work_for_a_law_an_answer_was_called_confirmed():
    """And noise was accepted, though the laws of the short list had not been fitted."""
    unknown = Decision("unknown_effect")
    run = SimpleNamespace(null=NOISE, laws=[], cut=True, decision=unknown, settings=DEFAULTS)
    Run.accept_noise(run)
    assert run.decision == unknown
    assert not Run.is_confirmed.fget(run)
    run.cut = False
    assert Run.is_confirmed.fget(run)


@pytest.mark.parametrize("stated", [None, "zoh"])
def test_bug_the_reading_of_some_records_was_lost_where_others_state_their_hold(stated):
    """They stayed open, and each later fit chose a reading of its own."""
    read = [SimpleNamespace(spectra=SimpleNamespace(hold=hold)) for hold in ("none", stated or "none")]
    measured = [SimpleNamespace(hold=None), SimpleNamespace(hold=stated)]
    assert stage._hold(SimpleNamespace(records=read), measured) == "none"


def test_records_that_state_different_holds_have_no_common_one():
    both = [SimpleNamespace(hold="none"), SimpleNamespace(hold="zoh")]
    problem = SimpleNamespace(records=[SimpleNamespace(spectra=one) for one in both])
    assert stage._hold(problem, both) is None


def test_bug_a_nearest_effect_was_listed_as_found():
    """The first round had named another one, which the review had replaced."""
    first = SimpleNamespace(draft=SimpleNamespace(added=[]), start=None, decision=Decision(MISSING, ("a",)))
    assert summary._found(first, Decision(NEAREST, ("b",))) == []
    assert summary._found(first, Decision(MISSING, ("b",))) == [("b",)]


UNITS = {"deg/s": "deg", "mrad": "deg", "rev/s": "deg", "mm": "m", "V": "m", "": "deg"}


@pytest.mark.parametrize(("unit", "angle_unit"), UNITS.items())
def test_bug_an_angle_in_mrad_was_a_travel(unit, angle_unit):
    """Of an axis that does not turn: cogging and unbalance were not searched."""
    assert angle_unit_of(unit) == angle_unit


def test_bug_lost_samples_of_a_closed_loop_spoiled_its_controller():
    rng = np.random.default_rng(20261126)
    r, valid = np.cumsum(rng.standard_normal(2000)), np.ones(2000, bool)
    y = np.convolve(r, np.full(20, 1 / 20))[:2000]
    u = np.zeros(2000)
    u[1:] = 3.0 * (8.0 * (r - y)[1:] - np.diff(y) * 1000.0)
    valid[700] = False
    u[700], r[700] = 1e6, np.nan
    record = Record(u, y, 1000.0, 1000, 0, hold="zoh", valid=valid, columns={"r": r})
    found = identified_loop([record], [SimpleNamespace(settle_samples=0)], "r", DEFAULTS)
    assert found.params["kp"].value == pytest.approx(8.0, rel=1e-6)
    assert found.params["kv"].value == pytest.approx(3.0, rel=1e-6)
