"""A delay in place of a lag, and a lag in place of a delay.

Both are nearly the same at low frequency, and from a start far off the own fit of the right one may end in a
wrong minimum that the other has left. The other values stay those beside that other one.
"""

from __future__ import annotations

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.law_part import label_of, without
from gsid.effects.ids import DELAY, LAGS
from gsid.plant.model import PlantModel


def delay_or_lag_in_place_of(fitted: Simulated) -> dict[str, PlantModel]:
    """The fitted model with a delay in place of its lag, or with each lag in place of its delay.

    Parameters
    ----------
    fitted : Simulated

    Returns
    -------
    dict of str to PlantModel
        By effect; those that the model has already are not in it. The delay is the time constant, both in s.
    """
    effect, model = fitted.effects[0], fitted.model
    if effect not in (DELAY, *LAGS):
        return {}
    base, (seconds,) = without(model, (effect,)), model.stack()[label_of(model, effect)].values()
    others = {one: "time_constant_s" for one in LAGS} if effect == DELAY else {DELAY: "delay_s"}
    return {
        one: base.with_effect(one, {parameter: seconds})
        for one, parameter in others.items()
        if one not in model.stack()
    }
