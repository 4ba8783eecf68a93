"""Limits inside which a mode of a given model stays a mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gsid.diagnosis.missing_torque.settings import DEFAULTS
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra
from gsid.structure.settings import StructureSettings

Limits = tuple[float, float]


def with_mode_limits(
    model: PlantModel, measured: Sequence[Spectra], band: Limits | None = None
) -> PlantModel:
    """A model whose modes stay resonances, in the band or near their frequency.

    Without such limits the mode of a model takes the place of a spring, a damping, a lag or a delay that is
    missing: with a large damping it is nearly any of them. Limits that the model itself has stay.

    Parameters
    ----------
    model : PlantModel
    measured : sequence of Spectra
    band : (lo, hi), optional
        Hz; default that of the excited lines.
    """
    if band is None:
        f_hz = [one.f_hz[one.excited] for one in measured]
        band = min(float(f.min()) for f in f_hz), max(float(f.max()) for f in f_hz)
    effects = [_limited(one, band) if one.type.linear_part == "mode" else one for one in model.effects]
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


def _limited(mode: Effect, band: Limits) -> Effect:
    f_hz, zeta = (mode.params[name] for name in ("f_hz", "zeta"))
    spread, largest = DEFAULTS.mode_spread, StructureSettings().zeta_max
    lowest, highest = DEFAULTS.mode_lowest * band[0], band[1]
    places = min(lowest, f_hz.value / spread), max(highest, f_hz.value * spread)
    limits = {"f_hz": places, "zeta": (mode.type["zeta"].lower, max(largest, zeta.value * spread))}
    params = {name: _with_limits(param, limits.get(name)) for name, param in mode.params.items()}
    return replace(mode, params=params)


def _with_limits(param: Param, limits: Limits | None) -> Param:
    return param if limits is None or param.limits is not None else replace(param, limits=limits)
