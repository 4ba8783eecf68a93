"""Whether several copies of one effect stand for another one: a series of modes imitates a delay or a lag."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.verdict import NEAREST
from gsid.plant.model import PlantModel


def check_series(rounds: Rounds) -> None:
    """Turn a named effect into the nearest where the model needs several copies of it.

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
