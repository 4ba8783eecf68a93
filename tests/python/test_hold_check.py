"""Which effects a diagnosis names when the hold is unknown: the rules alone, on costs that are given."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest
from plants import plant
from test_hold import held_record

import gsid
from gsid.diagnosis.from_records import hold_check
from gsid.diagnosis.from_records.hold_check import check_hold, take_likelier_hold
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, UNKNOWN, Decision
from gsid.plant.model import PlantModel

GIVEN = {"rigid_body": {"gain": 40.0}, "viscous_friction": {"rate": 25.0}}
ADDED = {"motor_lag": {"time_constant_s": 1e-3}, "coulomb_friction": {"level": 1.0}}


class Run:
    """A round that found an effect; as the first one it also has the fit of the given model."""

    hold_assumed, hold, measured = True, "none", ()
    settings, open = DEFAULTS, ()
    left = 1.0  # cost per degree of freedom of the fit with all effects

    def __init__(self, effect, final, null=None):
        self.decision, self.final, self.null = Decision(MISSING, (effect,)), final, null
        self.notes = []

    def evidence(self):
        return SimpleNamespace(is_adequate=lambda one: self.left <= DEFAULTS.adequate)

    def conclude_without_law(self, null):
        self.null, self.decision = null, Decision(ADEQUATE)


@dataclass
class Fitted:
    model: PlantModel
    cost: float
    fit: SimpleNamespace
    effects: tuple[str, ...]


def simulated(model, cost):
    """The effect under judgement stands last in the model."""
    fit = SimpleNamespace(n_dof=500, delay_s=None, model=model, hold_assumed=False)
    return Fitted(model, cost, fit, (model.effects[-1].id,))


@pytest.fixture
def checked(monkeypatch):
    """Check effects that were found without a hold, with costs by (hold, effects)."""

    def check(found, costs):
        def fit(run, model, hold):
            added = tuple(e.id for e in model.effects if e.id not in GIVEN)
            cost = costs[hold, added]
            return None if cost is None else simulated(model, cost)

        monkeypatch.setattr(hold_check, "_fit", fit)
        monkeypatch.setattr(hold_check, "simulation_error", lambda fit: 0.0)
        monkeypatch.setattr(hold_check, "as_assumed", lambda fit, other: None)
        monkeypatch.setattr(hold_check, "_read", lambda run, hold: ())
        whole = fit(None, plant(GIVEN | {name: ADDED[name] for name in found}), "none")
        kept = []
        for i in range(len(found)):
            final = whole if i == len(found) - 1 else fit(None, whole.model, "none")
            final.effects = (found[i],)
            kept.append(Run(found[i], final, whole))
        rounds = Rounds(kept[0])
        rounds.kept = kept
        check_hold(rounds)
        return rounds

    return check


def names(rounds):
    return [one.decision.effects[0] for one in rounds.kept]


def test_a_lag_that_is_missing_under_both_is_named(checked):
    none = {("none", ("motor_lag",)): 900.0, ("none", ()): 5000.0}
    zoh = {("zoh", ("motor_lag",)): 950.0, ("zoh", ()): 5100.0}
    found = checked(["motor_lag"], none | zoh)
    assert (names(found), found.first.notes) == (["motor_lag"], [])


def test_a_lag_that_the_other_reading_does_without_is_not_named(checked):
    lagged, plain = ("coulomb_friction", "motor_lag"), ("coulomb_friction",)
    none = {("none", lagged): 900.0, ("none", plain): 2000.0}
    zoh = {("zoh", lagged): 904.0, ("zoh", plain): 905.0}
    found = checked(["coulomb_friction", "motor_lag"], none | zoh)
    assert names(found) == ["coulomb_friction"]
    assert found.first.hold == "zoh"
    assert found.final.cost == 905.0
    assert "motor_lag is not missing if the input is held over each sample" in found.first.notes[0]
    assert "--hold" in found.first.notes[0]


def test_nothing_is_missing_if_the_other_reading_does_without_the_only_effect(checked):
    costs = {("none", ("motor_lag",)): 900.0, ("zoh", ()): 905.0, ("zoh", ("motor_lag",)): 904.0}
    found = checked(["motor_lag"], costs | {("none", ()): 2000.0})
    assert (names(found), found.first.decision.verdict) == ([], ADEQUATE)


@pytest.mark.parametrize(("behind", "named"), [(23, []), (25, ["motor_lag"])])
def test_bug_a_lag_that_one_reading_does_without_was_unknown(checked, behind, named):
    """Odds of a thousand between the readings, beside what chance gains, decide: the one without a lag was 35
    behind that with one, and the verdict was that of neither (seed 5330, lag 68)."""
    none = {("none", ("motor_lag",)): 900.0, ("none", ()): 5000.0}
    zoh = {("zoh", ("motor_lag",)): 900.0 + behind, ("zoh", ()): 901.0 + behind}
    found = checked(["motor_lag"], none | zoh)
    assert names(found) == named
    if not named:
        assert (found.first.hold, found.first.null.cost) == ("zoh", 901.0 + behind)
        assert found.first.decision.verdict == ADEQUATE


@pytest.mark.parametrize(("left", "named"), [(1.0, ["motor_lag"]), (1.2, [])])
def test_bug_a_lag_was_not_named_though_the_records_refute_the_other_reading(
    checked, monkeypatch, left, named
):
    """Only a fit that leaves noise refutes the other one: else both are wrong."""
    monkeypatch.setattr(Run, "left", left)
    none = {("none", ("motor_lag",)): 900.0, ("none", ()): 5000.0}
    zoh = {("zoh", ("motor_lag",)): 5099.0, ("zoh", ()): 5100.0}
    assert names(checked(["motor_lag"], none | zoh)) == named


@pytest.mark.parametrize("unfitted", [("motor_lag",), ()])
def test_bug_a_check_under_the_other_hold_that_could_not_be_fitted_was_evidence(checked, unfitted):
    """The lag was dropped, with the note that it is not missing if the input is held."""
    costs = {("none", ("motor_lag",)): 900.0, ("none", ()): 5000.0}
    costs |= {("zoh", ("motor_lag",)): 920.0, ("zoh", ()): 5100.0} | {("zoh", unfitted): None}
    found = checked(["motor_lag"], costs)
    assert (names(found), [one.decision.effects for one in found.near]) == ([], [("motor_lag",)])
    (one,) = found.near
    assert one.decision.verdict == NEAREST
    assert "if the input is held over each sample cannot be fitted" in one.decision.reasons[0]
    assert (found.joint.cost, found.first.notes) == (900.0, [])


def test_bug_after_a_change_of_the_hold_a_round_was_judged_beside_a_fit_with_the_old_one(checked):
    lagged, plain = ("coulomb_friction", "motor_lag"), ("coulomb_friction",)
    none = {("none", lagged): 900.0, ("none", plain): 2000.0}
    zoh = {("zoh", lagged): 904.0, ("zoh", plain): 905.0}
    (one,) = checked(["coulomb_friction", "motor_lag"], none | zoh).kept
    assert (one.hold, one.null.cost, [law.cost for law in one.laws]) == ("zoh", 904.0, [905.0])


def test_friction_cannot_imitate_a_hold(checked):
    costs = {("none", ("coulomb_friction",)): 900.0, ("zoh", ("coulomb_friction",)): 5000.0}
    found = checked(["coulomb_friction"], costs)
    assert names(found) == ["coulomb_friction"]


@dataclass
class Law:
    """A fit under one assumption."""

    cost: float
    fit: object
    converged: bool = True
    model: str = "a model"
    effects: tuple[str, ...] = ()


@pytest.mark.parametrize(
    ("cost", "converged", "verdict", "in_loop", "hold"),
    [
        (97.9, True, MISSING, False, "zoh"),
        (98.1, True, MISSING, False, "none"),  # -2 log likelihood decides above 2
        (50.0, False, MISSING, False, "none"),  # a name needs a fit that has converged
        (50.0, True, NEAREST, False, "zoh"),
        (50.0, True, UNKNOWN, False, "none"),
        (50.0, True, MISSING, True, "none"),
        (None, True, MISSING, False, "none"),
    ],
)
@pytest.mark.parametrize("is_null", [False, True])
def test_bug_the_linear_part_alone_decided_the_hold_of_records_alone(
    monkeypatch, cost, converged, verdict, in_loop, hold, is_null
):
    """A Coulomb friction was named with a delay of half a sample too much, 230 standard deviations off."""
    shown, other = Law(100.0, "not held", converged=False), cost and Law(cost, "held", converged)
    noted = []
    again = {"a model": other, "null": Law(9e3, "held null"), "rival": Law(290.0, "held rival")}
    monkeypatch.setattr(hold_check, "_fit_from", lambda run, model, hold, effects=(): again[model])
    monkeypatch.setattr(hold_check, "_read", lambda run, hold: [hold])
    monkeypatch.setattr(hold_check, "as_assumed", lambda fit, other: noted.append((fit, other)))
    rival, lost = Law(300.0, "rival", model="rival"), Law(400.0, "lost", model="lost")
    again["lost"] = None
    run = SimpleNamespace(
        hold_assumed=True, hold="none", measured=["none"], in_closed_loop=in_loop, laws=[shown, rival, lost]
    )
    run.final, run.null = (None, shown) if is_null else (shown, Law(1e4, "null", model="null"))
    run.shown = shown
    run.decision, run.deadline = Decision(verdict, ()), SimpleNamespace(is_over=False)
    take_likelier_hold(run)
    now = run.null if is_null else run.final
    assert (run.hold, run.measured) == (hold, [hold])
    assert (now.fit, now.converged) == (("held", True) if hold == "zoh" else ("not held", False))
    if not is_null:
        assert run.laws == ([now, again["rival"]] if hold == "zoh" else [shown, rival, lost])
        assert run.null.fit == ("held null" if hold == "zoh" else "null")
    if verdict == UNKNOWN or in_loop:
        assert noted == []
    else:
        assert noted == [(now.fit, shown.fit if hold == "zoh" else other and other.fit)]


def test_records_alone_get_the_delay_of_the_likelier_hold():
    record = held_record(100, 1e-3, coulomb_level=5.0)
    found = gsid.diagnose_records([record])
    print(found)
    assert (found.effects[0], found.hold, found.hold_assumed) == ("coulomb_friction", "zoh", True)
    delay = found.model["transport_delay.delay_s"]
    assert delay.value == pytest.approx(1e-3, abs=4 * delay.std)
    assert found.other_delay_s == pytest.approx(1e-3 + 0.5 / 3000.0, abs=2e-5)
    assert found.delay_hold_uncertainty_s == pytest.approx(abs(found.other_delay_s - delay.value))
    assert any("not held between samples, the delay would be 1.1" in text for text in found.assumed)
