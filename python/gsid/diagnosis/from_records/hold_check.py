"""Records that do not state their hold: an effect has to be missing under both assumptions.

A lag, a delay, a sensor that is sampled and held, or a mode above the band can imitate a hold. Such an effect
is named only if it is also missing under the other assumption, beside all other effects found, or if the
records refute that assumption; it is the nearest if that cannot be fitted. From the records alone the values
are those of the likelier one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.base.hold import DECLARE, MEANING, likelier, other_reading
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.evidence import n_parameters
from gsid.diagnosis.from_records.law_part import without
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.simulation_error import simulation_error
from gsid.diagnosis.from_records.verdict import UNKNOWN
from gsid.greybox.fit import as_assumed
from gsid.greybox.linear_start import linear_start
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra

STAND_IN = {"motor_lag", "sensor_lag", "transport_delay", "sensor_sample_hold", "flexible_mode"}


def check_hold(rounds: Rounds) -> None:
    """Drop effects that are missing under one assumption only, and note the delay under the other; in place.

    Parameters
    ----------
    rounds : Rounds
        Of records that may not state their hold, under the likelier assumption.
    """
    run, final = rounds.first, rounds.final or rounds.first.null
    if not run.hold_assumed or run.hold is None or final is None:
        return
    doubtful = [one for one in rounds.kept if STAND_IN & set(one.decision.effects)]
    other_hold = other_reading(run.hold)
    if doubtful:
        plain = _fit(run, without(final.model, _names(doubtful)), other_hold)
        if plain is not None and plain.cost - final.cost < _price(doubtful):
            run.notes.append(_note(doubtful, other_hold))
            _read_all(rounds, other_hold)
            rounds.drop(doubtful, plain)
            _fit_nulls(rounds, plain)
            final, other_hold = plain, other_reading(other_hold)
    whole = _fit(run, final.model, other_hold)
    unchecked = []
    for one in [one for one in doubtful if one in rounds.kept]:
        if _is_refuted(run, whole, final):
            continue
        part = _fit(run, without(final.model, _names([one])), other_hold)
        if whole is None or part is None:
            unchecked.append(one)
        elif part.cost - whole.cost < _price([one]):
            run.notes.append(_note([one], other_hold))
            _read_all(rounds, other_hold)
            rounds.drop([one], part)
            _fit_nulls(rounds, part)
            final, other_hold = part, other_reading(other_hold)
            whole = _fit(run, final.model, other_hold)
    as_assumed(final.fit, whole.fit if whole else None)
    if unchecked:
        reason = f"Whether it is missing if the input is {MEANING[other_hold]} cannot be fitted: {DECLARE}."
        rounds.demote([one for one in unchecked if one in rounds.kept], reason, final)


def _read_all(rounds: Rounds, hold: str) -> None:
    """Read the records of all rounds under an assumption."""
    measured = _read(rounds.first, hold)
    for one in (rounds.first, *rounds.kept):
        one.measured, one.hold = measured, hold


def _fit_nulls(rounds: Rounds, final: Simulated) -> None:
    """Fit what the effects that stay are judged beside, after the records were read in another way.

    Their rivals were fitted in the first way: their costs tell nothing any more.
    """
    first = rounds.first
    for one in dict.fromkeys((first, *rounds.kept)) if rounds.kept else ():
        plain = first.null.model if one is first else without(final.model, _names([one]))
        one.null = _fit(first, plain, first.hold) or one.null
        one.laws = [one.final] if one.final else []


def take_likelier_hold(run: Run) -> None:
    """Take the values under the hold that is likelier with the law found, and note the other delay; in place.

    The linear part alone has decided before, which leaves many times what a wrong hold does where a law is
    missing. The structure stays: it was chosen from the records, with the element that imitates a hold. So do
    the values if the other fit has not converged, since a name needs one that has.

    Parameters
    ----------
    run : Run
        Of records alone that may not state their hold, with its verdict.
    """
    shown = run.shown
    if not run.hold_assumed or run.hold is None or shown is None or run.decision.verdict == UNKNOWN:
        return
    if run.in_closed_loop or run.deadline.is_over:
        return
    other_hold = other_reading(run.hold)
    other = _fit_from(run, shown.model, other_hold)
    is_likelier = other is not None and likelier({run.hold: shown.cost, other_hold: other.cost}) == other_hold
    null = _null_under(run, shown, other, other_hold) if is_likelier and other.converged else None
    if null is None:
        as_assumed(shown.fit, other.fit if other else None)
        return
    as_assumed(other.fit, shown.fit)
    swapped = replace(shown, fit=other.fit, converged=True)
    rivals = [one for one in run.laws if one is not shown]
    run.laws = [swapped, *_rivals_under(run, rivals, other_hold)] if shown is not run.null else []
    run.null, run.final = (swapped, None) if shown is run.null else (null, swapped)
    run.measured, run.hold = _read(run, other_hold), other_hold


def _null_under(run: Run, shown: Simulated, other: Simulated, hold: str) -> Simulated | None:
    return other if shown is run.null else _fit_from(run, run.null.model, hold)


def _rivals_under(run: Run, rivals: Sequence[Simulated], hold: str) -> list[Simulated]:
    """The other laws fitted under the other assumption: the ranking compares their costs."""
    fitted = [_fit_from(run, one.model, hold, one.effects) for one in rivals]
    return [one for one in fitted if one is not None]


def _fit(run: Run, model: PlantModel, hold: str) -> Simulated | None:
    """A model fitted under an assumption, from new starting values of its linear part."""
    return _fit_from(run, linear_start(model, _read(run, hold)), hold)


def _fit_from(run: Run, model: PlantModel, hold: str, effects: tuple[str, ...] = ()) -> Simulated | None:
    """A model fitted under an assumption, from its own values."""
    fits = replace(run.simulations(), measured=_read(run, hold))
    fitted = fits.fit(model, effects)
    for why in fits.not_tried.values():
        run.not_tried[f"the check with the input {MEANING[hold]}"] = why
    return fitted


def _read(run: Run, hold: str) -> list[Spectra]:
    """The records under an assumption; those that state their hold keep it."""
    return [
        replace(one, hold=hold) if was_open else one
        for one, was_open in zip(run.measured, run.open, strict=True)
    ]


def _is_refuted(run: Run, other: Simulated | None, final: Simulated) -> bool:
    """Whether the same model leaves much more under the other assumption, and only noise under this one.

    Nothing is missing beside a hold that does not describe the records: an effect cannot lower its cost. The
    odds are those between linear effects, beside what the best of several fits gains by chance.
    """
    if other is None or not run.evidence().is_adequate(final):
        return False
    least = 2 * math.log(run.settings.linear_odds) + run.settings.chance
    return other.cost - simulation_error(other.fit) - final.cost >= least


def _names(rounds: Sequence[Run]) -> list[str]:
    return [one.final.effects[0] for one in rounds]


def _price(rounds: Sequence[Run]) -> float:
    """Fall of the cost that effects have by chance."""
    each = [n_parameters(one.final) * np.log(one.final.fit.n_dof) + one.settings.chance for one in rounds]
    return float(sum(each))


def _note(rounds: Sequence[Run], hold: str) -> str:
    names = " and ".join(" or ".join(one.decision.effects) for one in rounds)
    return f"{names} is not missing if the input is {MEANING[hold]}, and so is not named: {DECLARE}."
