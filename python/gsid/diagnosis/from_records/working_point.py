"""A cubic spring at another working point than 0, from the cogging that was fitted in its place.

Cogging with its phase is any smooth law of the angle near one of its inflections. A cubic spring that a
constant torque has shifted is such a law: the first stage, which knows no constant torque, finds the cogging.
"""

from __future__ import annotations

import math

from gsid.diagnosis.from_records.canonical import SPRING
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS

COGGING, CUBIC, BIAS = "motor_cogging", "cubic_spring", "torque_bias"


def cubic_in_place_of_cogging(fitted: Simulated) -> PlantModel | None:
    """The model with the Taylor series of its cogging about the inflection nearest to the mean angle.

    With t = theta - theta_i, k theta + A sin(n theta + phase) = k theta_i + (k + s A n) t - s A n^3 t^3 / 6,
    where n theta_i + phase = m pi and s = (-1)^m. The angle is counted from the inflection.

    Parameters
    ----------
    fitted : Simulated

    Returns
    -------
    PlantModel or None
        None without cogging or without a spring, or if the torque falls with the angle at the inflection: a
        spring does not.
    """
    model = fitted.model
    by_id = {effect.id: (label, effect) for label, effect in model.labels()}
    if COGGING not in by_id or SPRING not in by_id or CUBIC in by_id:
        return None
    level, cycles, phase = (param.value for param in by_id[COGGING][1].params.values())
    wave = cycles * RADIANS[model.angle_unit]
    records = fitted.fit.records
    mean = sum(float(one.prediction.angle.mean()) for one in records) / len(records)
    m = round((wave * mean + phase) / math.pi)
    inflection, side = (m * math.pi - phase) / wave, (-1.0) ** m
    spring = by_id[SPRING][1].params["stiffness"].value
    stiffness = spring + side * level * wave
    if stiffness < 0:
        return None
    stack = model.without_effect(COGGING)
    stack[f"{SPRING}.stiffness"].value = stiffness
    stack = stack.with_effect(CUBIC, {"stiffness": -side * level * wave**3 / 6})
    if BIAS not in by_id:
        return stack.with_effect(BIAS, {"level": spring * inflection})
    stack[f"{BIAS}.level"].value += spring * inflection
    return stack
