"""A linear effect beside a delay that is far from the given one, or a body without a gain: a wrong minimum.

Damping, lags and modes may exchange their places in equal models, so that their values move far. A delay has
no such counterpart but the hold, which is less than a sample: where it has moved far, delay and effect may
imitate another one together. So may a mode in the place of the sprung body, which leaves a body whose gain
the data do not determine. The gain over a damping may still be determined: its corner is above the band.
"""

from __future__ import annotations

import math

import numpy as np

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.linear_fit import basis
from gsid.effects.ids import BODY, DAMPING
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
    reason = far_value(final.model, given, rounds.settings, has_high_corner=_has_high_corner(final, given))
    if reason:
        rounds.demote(linear, reason, final)


def far_value(
    fitted: PlantModel, given: PlantModel, settings: DecisionSettings, *, has_high_corner: bool = False
) -> str | None:
    """Which delay of a fit is far from the given one, or which gain is not determined, in a sentence.

    Parameters
    ----------
    fitted, given : PlantModel
        The first has all effects of the second.
    settings : DecisionSettings
    has_high_corner : bool
        Whether the data determine the gain of the body over a damping, if not the gain alone.

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
            if form == "gain" and _is_undetermined(value) and not has_high_corner:
                return f"Beside it the data do not determine {label}.{name}, which is {in_given}"
    return None


def _has_high_corner(final: Simulated, given: PlantModel) -> bool:
    """Whether the data determine the gain over a missing damping, to within a factor of e."""
    names, pair = final.model.free_names, (f"{BODY}.gain", f"{DAMPING}.rate")
    if DAMPING in given.stack() or not set(pair) <= set(names):
        return False
    gain, rate = (names.index(name) for name in pair)
    jacobian, values = final.fit.jacobian, final.model.free_values
    by_ratio = values[gain] * jacobian[:, gain]
    by_both = by_ratio + values[rate] * jacobian[:, rate]
    others = basis(np.column_stack([np.delete(jacobian, [gain, rate], axis=1), by_both]))
    own = by_ratio - others @ (others.T @ by_ratio)
    return float(own @ own) > 1  # one over the variance of its logarithm


def _is_far(found: Param, known: float, settings: DecisionSettings) -> bool:
    """Whether a value is more than a factor from the given one, beyond its uncertainty."""
    if not known or not found.free or found.std is None or not math.isfinite(found.std):
        return False
    nearest = min(max(found.value, known / settings.strayed), known * settings.strayed)
    return abs(found.value - nearest) > settings.significant * found.std


def _is_undetermined(found: Param) -> bool:
    return found.free and found.std is not None and not found.std < abs(found.value)
