"""The stack on which laws are judged: one body with damping and spring, one lag, the modes and the delay.

A law biases the linear structure. A body and a low mode are a spring that friction has split; a spring or a
lag that the start did not find may be hidden by the law. The canonical stack therefore has one body with a
spring, and a lag, whose values may become zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.effects.ids import BODY, DAMPING, DELAY, LAGS, MODE, SPRING
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.plant.units import OUTPUTS, RADIANS
from gsid.spectrum.spectra import Spectra

Stack = dict[str, dict[str, float]]


def has_low_mode(model: PlantModel, f_lo_hz: float, settings: DecisionSettings) -> bool:
    """Whether the canonical stack leaves out a mode, or merges it with the body.

    Parameters
    ----------
    model : PlantModel
    f_lo_hz, settings
        As `canonical_stack`.
    """
    modes = [effect for effect in model.effects if effect.id == MODE]
    return any(mode.params["f_hz"].value < settings.low_mode * f_lo_hz for mode in modes)


def canonical_stack(
    model: PlantModel, f_lo_hz: float, settings: DecisionSettings, *, merged: bool = True
) -> PlantModel:
    """The canonical stack of a linear model.

    Parameters
    ----------
    model : PlantModel
        Of `gsid.start`.
    f_lo_hz : float
        Lowest line [Hz].
    settings : DecisionSettings
    merged : bool
        Whether low modes are merged with the body or left out.

    Returns
    -------
    PlantModel
        All its parameters are free, except those that the start holds fixed: modes above the band, and the
        rate of a sensor that is sampled and held.
    """
    modes = [effect.params for effect in model.effects if effect.id == MODE]
    ours = (BODY, DAMPING, SPRING, DELAY, *LAGS)
    stack = {effect.id: _values(effect.params) for effect in model.effects if effect.id in ours}
    others = [effect for effect in model.effects if effect.id not in (*ours, MODE)]
    low = [mode for mode in modes if merged and mode["f_hz"].value < settings.low_mode * f_lo_hz]
    corner = 2 * math.pi * settings.corner * f_lo_hz
    if low and SPRING not in stack:
        _merge(stack, _values(low[0]))
    stack.setdefault(DAMPING, {"rate": corner})
    stack.setdefault(SPRING, {"stiffness": corner**2})
    sample_s = 1 / model.fs_hz
    if not any(lag in stack for lag in LAGS):
        stack[LAGS[0]] = {"time_constant_s": settings.lag_share * sample_s}
    stack.setdefault(DELAY, {"delay_s": settings.lag_share * sample_s})
    effects = [Effect(label, _free(params)) for label, params in stack.items()]
    effects += [Effect(effect.id, dict(effect.params)) for effect in others]
    effects += [Effect(MODE, dict(mode)) for mode in modes if mode not in low]
    return PlantModel(
        fs_hz=model.fs_hz,
        effects=effects,
        output=model.output,
        angle_unit=model.angle_unit,
        u_unit=model.u_unit,
    )


def resonant_stack(model: PlantModel, f_lo_hz: float, settings: DecisionSettings) -> PlantModel | None:
    """The canonical stack with the lowest mode as the sprung body; None if the body resonates itself.

    A hysteresis turns the response below the resonance by a constant angle. A linear structure needs a slow
    body for that, beside which the resonance of the axis is a mode.

    Parameters
    ----------
    model : PlantModel
        Of `gsid.start`.
    f_lo_hz, settings
        As `canonical_stack`.
    """
    stack = {effect.id: _values(effect.params) for effect in model.effects if effect.id != MODE}
    in_band = [e for e in model.effects if e.id == MODE and e.params["f_hz"].free]
    if not in_band or _resonates(stack):
        return None
    lowest = min(in_band, key=lambda mode: mode.params["f_hz"].value)
    smaller = with_mode_as_body(model, lowest)
    stays = [e for e in smaller.effects if e.id != MODE or e.params["f_hz"].free]
    return canonical_stack(replace(smaller, effects=stays), f_lo_hz, settings, merged=False)


def with_mode_as_body(model: PlantModel, mode: Effect) -> PlantModel:
    """A linear model with a mode as the sprung body, in place of its body, damping and spring.

    Parameters
    ----------
    model : PlantModel
    mode : Effect
        One of its modes.
    """
    values = _values(mode.params)
    gain = next(effect.params["gain"].value for effect in model.effects if effect.id == BODY)
    w0 = 2 * math.pi * values["f_hz"]
    of_body = {
        BODY: {"gain": gain * values["residue"]},
        DAMPING: {"rate": 2 * values["zeta"] * w0},
        SPRING: {"stiffness": w0**2},
    }
    effects = [Effect(label, _free(params)) for label, params in of_body.items()]
    others = [e for e in model.effects if e.id not in of_body and e is not mode]
    effects += [beside_body(e, values["residue"]) if e.id == MODE else e for e in others]
    return replace(model, effects=effects)


def beside_body(mode: Effect, ratio: float) -> Effect:
    """A mode beside another body: its residue is a share of the body's gain.

    Parameters
    ----------
    mode : Effect
    ratio : float
        Gain of the other body over that of its own.
    """
    own = mode.params["residue"]
    return replace(mode, params=mode.params | {"residue": replace(own, value=own.value / ratio)})


def _resonates(stack: Stack) -> bool:
    """Whether the body with its spring is damped less than critically."""
    stiffness = stack.get(SPRING, {"stiffness": 0.0})["stiffness"]
    return stack.get(DAMPING, {"rate": 0.0})["rate"] ** 2 < 4 * stiffness


def _merge(stack: Stack, mode: dict[str, float]) -> None:
    """One sprung body in place of a body without a spring and a low mode."""
    w0 = 2 * math.pi * mode["f_hz"]
    stack[BODY]["gain"] *= 1 + mode["residue"]  # the response far above the mode
    stack[DAMPING] = {"rate": 2 * mode["zeta"] * w0}
    stack[SPRING] = {"stiffness": w0**2}


def _values(params: dict[str, Param]) -> dict[str, float]:
    return {name: p.value for name, p in params.items()}


def _free(params: dict[str, float]) -> dict[str, Param]:
    return {name: Param(value, free=True) for name, value in params.items()}


def pruned(model: PlantModel, f_lo_hz: float, settings: DecisionSettings) -> PlantModel:
    """A stack without the elements of the canonical one whose values became zero.

    With a spring any damping stays: far below the lowest line it still limits the resonance.

    Parameters
    ----------
    model : PlantModel
    f_lo_hz, settings
        As `canonical_stack`.
    """
    corner, sample_s = 2 * math.pi * f_lo_hz * settings.vanished, 1 / model.fs_hz
    least = {SPRING: corner**2, DAMPING: corner, DELAY: settings.vanished_delay * sample_s}
    least |= dict.fromkeys(LAGS, settings.vanished * sample_s)
    if any(e.id == SPRING and e.params["stiffness"].value > least[SPRING] for e in model.effects):
        least[DAMPING] = 0.0
    stays = [
        effect
        for effect in model.effects
        if effect.id not in least or next(iter(effect.params.values())).value > least[effect.id]
    ]
    return replace(model, effects=stays)


def insignificant(model: PlantModel, settings: DecisionSettings) -> list[str]:
    """Elements that the canonical stack always has and that a fit made zero, within its standard deviation.

    Parameters
    ----------
    model : PlantModel
        Fitted.
    settings : DecisionSettings
    """
    sizes = {}
    for effect in model.effects:
        if effect.id in (DAMPING, SPRING, DELAY, *LAGS):
            (param,) = effect.params.values()
            if param.free:
                is_known = param.std is not None and param.std > 0  # not NaN, which is undetermined
                sizes[effect.id] = abs(param.value) / param.std if is_known else 0.0
    return sorted((e for e, size in sizes.items() if size < settings.significant), key=lambda e: sizes[e])


def without_wrong_unit(measured: Sequence[Spectra], model: PlantModel) -> list[Spectra]:
    """Records without the unit of an output that the model's output contradicts: an angle that is a rate.

    Parameters
    ----------
    measured : sequence of Spectra
    model : PlantModel
        Its output was inferred from the data.
    """
    units = {unit + ("" if model.output == "angle" else "/s") for unit in RADIANS}
    return [replace(one, y_unit=one.y_unit if one.y_unit in units else "") for one in measured]


def unit_of_values(y_unit: str, model: PlantModel) -> str | None:
    """The sentence that values are in the unit of the output where they state that of the model's angle.

    Parameters
    ----------
    y_unit : str
        Of the record.
    model : PlantModel

    Returns
    -------
    str or None
        None if the unit is not stated, or is one that a model can have.
    """
    if not y_unit or y_unit in OUTPUTS:
        return None
    unit = y_unit.removesuffix("/s") if model.output == "rate" else y_unit
    return f"y is in {y_unit}: values in {model.angle_unit} are in {unit}; --factor and --unit convert it"
