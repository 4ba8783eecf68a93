"""A delay in place of a lag, and the reverse: the own fit of either may have ended in a wrong minimum."""

from dataclasses import replace
from types import SimpleNamespace

import linear_axes as axes
import missing_linear_study as study
import numpy as np
import pytest
from test_steps import BODY, VISCOUS, model

import gsid
from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records import fit_laws
from gsid.diagnosis.from_records.confirm import Simulations
from gsid.diagnosis.from_records.delay_in_place import delay_or_lag_in_place_of
from gsid.diagnosis.from_records.settings import DEFAULTS


def with_last(*parts):
    """A fit whose law is the last part."""
    (effect,) = parts[-1]
    return SimpleNamespace(effects=(effect,), model=model(BODY, VISCOUS, *parts))


LAG, MOTOR_LAG = {"sensor_lag": {"time_constant_s": 2e-3}}, {"motor_lag": {"time_constant_s": 7e-4}}
DELAY = {"transport_delay": {"delay_s": 3e-4}}


def test_the_delay_is_the_time_constant():
    found = delay_or_lag_in_place_of(with_last(LAG, MOTOR_LAG))
    assert {effect: one.stack() for effect, one in found.items()} == {
        "transport_delay": model(BODY, VISCOUS, LAG, {"transport_delay": {"delay_s": 7e-4}}).stack()
    }


def test_each_lag_takes_the_time_of_the_delay():
    found = delay_or_lag_in_place_of(with_last(DELAY))
    assert {effect: one.stack()[effect]["time_constant_s"] for effect, one in found.items()} == {
        "motor_lag": 3e-4,
        "sensor_lag": 3e-4,
    }
    assert all("transport_delay" not in one.stack() for one in found.values())


def test_no_effect_is_added_twice():
    assert delay_or_lag_in_place_of(with_last(DELAY, LAG)) == {}
    assert delay_or_lag_in_place_of(with_last(LAG, DELAY)).keys() == {"motor_lag"}
    assert delay_or_lag_in_place_of(with_last({"coulomb_friction": {"level": 1.0}})) == {}


BEST = SimpleNamespace(effects=("motor_lag",), model=model(BODY, VISCOUS, MOTOR_LAG))
WORSE, AS_GOOD = SimpleNamespace(effects=("transport_delay",)), SimpleNamespace(effects=("transport_delay",))


@pytest.mark.parametrize(
    ("known", "excluded", "is_tried"),
    [((), (), True), ((WORSE,), (), True), ((AS_GOOD,), (), False), ((), ("transport_delay",), False)],
)
def test_only_what_is_worse_is_tried(monkeypatch, known, excluded, is_tried):
    calls = []
    monkeypatch.setattr(fit_laws, "_try_in_place", lambda run, fits, *what: calls.append(what))
    run = SimpleNamespace(final=BEST, laws=[BEST, *known], settings=DEFAULTS, excluded=set(excluded))
    run.in_closed_loop, run.deadline, run.decide = False, Deadline().bounded(1.0), lambda: None
    run.evidence = lambda: SimpleNamespace(is_worse=lambda one, best: one is WORSE)
    fit_laws._try_delay_or_lag(run, Simulations([], None, run.deadline, DEFAULTS, lambda text: None))
    assert [(law, best) for _, law, best in calls] == [("transport_delay", BEST)] * is_tried


def test_bug_a_delay_was_named_a_lag():
    """Its own fit, from values 30 % off, left 1.14 times the power of noise, that of a lag 1.022."""
    trial = axes.drawn(5335, "transport_delay", 1)
    start = trial.start(np.random.default_rng([30, trial.period_samples]), 0.3)
    records = [gsid.Record(u, y, trial.fs_hz, trial.period_samples, 0) for u, y in trial.records]
    records = [replace(one, hold=trial.hold) for one in records] if trial.declared else records
    found = gsid.diagnose_records(records, study.model_of(trial, start), time_s=study.BUDGET_S)
    assert "transport_delay" in found.effects
