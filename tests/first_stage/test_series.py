"""Copies of one effect: two modes can be missing, a series of them imitates another effect."""

from types import SimpleNamespace

import pytest

from gsid.diagnosis.from_records import series_check
from gsid.diagnosis.from_records.series_check import check_series, of_series
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import MISSING, NEAREST, Decision

MODE = "flexible_mode"


def stack(*ids):
    return SimpleNamespace(effects=[SimpleNamespace(id=each) for each in ids])


GIVEN = stack("rigid_body", MODE)


def with_copies(n, p_value):
    model = stack("rigid_body", "coulomb_friction", *[MODE] * (1 + n))
    return SimpleNamespace(model=model, fit=SimpleNamespace(noise_p_value=p_value))


@pytest.mark.parametrize(
    ("n", "p_value", "is_named"),
    [(0, 1e-9, True), (1, 1e-9, True), (2, 0.011, True), (2, 0.009, False), (3, 0.5, False)],
)
def test_copies_that_are_named(n, p_value, is_named):
    reason = of_series(MODE, GIVEN, with_copies(n, p_value), DEFAULTS)
    assert (reason is None) == is_named
    assert is_named or reason.startswith(f"{n} of {MODE} are needed (p = {p_value:.1g}")


def rounds_with(n, p_value):
    friction, mode = (
        SimpleNamespace(decision=Decision(MISSING, (name,), (), 0.01)) for name in ("coulomb_friction", MODE)
    )
    final = with_copies(n, p_value)
    refitted = []
    return SimpleNamespace(
        kept=[friction, mode], near=[], joint=None, final=final, has_series=False, settings=DEFAULTS,
        first=SimpleNamespace(null=SimpleNamespace(model=GIVEN)),
        refitted=refitted, fit_named=refitted.append,
    )  # fmt: skip


def test_bug_a_delay_was_called_a_missing_mode_after_three_of_them():
    """Blind study, seed 93011, single 6, 30 % off, without delays and lags: p = 0.0002, named at 91 %."""
    rounds = rounds_with(3, 2e-4)
    friction, mode = rounds.kept
    check_series(rounds)
    assert (rounds.kept, rounds.near, rounds.joint) == ([friction], [mode], rounds.final)
    assert mode.decision.verdict == NEAREST
    assert "3 of flexible_mode" in mode.decision.reasons[0]
    assert friction.decision.verdict == MISSING
    assert rounds.has_series
    assert rounds.refitted == [rounds.joint]  # the model has the friction alone


def test_one_mode_stays_named():
    rounds = rounds_with(1, 2e-4)
    kept = list(rounds.kept)
    check_series(rounds)
    assert (rounds.kept, rounds.near, rounds.has_series) == (kept, [], False)


@pytest.mark.parametrize("is_linear", [True, False])
def test_bug_a_drag_and_a_dry_friction_were_named_for_a_damping(monkeypatch, is_linear):
    """Each explains more than a change of the response beside the other; both together do not."""
    friction, drag = (
        SimpleNamespace(decision=Decision(MISSING, (name,), (), 0.01))
        for name in ("coulomb_friction", "quadratic_drag")
    )
    given, final = (SimpleNamespace(model=GIVEN, fit=SimpleNamespace(noise_p_value=p)) for p in (0.0, 0.5))
    rounds = SimpleNamespace(kept=[friction, drag], near=[], joint=None, final=final, settings=DEFAULTS)
    rounds.first, rounds.has_series = SimpleNamespace(null=given), False
    asked = []
    monkeypatch.setattr(
        series_check, "explains_linear_response", lambda *fits: asked.append(fits) or is_linear
    )
    check_series(rounds)
    assert asked == [(given.fit, final.fit, DEFAULTS)]
    assert (rounds.kept, rounds.near) == (([], [friction, drag]) if is_linear else ([friction, drag], []))
    assert rounds.joint == (final if is_linear else None)
