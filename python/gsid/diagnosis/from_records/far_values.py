"""A linear effect beside a delay that is far from the given one, or a body without a gain: a wrong minimum.

Damping, lags and modes may exchange their places in equal models, so that their values move far. A delay has
no such counterpart but the hold, which is less than a sample: where it has moved far, delay and effect may
imitate another one together. So may a mode in the place of the sprung body, which leaves a body whose gain
the data do not determine.
"""

from __future__ import annotations

import math

from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel


def check_far_values(rounds: Rounds) -> None:
    """Make named linear effects the nearest if a value beside them tells of a wrong minimum; in place.

    Parameters
    ----------
    rounds : Rounds
        Of a given model.
    """
    final, given = rounds.final, rounds.first.given
    linear = [one for one in rounds.kept if is_linear(one.decision.effects[0])]
    if not linear or final is None or given is None:
        return
    reason = far_value(final.model, given, rounds.settings)
    if reason:
        rounds.demote(linear, reason, final)


def far_value(fitted: PlantModel, given: PlantModel, settings: DecisionSettings) -> str | None:
    """Which delay of a fit is far from the given one, or which gain is not determined, in a sentence.

    Parameters
    ----------
    fitted, given : PlantModel
        The first has all effects of the second.
    settings : DecisionSettings

    Returns
    -------
    str or None
    """
    found = dict(fitted.labels())
    for label, effect in given.labels():
        for name, known in effect.params.items():
            value, form = found[label].params[name], effect.type.linear_part
            in_given = f"{known.value:.3g} in the given model: together they may stand for another effect."
            is_beyond_hold = abs(value.value - known.value) * given.fs_hz > 1
            if form == "delay" and is_beyond_hold and _is_far(value, known.value, settings):
                return f"Beside it {label}.{name} is {value.value:.3g} +- {value.std:.1g}, and {in_given}"
            if form == "gain" and _is_undetermined(value):
                return f"Beside it the data do not determine {label}.{name}, which is {in_given}"
    return None


def _is_far(found: Param, known: float, settings: DecisionSettings) -> bool:
    """Whether a value is more than a factor from the given one, beyond its uncertainty."""
    if not known or not found.free or found.std is None or not math.isfinite(found.std):
        return False
    nearest = min(max(found.value, known / settings.strayed), known * settings.strayed)
    return abs(found.value - nearest) > settings.significant * found.std


def _is_undetermined(found: Param) -> bool:
    return found.free and found.std is not None and not found.std < abs(found.value)
