"""Which effects a diagnosis names when the hold is unknown: the rules alone, on costs that are given."""

from types import SimpleNamespace

import pytest
from plants import plant

from gsid.diagnosis.candidates import Candidate, Group
from gsid.diagnosis.hold_cases import Case, settle

GIVEN = {"rigid_body": {"gain": 40.0}, "viscous_friction": {"rate": 25.0}}
ADDED = {"motor_lag": {"time_constant_s": 1e-3}, "coulomb_friction": {"level": 1.0}}
ADEQUATE_BELOW = 1000.0


class Search:
    """A search that finds the effects it is made with, and tests a fit by its cost."""

    def __init__(self, found, costs):
        self.given, self.steps = SimpleNamespace(alpha=0.05), []
        self.found, self.costs, self.n_runs = found, costs, 0

    def fit_or_none(self, model, *, anew):
        added = frozenset(effect.id for effect in model.effects) - set(GIVEN)
        cost = self.costs[added]
        return SimpleNamespace(model=model, cost=cost, n_dof=500, hold=None)

    def test(self, fit):
        return SimpleNamespace(fit=fit, p_value=0.5 if fit.cost < ADEQUATE_BELOW else 0.001)

    def run(self, first):
        self.n_runs += 1
        if self.test(first).p_value >= self.given.alpha:
            self.steps = [self.test(first)]
            return [], first
        fit = self.fit_or_none(plant(GIVEN | {name: ADDED[name] for name in self.found}), anew=True)
        self.steps = [self.test(first), self.test(fit)]
        return [[Group([Candidate(name, fit, 0.0)], 1.0)] for name in self.found], fit


def case(found, **costs):
    """Costs by the effects added, joined by "_and_"; "alone" is the model as it was given."""
    by_effects = {
        frozenset(() if key == "alone" else key.split("_and_")): cost for key, cost in costs.items()
    }
    search = Search(found, by_effects)
    return Case(search.fit_or_none(plant(GIVEN), anew=True), search)


def names(taken):
    return [ranking[0].effects[0] for ranking in taken.rankings]


@pytest.mark.parametrize(("none", "zoh"), [(900.0, 5000.0), (5000.0, 900.0)])
def test_adequate_under_either_is_adequate_and_nothing_is_searched(none, zoh):
    cases = {"none": case([], alone=none), "zoh": case([], alone=zoh)}
    taken, other = settle(cases)
    assert taken is cases["none" if none < zoh else "zoh"]
    assert names(taken) == []
    assert other.cost == 5000.0
    assert sum(one.search.n_runs for one in cases.values()) == 1


def test_one_search_settles_what_is_missing_under_both():
    both = {"alone": 5000.0, "coulomb_friction": 900.0}
    cases = {"none": case(["coulomb_friction"], **both), "zoh": case(["coulomb_friction"], **both)}
    taken, _ = settle(cases)
    assert taken is cases["none"]
    assert names(taken) == ["coulomb_friction"]
    assert cases["zoh"].search.n_runs == 0


def test_a_lag_that_the_other_reading_does_without_is_not_named():
    found = ["coulomb_friction", "motor_lag"]
    none = {"alone": 5000.0, "coulomb_friction": 2000.0, "coulomb_friction_and_motor_lag": 900.0}
    zoh = {"alone": 5001.0, "coulomb_friction": 905.0}
    cases = {"none": case(found, **none), "zoh": case(found, **zoh)}
    taken, _ = settle(cases)
    assert taken is cases["zoh"]
    assert names(taken) == ["coulomb_friction"]
    assert taken.fit.cost == taken.rankings[0][0].candidates[0].fit.cost == 905.0
    assert [step.p_value for step in taken.search.steps] == [0.001, 0.5]
    assert "motor_lag is not missing if the input is held over each sample" in taken.notes[0]
    assert "--hold" in taken.notes[0]


def test_a_lag_that_does_not_earn_its_place_under_the_other_reading_is_not_named():
    cases = {
        "none": case(["motor_lag"], alone=5000.0, motor_lag=900.0),
        "zoh": case(["motor_lag"], alone=5100.0, motor_lag=5099.0),
    }
    taken, _ = settle(cases)
    assert (taken, names(taken)) == (cases["none"], [])
    assert taken.search.steps[-1].p_value == 0.001
    assert "motor_lag is not missing" in taken.notes[0]


def test_a_lag_that_is_missing_under_both_is_named():
    cases = {
        "none": case(["motor_lag"], alone=5000.0, motor_lag=900.0),
        "zoh": case(["motor_lag"], alone=5100.0, motor_lag=950.0),
    }
    taken, other = settle(cases)
    assert (names(taken), taken.notes) == (["motor_lag"], [])
    assert other.cost == 950.0


def test_the_other_reading_is_searched_where_the_first_settles_nothing():
    """A large misfit of something else may make the wrong reading the likelier one at first."""
    none = {"alone": 5000.0, "coulomb_friction": 3000.0}
    zoh = {"alone": 5100.0, "coulomb_friction": 900.0}
    cases = {"none": case(["coulomb_friction"], **none), "zoh": case(["coulomb_friction"], **zoh)}
    taken, other = settle(cases)
    assert taken is cases["zoh"]
    assert (names(taken), other.cost) == (["coulomb_friction"], 3000.0)
