"""A cubic spring at another working point than 0, from the law of the angle that was fitted in its place.

Cogging with its phase is any smooth law of the angle near one of its inflections, and an unbalance one whose
torque is a square. A cubic spring that a constant torque has shifted is such a law: the first stage, which
knows no constant torque, finds the other one.
"""

from __future__ import annotations

import math

import numpy as np

from gsid.diagnosis.from_records.canonical import SPRING
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS

COGGING, UNBALANCE = "motor_cogging", "mass_unbalance"
CUBIC, BIAS = "cubic_spring", "torque_bias"


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
    mean = _mean_angle(fitted)
    m = round((wave * mean + phase) / math.pi)
    inflection, side = (m * math.pi - phase) / wave, (-1.0) ** m
    spring = by_id[SPRING][1].params["stiffness"].value
    stiffness = spring + side * level * wave
    if stiffness < 0:
        return None
    cubic = -side * level * wave**3 / 6
    return _in_place_of(model, COGGING, stiffness, cubic, spring * inflection)


def cubic_in_place_of_unbalance(fitted: Simulated) -> PlantModel | None:
    """The model with a cubic spring that has the slope and the curvature of its unbalance at the mean angle.

    The third derivative of a weak unbalance is nearly 0: where the spring has its middle is not known. It is
    taken at the end of the travel on the side where the spring stiffens.

    Parameters
    ----------
    fitted : Simulated

    Returns
    -------
    PlantModel or None
        None without unbalance or without a spring, or if the torque would fall with the angle in the middle.
    """
    model = fitted.model
    by_id = {effect.id: (label, effect) for label, effect in model.labels()}
    if UNBALANCE not in by_id or SPRING not in by_id or CUBIC in by_id:
        return None
    level, at_rest_deg = (param.value for param in by_id[UNBALANCE][1].params.values())
    wave, at_rest = RADIANS[model.angle_unit], math.radians(at_rest_deg)
    mean, phase = _mean_angle(fitted), wave * _mean_angle(fitted) + at_rest
    spring = by_id[SPRING][1].params["stiffness"].value
    torque = spring * mean + level * (math.sin(phase) - math.sin(at_rest))
    slope, half_curvature = spring + level * wave * math.cos(phase), -level * wave**2 * math.sin(phase) / 2
    shift = math.copysign(_half_travel(fitted), half_curvature)  # of the mean angle from the middle
    cubic = half_curvature / (3 * shift)
    stiffness = slope - half_curvature * shift
    if stiffness < 0:
        return None
    bias = torque - stiffness * shift - cubic * shift**3
    return _in_place_of(model, UNBALANCE, stiffness, cubic, bias)


def _mean_angle(fitted: Simulated) -> float:
    return float(np.mean([one.prediction.angle.mean() for one in fitted.fit.records]))


def _half_travel(fitted: Simulated) -> float:
    """Of the record with the largest one."""
    return max(float(np.ptp(one.prediction.angle)) / 2 for one in fitted.fit.records)


def _in_place_of(model: PlantModel, law: str, stiffness: float, cubic: float, bias: float) -> PlantModel:
    """The model with both springs in place of a law, and a constant torque added to its own."""
    stack = model.without_effect(law)
    stack[f"{SPRING}.stiffness"].value = stiffness
    stack = stack.with_effect(CUBIC, {"stiffness": cubic})
    if BIAS not in stack.stack():
        return stack.with_effect(BIAS, {"level": bias})
    stack[f"{BIAS}.level"].value += bias
    return stack
