"""A linear effect beside a delay that is far from the given one: the fit is in a wrong minimum.

Damping, lags and modes may exchange their places in equal models, so that their values move far. A delay has
no such counterpart but the hold, which is less than a sample: where it has moved far, delay and effect may
imitate another one together.
"""

from __future__ import annotations

import math

from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel


def check_delay(rounds: Rounds) -> None:
    """Make named linear effects the nearest if the delay beside them is far from its given value; in place.

    Parameters
    ----------
    rounds : Rounds
        Of a given model.
    """
    final, given = rounds.final, rounds.first.given
    linear = [one for one in rounds.kept if is_linear(one.decision.effects[0])]
    if not linear or final is None or given is None:
        return
    reason = far_delay(final.model, given, rounds.settings)
    if reason:
        rounds.demote(linear, reason, final)


def far_delay(fitted: PlantModel, given: PlantModel, settings: DecisionSettings) -> str | None:
    """Which delay of a fit is far from the given one beyond its uncertainty, in a sentence; None if none is.

    Parameters
    ----------
    fitted, given : PlantModel
        The first has all effects of the second.
    settings : DecisionSettings
    """
    found = dict(fitted.labels())
    delays = [(label, effect) for label, effect in given.labels() if effect.type.linear_part == "delay"]
    for label, effect in delays:
        for name, known in effect.params.items():
            value = found[label].params[name]
            if _is_far(value, known.value, settings) and abs(value.value - known.value) * given.fs_hz > 1:
                return (
                    f"Beside it {label}.{name} is {value.value:.3g} +- {value.std:.1g}, and {known.value:.3g}"
                    " in the given model: together they may stand for another effect."
                )
    return None


def _is_far(found: Param, known: float, settings: DecisionSettings) -> bool:
    if not known or not found.free or found.std is None or not math.isfinite(found.std):
        return False
    nearest = min(max(found.value, known / settings.strayed), known * settings.strayed)
    return abs(found.value - nearest) > settings.significant * found.std
