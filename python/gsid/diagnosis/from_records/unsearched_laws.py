"""Laws that are not searched, but are easily confused with the best one: they join its group."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from gsid.base.deadline import OutOfTime
from gsid.diagnosis.effect_starts import effect_starts
from gsid.diagnosis.from_records.confirm import Simulated, Simulations
from gsid.diagnosis.from_records.run import Run
from gsid.effects.types import EffectType, catalogue
from gsid.greybox.fit import CANNOT_FIT


def unsearched_as_good(run: Run, best: Simulated, left_out: Collection[str]) -> list[Simulated]:
    """Fits of laws that are not searched and fit no worse than the best law, with which they are confused.

    Over a small travel a quadratic spring is an unbalance beside another spring, which was named alone.

    Parameters
    ----------
    run : Run
    best : Simulated
    left_out : collection of str
        Effects that are not tried.
    """
    unsearched = [each for each in catalogue().values() if each.not_searched and each.id not in left_out]
    confused = [each for each in unsearched if best.effects[0] in each.confused_with]
    if not confused:
        return []
    fits = replace(run.simulations(), deadline=run.deadline.bounded(run.settings.moves_of_fit))
    fitted = [_fitted(run, fits, each, best.cost) for each in confused]
    run.not_tried.update(fits.not_tried)
    return [one for one in fitted if one is not None and not run.evidence().is_worse(one, best)]


def _fitted(run: Run, fits: Simulations, effect: EffectType, to_beat: float) -> Simulated | None:
    """The best fit from the starts of `gsid add`; None without one, and then listed as not tried."""
    try:
        starts = [] if run.deadline.is_over else effect_starts(run.null.fit, effect, run.band, run.deadline)
    except (*CANNOT_FIT, OutOfTime):
        starts = []
    if not starts:
        fits.not_tried[effect.id] = "the time was over" if run.deadline.is_over else "no start was found"
    found = [fits.fit(start, (effect.id,), to_beat) for start in starts]
    return min((one for one in found if one is not None), key=lambda one: one.cost, default=None)


def as_good_remark(one: Simulated, best: Simulated) -> str:
    """What is reported of a law that joins the group.

    Parameters
    ----------
    one, best : Simulated
    """
    return (
        f"{one.effects[0]}, which is not searched, fits these records as well as {best.effects[0]} or better"
        f" (cost {one.cost - best.cost:+.1f}); gsid add takes it."
    )
