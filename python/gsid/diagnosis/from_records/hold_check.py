"""Records that do not state their hold: an effect has to be missing under both assumptions.

A lag, a delay, a sensor that is sampled and held, or a mode above the band can imitate a hold. Such an effect
is named only if it is also missing under the other assumption, beside all other effects found, or if the
records refute that assumption. From the records alone the values are those of the likelier one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.base.hold import DECLARE, MEANING, likelier, other_reading
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.evidence import n_parameters
from gsid.diagnosis.from_records.law_part import without
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.run import Run
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
            run.measured, run.hold = _read(run, other_hold), other_hold
            rounds.drop(doubtful, plain)
            final, other_hold = plain, other_reading(other_hold)
    whole = _fit(run, final.model, other_hold)
    for one in [one for one in doubtful if one in rounds.kept]:
        if _is_refuted(run, whole, final) or _is_missing(run, one, final, whole, other_hold):
            continue
        smaller = _fit(run, without(final.model, _names([one])), run.hold)
        if smaller is not None:
            run.notes.append(_note([one], other_hold))
            rounds.drop([one], smaller)
            final, whole = smaller, _fit(run, smaller.model, other_hold)
    as_assumed(final.fit, whole.fit if whole else None)


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
    shown = run.final or run.null
    if not run.hold_assumed or run.hold is None or shown is None or run.decision.verdict == UNKNOWN:
        return
    if run.in_closed_loop or run.deadline.is_over:
        return
    other_hold = other_reading(run.hold)
    other = _fit_from(run, shown.model, other_hold)
    is_likelier = other is not None and likelier({run.hold: shown.cost, other_hold: other.cost}) == other_hold
    if not (is_likelier and other.converged):
        as_assumed(shown.fit, other.fit if other else None)
        return
    as_assumed(other.fit, shown.fit)
    swapped = replace(shown, fit=other.fit, converged=True)
    if shown is run.null:
        run.null = swapped
    else:
        run.replace_final(swapped)
    run.measured, run.hold = _read(run, other_hold), other_hold


def _fit(run: Run, model: PlantModel, hold: str) -> Simulated | None:
    """A model fitted under an assumption, from new starting values of its linear part."""
    return _fit_from(run, linear_start(model, _read(run, hold)), hold)


def _fit_from(run: Run, model: PlantModel, hold: str) -> Simulated | None:
    """A model fitted under an assumption, from its own values."""
    fits = replace(run.simulations(), measured=_read(run, hold))
    fitted = fits.fit(model, ())
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

    Nothing is missing beside a hold that does not describe the records: an effect cannot lower its cost.
    """
    if other is None or not run.evidence().is_adequate(final):
        return False
    return other.cost - final.cost >= run.settings.named_lead


def _is_missing(run: Run, one: Run, final: Simulated, whole: Simulated | None, hold: str) -> bool:
    part = _fit(run, without(final.model, _names([one])), hold)
    return whole is not None and part is not None and part.cost - whole.cost >= _price([one])


def _names(rounds: Sequence[Run]) -> list[str]:
    return [one.final.effects[0] for one in rounds]


def _price(rounds: Sequence[Run]) -> float:
    """Fall of the cost that effects have by chance."""
    each = [n_parameters(one.final) * np.log(one.final.fit.n_dof) + one.settings.chance for one in rounds]
    return float(sum(each))


def _note(rounds: Sequence[Run], hold: str) -> str:
    names = " and ".join(" or ".join(one.decision.effects) for one in rounds)
    return f"{names} is not missing if the input is {MEANING[hold]}, and so is not named: {DECLARE}."
