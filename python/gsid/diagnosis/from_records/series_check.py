"""Whether several effects stand for another one: a series of modes for a delay, two laws for a damping."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.doubts import explains_linear_response
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.verdict import NEAREST
from gsid.plant.model import PlantModel


def check_series(rounds: Rounds) -> None:
    """Turn named effects into the nearest where several copies, or several laws, stand for a linear effect.

    Parameters
    ----------
    rounds : Rounds
    """
    final, given = rounds.joint or rounds.final, rounds.first.null
    if final is None or given is None:
        return
    for one in list(rounds.kept):
        reason = of_series(one.decision.effects[0], given.model, final, rounds.settings)
        if reason:
            _make_nearest(rounds, one, reason, final)
    laws = [one for one in rounds.kept if not is_linear(one.decision.effects[0])]
    if len(laws) > 1 and explains_linear_response(given.fit, final.fit, rounds.settings):
        names = " and ".join(one.decision.effects[0] for one in laws)
        for one in laws:
            _make_nearest(rounds, one, f"What {names} explain together is a linear effect.", final)
    if rounds.has_series and rounds.kept:
        rounds.fit_named(final)


def _make_nearest(rounds: Rounds, one: Run, reason: str, final: Simulated) -> None:
    """An effect that was named is only the nearest; in place."""
    one.decision = replace(one.decision, verdict=NEAREST, reasons=(reason,))
    rounds.kept.remove(one)
    rounds.near.append(one)
    rounds.joint = final
    rounds.has_series = True


def of_series(effect: str, given: PlantModel, final: Simulated, settings: DecisionSettings) -> str | None:
    """Why an effect is not named although its copies together leave little; None if nothing is against it.

    Parameters
    ----------
    effect : str
    given : PlantModel
        Without any effect that was found.
    final : Simulated
        With all of them.
    settings : DecisionSettings
    """
    counts = [Counter(each.id for each in model.effects)[effect] for model in (final.model, given)]
    added = counts[0] - counts[1]
    only_noise = final.fit.noise_p_value >= settings.p_copies
    if added < 2 or (added <= settings.copies_most and only_noise):
        return None
    return (
        f"{added} of {effect} are needed (p = {final.fit.noise_p_value:.1g} for what they leave): a series of"
        " them also represents another linear effect, for example a delay."
    )
