"""Limits inside which a mode of a given model stays a mode."""

from __future__ import annotations

from dataclasses import replace

from gsid.diagnosis.from_records.settings import DEFAULTS, DecisionSettings
from gsid.diagnosis.missing_torque.other_start import FARTHEST
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.structure.settings import StructureSettings

Limits = tuple[float, float]


def with_mode_limits(model: PlantModel, settings: DecisionSettings = DEFAULTS) -> PlantModel:
    """A model whose modes stay resonances near their frequency.

    Without such limits the mode of a model takes the place of a spring, a damping, a lag or a delay that is
    missing: at a low frequency it is the sprung body, with a large damping nearly any of them, and two that
    cancel each other imitate a damping. Limits that the model itself has stay.

    Parameters
    ----------
    model : PlantModel
    settings : DecisionSettings
    """
    effects = [_limited(one, settings) if one.type.linear_part == "mode" else one for one in model.effects]
    return replace(model, effects=effects)


def with_limits_of(model: PlantModel | None, given: PlantModel) -> PlantModel | None:
    """A fitted model with the limits of the given one.

    Parameters
    ----------
    model : PlantModel or None
    given : PlantModel
    """
    if model is None:
        return None
    known = dict(given.labels())
    effects = []
    for label, one in model.labels():
        before = known[label].params if label in known else {}
        params = {
            name: replace(param, limits=before[name].limits) if name in before else param
            for name, param in one.params.items()
        }
        effects.append(replace(one, params=params))
    return replace(model, effects=effects)


def _limited(mode: Effect, settings: DecisionSettings) -> Effect:
    f_hz, zeta, residue = (mode.params[name].value for name in ("f_hz", "zeta", "residue"))
    most = settings.largest_residue * max(abs(residue), 1.0)
    limits = {
        "f_hz": (f_hz / FARTHEST, f_hz * FARTHEST),
        "zeta": (mode.type["zeta"].lower, max(StructureSettings().zeta_max, zeta * FARTHEST)),
        "residue": (-most, most),
    }
    params = {name: _with_limits(param, limits.get(name)) for name, param in mode.params.items()}
    return replace(mode, params=params)


def _with_limits(param: Param, limits: Limits | None) -> Param:
    return param if limits is None or param.limits is not None else replace(param, limits=limits)
