"""A spring in place of a law that contains one, or of a mode that stands for the sprung body.

From a start far off, the spring's own fit may end in a wrong minimum that a law of more shapes has left. The
other values stay those beside that law.
"""

from __future__ import annotations

import numpy as np

from gsid.diagnosis.from_records.canonical import with_mode_as_body
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.law_part import without
from gsid.diagnosis.from_records.what_is_left import along_simulated_motion
from gsid.diagnosis.missing_torque.catalogue import contains_spring, law
from gsid.diagnosis.missing_torque.law_columns import torques
from gsid.diagnosis.missing_torque.motion import motions
from gsid.diagnosis.missing_torque.problem import linear_part
from gsid.effects.ids import BODY, DAMPING, SPRING
from gsid.effects.types import find
from gsid.plant.model import PlantModel


def spring_in_place_of(fitted: Simulated) -> PlantModel | None:
    """The fitted model with a spring in place of its law.

    Parameters
    ----------
    fitted : Simulated

    Returns
    -------
    PlantModel or None
        None beside another spring, or if the law contains none.
    """
    effect, stack = find(fitted.effects[0]), fitted.model.stack()
    if SPRING in stack or BODY not in stack:
        return None
    if effect.linear_part == "mode":
        return _with_sprung_body(fitted)
    return _with_slope(fitted) if contains_spring(effect) else None


def _with_sprung_body(fitted: Simulated) -> PlantModel | None:
    """With the mode as the body, and a damping only if the model has one; None for a gain of another sign."""
    label, stack = fitted.label, fitted.model.stack()
    if stack[label]["residue"] <= 0:
        return None
    model = with_mode_as_body(fitted.model, dict(fitted.model.labels())[label])
    return model if DAMPING in stack else model.without_effect(DAMPING)


def _with_slope(fitted: Simulated) -> PlantModel | None:
    """With the spring whose torque is nearest to that of the law; None if that falls with the angle."""
    effect, values = find(fitted.effects[0]), fitted.model.stack()[fitted.label]
    problem = along_simulated_motion(fitted.fit)
    row = np.array([[values[p.name] for p in effect.parameters]])
    moved = motions(problem, linear_part(fitted.model))
    angle = np.concatenate([m.angle - m.angle.mean() for m in moved])
    torque = np.concatenate([torques(law(effect), row, m, problem.radians)[0] for m in moved])
    stiffness = float(angle @ torque) / float(angle @ angle)
    if not stiffness > 0:
        return None
    return without(fitted.model, fitted.effects).with_effect(SPRING, {"stiffness": stiffness})
