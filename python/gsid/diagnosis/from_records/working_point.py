"""A cubic spring at another working point than 0, and the laws of the angle that may take its place.

Cogging with its phase is any smooth law of the angle near one of its inflections, and an unbalance one whose
torque is a square. A cubic spring that a constant torque has shifted is such a law: the first stage, which
knows no constant torque, finds the other one.
"""

from __future__ import annotations

import math

import numpy as np

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.effects.ids import BIAS, COGGING, CUBIC, SPRING, UNBALANCE
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS


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
    model, stack = fitted.model, fitted.model.stack()
    if COGGING not in stack or SPRING not in stack or CUBIC in stack:
        return None
    level, cycles, phase = stack[COGGING].values()
    wave = cycles * RADIANS[model.angle_unit]
    mean = _mean_angle(fitted)
    m = round((wave * mean + phase) / math.pi)
    inflection, side = (m * math.pi - phase) / wave, (-1.0) ** m
    spring = stack[SPRING]["stiffness"]
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
    model, stack = fitted.model, fitted.model.stack()
    if UNBALANCE not in stack or SPRING not in stack or CUBIC in stack:
        return None
    level, at_rest_deg = stack[UNBALANCE].values()
    wave, at_rest, mean = RADIANS[model.angle_unit], math.radians(at_rest_deg), _mean_angle(fitted)
    phase, spring = wave * mean + at_rest, stack[SPRING]["stiffness"]
    torque = spring * mean + level * (math.sin(phase) - math.sin(at_rest))
    slope, half_curvature = spring + level * wave * math.cos(phase), -level * wave**2 * math.sin(phase) / 2
    shift = math.copysign(_half_travel(fitted), half_curvature)  # of the mean angle from the middle
    cubic = half_curvature / (3 * shift)
    stiffness = slope - half_curvature * shift
    if stiffness < 0:
        return None
    bias = torque - stiffness * shift - cubic * shift**3
    return _in_place_of(model, UNBALANCE, stiffness, cubic, bias)


def unbalance_in_place_of_cubic(fitted: Simulated) -> PlantModel | None:
    """The model with an unbalance that has the slope and the curvature of its cubic spring at the mean angle.

    The angle of the unbalance is counted from the mean, where the constant torque of the cubic spring has put
    the axis: it needs none of its own.

    Parameters
    ----------
    fitted : Simulated

    Returns
    -------
    PlantModel or None
        None without a cubic spring that a constant torque has shifted, beside another unbalance, if the axis
        does not turn, or if the torque falls with the angle at the mean.
    """
    model, stack = fitted.model, fitted.model.stack()
    if not {CUBIC, BIAS, SPRING} <= stack.keys() or UNBALANCE in stack or model.angle_unit == "m":
        return None
    cubic, mean, wave = stack[CUBIC]["stiffness"], _mean_angle(fitted), RADIANS[model.angle_unit]
    half_curvature = 3 * cubic * mean
    slope = stack[SPRING]["stiffness"] + 3 * cubic * mean**2
    if slope < 0:
        return None
    found = model.without_effect(CUBIC).without_effect(BIAS)
    found[f"{SPRING}.stiffness"].value = slope
    params = {"level": 2 * abs(half_curvature) / wave**2, "angle_deg": math.copysign(90.0, -half_curvature)}
    return found.with_effect(UNBALANCE, params)


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
