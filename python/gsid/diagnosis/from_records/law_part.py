"""Records without what the laws of a model add to the output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.torque_residual import TorqueResidual, torque_residual
from gsid.plant.effect import Effect
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant
from gsid.spectrum.spectra import Spectra


def is_of_linear_part(effect: Effect) -> bool:
    """Whether an effect of a stack is a part of the linear structure.

    Parameters
    ----------
    effect : Effect
    """
    return effect.type.null_kind == "never" or is_linear(effect.id)


def linear_only(model: PlantModel) -> PlantModel:
    """A model without its laws: the linear part, with the same values.

    Parameters
    ----------
    model : PlantModel
    """
    stays = [effect for effect in model.effects if is_of_linear_part(effect)]
    return replace(model, effects=stays, cov=None, cov_names=None, fit=None)


def missing_torque(
    model: PlantModel, measured: Sequence[Spectra], band: tuple[float, float] | None
) -> tuple[TorqueResidual, TorqueResidual]:
    """Torque missing from the linear part of a model with a law, and the same by the law.

    Parameters
    ----------
    model : PlantModel
        Fitted, with a law.
    measured : sequence of Spectra
    band : (lo, hi) or None
        Hz.

    Returns
    -------
    measured, by_law : TorqueResidual
        Along the motion of the model; the second is that of the model's own output.
    """
    linear = linear_only(model)
    simulated = [replace(one, Y=one.Y - one.y + model.predict(one).Y) for one in measured]
    both = [torque_residual(linear, each, band=band, along=model) for each in (list(measured), simulated)]
    return both[0], both[1]


def without_laws(measured: Sequence[Spectra], model: PlantModel, deadline: Deadline) -> list[Spectra]:
    """Records as if the axis had the linear part of a model only.

    Parameters
    ----------
    measured : sequence of Spectra
    model : PlantModel
        Fitted to them.
    deadline : Deadline

    Returns
    -------
    list of Spectra
        Each period is reduced by the difference of both simulations.

    Raises
    ------
    OutOfTime
        The deadline was reached.
    """
    linear = linear_only(model)

    def by_laws(one: Spectra) -> np.ndarray:
        both = [PeriodicPlant.of(each, one, deadline).run().Y for each in (model, linear)]
        return both[0] - both[1]

    return [replace(one, Y=one.Y - by_laws(one)) for one in measured]
