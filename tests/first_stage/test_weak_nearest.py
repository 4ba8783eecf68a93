"""A nearest law of records alone that leaves more than noise and explains too little is unknown."""

from types import SimpleNamespace

import pytest

from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, UNKNOWN, Decision
from gsid.diagnosis.from_records.weak_nearest import doubt_nearest

LEAST = DEFAULTS.nearest_error_share


def judged(verdict, explained, adequate=False, final="a fit"):
    left = None if explained is None else 1 - explained
    run = SimpleNamespace(settings=DEFAULTS, final=final)
    run.decision = Decision(verdict, ("hard_stop",), ("It is weak.",), left)
    run.evidence = lambda: SimpleNamespace(is_adequate=lambda one: adequate)
    doubt_nearest(run)
    return run.decision


def test_bug_a_stop_was_nearest_to_a_hysteresis_of_which_it_explained_half():
    """A subset of the hysteretic benchmark (seed 80): it left 1717 times the power of noise."""
    found = judged(NEAREST, 0.51)
    assert (found.verdict, found.effects, found.unexplained_share) == (UNKNOWN, (), 0.49)
    assert found.reasons == (
        "It is weak.",
        "More than noise is left, and hard_stop explains less than 85 % on held-out data.",
    )


@pytest.mark.parametrize(
    ("verdict", "explained", "adequate", "final"),
    [
        (NEAREST, LEAST + 1e-6, False, "a fit"),
        (NEAREST, 0.51, True, "a fit"),
        (NEAREST, None, False, "a fit"),  # of a clear law that leaves only noise
        (NEAREST, 0.51, False, None),  # a first draft
        (MISSING, 0.51, False, "a fit"),
        (ADEQUATE, None, False, None),
    ],
)
def test_other_verdicts_stay(verdict, explained, adequate, final):
    found = judged(verdict, explained, adequate, final)
    assert (found.verdict, found.effects) == (verdict, ("hard_stop",))
