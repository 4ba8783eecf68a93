"""A spring in place of a law that contains one."""

from __future__ import annotations

import numpy as np

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.law_part import without
from gsid.diagnosis.from_records.what_is_left import along_simulated_motion
from gsid.diagnosis.missing_torque.catalogue import contains_spring, law
from gsid.diagnosis.missing_torque.law_columns import torques
from gsid.diagnosis.missing_torque.motion import motions
from gsid.diagnosis.missing_torque.problem import linear_part
from gsid.effects.ids import SPRING
from gsid.effects.types import find
from gsid.plant.model import PlantModel


def spring_in_place_of(fitted: Simulated) -> PlantModel | None:
    """The model with the spring whose torque is nearest to that of a law along the simulated motion.

    The other values stay those of the fit: from a start far off, the spring's own fit may end in a wrong
    minimum that a law of more shapes has left.

    Parameters
    ----------
    fitted : Simulated

    Returns
    -------
    PlantModel or None
        None if the law contains no spring, beside another spring, or if the torque falls with the angle.
    """
    effect = find(fitted.effects[0])
    if SPRING in fitted.model.stack() or not contains_spring(effect):
        return None
    problem = along_simulated_motion(fitted.fit)
    values = fitted.model.stack()[fitted.label]
    row = np.array([[values[p.name] for p in effect.parameters]])
    moved = motions(problem, linear_part(fitted.model))
    angle = np.concatenate([m.angle - m.angle.mean() for m in moved])
    torque = np.concatenate([torques(law(effect), row, m, problem.radians)[0] for m in moved])
    stiffness = float(angle @ torque) / float(angle @ angle)
    if not stiffness > 0:
        return None
    return without(fitted.model, [effect.id]).with_effect(SPRING, {"stiffness": stiffness})
