"""Laws that are not searched join the group of a law that they are easily confused with."""

from types import SimpleNamespace

import pytest
from test_larger_laws import LITTLE, records
from test_verdict import above, fit
from test_what_is_left import LINEAR, plant

import gsid
from gsid.base.errors import InputError
from gsid.diagnosis.from_records import unsearched_laws
from gsid.diagnosis.from_records.evidence import Evidence
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.unsearched_laws import unsearched_as_good


def test_bug_a_quadratic_spring_was_named_an_unbalance():
    """With 0.97: over a small travel it is one beside another spring. `gsid add` found it all along."""
    found = gsid.diagnose_records(records(plant(LINEAR | {"quadratic_spring": {"stiffness": 600.0}}), LITTLE))
    print(found)
    assert found.effects == ("mass_unbalance", "quadratic_spring")
    assert any("quadratic_spring, which is not searched" in remark for remark in found.remarks)


class Run:
    """A diagnosis whose best law is an unbalance, and a fit of the quadratic spring with this cost."""

    def __init__(self, rise=0.0, is_over=False):
        self.settings, self.band, self.null, self.not_tried = DEFAULTS, None, fit("", 5.0), {}
        self.best = fit("mass_unbalance", 1.0)
        self.other = fit("quadratic_spring", above(1.0, rise))
        self.deadline = SimpleNamespace(is_over=is_over, bounded=lambda moves: None)

    def simulations(self):
        return SimpleNamespace(not_tried={}, fit=lambda start, effects, to_beat: self.other)

    def evidence(self):
        return Evidence(self.null, [self.best], (), DEFAULTS)


@pytest.fixture
def starts(monkeypatch):
    """Starts of the law; an error is raised."""
    answer = ["a start"]

    def effect_starts(fit, effect, band, deadline):
        if isinstance(answer[0], Exception):
            raise answer[0]
        return list(answer)

    monkeypatch.setattr(unsearched_laws, "effect_starts", effect_starts)
    monkeypatch.setattr(unsearched_laws, "replace", lambda fits, deadline: fits)
    return answer


@pytest.mark.parametrize(("rise", "joins"), [(11, True), (13, False), (-100, True)])
def test_a_law_joins_if_it_is_not_worse(starts, rise, joins):
    run = Run(rise)
    assert unsearched_as_good(run, run.best, set()) == ([run.other] if joins else [])


@pytest.mark.parametrize("left_out", [{"quadratic_spring"}, set()])
def test_a_law_that_is_left_out_or_not_confused_does_not_join(starts, left_out):
    run = Run()
    best = run.best if left_out else fit("coulomb_friction", 1.0)
    assert unsearched_as_good(run, best, left_out) == []
    assert run.not_tried == {}


@pytest.mark.parametrize(
    ("is_over", "answer", "why"),
    [(True, "a start", "the time was over"), (False, InputError("none"), "no start was found")],
)
def test_a_law_that_was_not_tried_is_listed(starts, is_over, answer, why):
    """Else an unbalance is named alone in silence."""
    starts[0] = answer
    run = Run(is_over=is_over)
    assert unsearched_as_good(run, run.best, set()) == []
    assert run.not_tried == {"quadratic_spring": why}
