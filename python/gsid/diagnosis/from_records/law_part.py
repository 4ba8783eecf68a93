"""Records without what the laws of a model add to the output."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records.draft import LINEAR_PARTS
from gsid.diagnosis.torque_residual import TorqueResidual, torque_residual
from gsid.effects.types import find
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
    return effect.type.null_kind == "never" or effect.type.linear_part in LINEAR_PARTS


def linear_only(model: PlantModel) -> PlantModel:
    """A model without its laws: the linear part, with the same values.

    Parameters
    ----------
    model : PlantModel
    """
    stays = [effect for effect in model.effects if is_of_linear_part(effect)]
    return replace(model, effects=stays, cov=None, cov_names=None, fit=None)


def missing_torque(
    model: PlantModel, without: PlantModel, measured: Sequence[Spectra], band: tuple[float, float] | None
) -> tuple[TorqueResidual, TorqueResidual]:
    """Torque missing from a model without the effects found, and the same by these effects.

    Parameters
    ----------
    model : PlantModel
        Fitted, with the effects found.
    without : PlantModel
        The same without them.
    measured : sequence of Spectra
    band : (lo, hi) or None
        Hz.

    Returns
    -------
    measured, by_law : TorqueResidual
        Along the motion of the model; the second is that of the model's own output.
    """
    simulated = [replace(one, Y=one.Y - one.y + model.predict(one).Y) for one in measured]
    both = [torque_residual(without, each, band=band, along=model) for each in (list(measured), simulated)]
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


def label_of(model: PlantModel, effect: str) -> str:
    """Label of the effect that was added last with this id.

    Parameters
    ----------
    model : PlantModel
    effect : str

    Raises
    ------
    KeyError
        The model does not have it.
    """
    for label, one in reversed(list(model.labels())):
        if one.id == effect:
            return label
    raise KeyError(effect)


def without(model: PlantModel, effects: Sequence[str]) -> PlantModel:
    """A model without effects, of several with one id those that were added last.

    Parameters
    ----------
    model : PlantModel
    effects : sequence of str
        An id as often as effects with this id are left out.
    """
    left, stays = Counter(effects), []
    for one in reversed(model.effects):
        if left[one.id] > 0:
            left[one.id] -= 1
        else:
            stays.insert(0, one)
    return replace(model, effects=stays, cov=None, cov_names=None, fit=None)


def without_added(model: PlantModel, null: PlantModel) -> list[PlantModel]:
    """A fitted model without what was added to another one; if that is a mode, also without each other.

    Two modes may exchange their places during a fit.

    Parameters
    ----------
    model : PlantModel
        With at least one effect more.
    null : PlantModel
    """
    added = [label.partition("#")[0] for label in model.stack() if label not in null.stack()]
    base = without(model, added)
    if all(find(effect).linear_part != "mode" for effect in added):
        return [base]
    modes = [one for one in base.effects if one.type.linear_part == "mode"]
    without_each = [[one for one in model.effects if one is not mode] for mode in modes]
    return [base, *(replace(base, effects=stays) for stays in without_each)]
