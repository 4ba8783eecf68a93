"""Linear structures beside which play between motor and load is tried: without what imitates the joint."""

from __future__ import annotations

import math
from dataclasses import replace

from gsid.diagnosis.from_records.canonical import beside_body, canonical_stack, with_mode_as_body
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.effects.ids import BODY, DAMPING, LAGS, MODE, SPRING
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel

OWN_MODE = 2.0  # times the resonance of a body: a mode of another structure below that is this body
TINY_S = 1e-12  # a lag that is none
RESIDUE_LEAST = 1e-4  # of a mode that may be the body: a smaller share of the gain is not in the records


def structures_for_play(
    found: PlantModel, fitted: PlantModel, f_lo_hz: float, settings: DecisionSettings
) -> list[PlantModel]:
    """Canonical stacks without elements that may stand for a joint with play, the likelier first.

    Parameters
    ----------
    found : PlantModel
        Of `gsid.start`.
    fitted : PlantModel
        The canonical stack, fitted by simulation: its body is the sprung axis where that of `found` is not.
    f_lo_hz, settings
        As `canonical_stack`.

    Returns
    -------
    list of PlantModel
        Three at most, whose body is the element with the lowest resonance. The first is the fitted stack with
        the sharp modes of `found` beside its body; if there are none, with its own. In the others modes above
        the band are left out, and then the mode with the largest damping.
    """
    fitted, swapped = (_with_one_lag(_lowest_as_body(_lags_as_body(one))) for one in (fitted, found))
    sharp = _sharp_modes(swapped, settings)
    if SPRING not in found.stack():  # then its sprung body is one of its modes
        sharp = [mode for mode in sharp if mode.params["f_hz"].value > OWN_MODE * _resonance_hz(fitted)]
    first = _with_modes(fitted, _beside(sharp, swapped, fitted) or _sharp_modes(fitted, settings))
    modes = sorted(_free_modes(swapped), key=lambda mode: mode.params["zeta"].value)
    fewer = [modes[:-1]] if modes else []
    is_swapped = sum(e.id == MODE for e in swapped.effects) < sum(e.id == MODE for e in found.effects)
    kept = [modes, *fewer] if is_swapped or not modes else fewer
    tried = [first, *(_with_modes(swapped, some) for some in kept)]
    return [canonical_stack(one, f_lo_hz, settings, merged=False) for one in tried]


def _free_modes(model: PlantModel) -> list[Effect]:
    """Its modes that are not held fixed: those above the band are."""
    return [effect for effect in model.effects if effect.id == MODE and effect.params["f_hz"].free]


def _sharp_modes(model: PlantModel, settings: DecisionSettings) -> list[Effect]:
    return [one for one in _free_modes(model) if one.params["zeta"].value < settings.zeta_of_mode]


def _beside(modes: list[Effect], own: PlantModel, other: PlantModel) -> list[Effect]:
    """The modes of a model beside the body of another one: a residue is a share of the body's gain."""
    gain, of_other = (one.stack()[BODY]["gain"] for one in (own, other))
    return [beside_body(mode, of_other / gain) for mode in modes]


def _with_modes(model: PlantModel, modes: list[Effect]) -> PlantModel:
    return replace(model, effects=[*(e for e in model.effects if e.id != MODE), *modes])


def _lowest_as_body(model: PlantModel) -> PlantModel:
    """The model with the lowest mode as the sprung body, if it lies below the resonance of the body."""
    stack = model.stack()
    modes = [e for e in model.effects if e.id == MODE and abs(e.params["residue"].value) > RESIDUE_LEAST]
    if SPRING not in stack or BODY not in stack or not modes:
        return model
    lowest = min(modes, key=lambda mode: mode.params["f_hz"].value)
    is_body = lowest.params["f_hz"].value < _resonance_hz(model)
    return with_mode_as_body(model, lowest) if is_body else model


def _lags_as_body(model: PlantModel) -> PlantModel:
    """The model with two slow lags as the sprung body, if their corner lies below the resonance of the body.

    A sprung axis that is damped more than critically has two real poles, and the body is then the joint. The
    modes keep their response at their resonance, where the lags have turned it by half a turn.
    """
    stack = model.stack()
    lags = [stack[effect] for effect in LAGS if effect in stack]
    if SPRING not in stack or len(lags) < len(LAGS):
        return model
    rates = [1 / max(lag["time_constant_s"], TINY_S) for lag in lags]
    if not math.prod(rates) < (2 * math.pi * _resonance_hz(model)) ** 2:
        return model
    gain = stack[BODY]["gain"] / stack[SPRING]["stiffness"] * math.prod(rates)
    of_body = {
        BODY: {"gain": gain},
        DAMPING: {"rate": sum(rates)},
        SPRING: {"stiffness": math.prod(rates)},
    }
    effects = [
        Effect(label, {name: Param(value) for name, value in params.items()})
        for label, params in of_body.items()
    ]
    for other in (e for e in model.effects if e.id not in (*of_body, *LAGS)):
        if other.id == MODE:
            w0 = 2 * math.pi * other.params["f_hz"].value
            by_lags = -math.prod(rates) / w0**2
            other = beside_body(other, gain / (stack[BODY]["gain"] * by_lags))
        effects.append(other)
    return replace(model, effects=effects)


def _resonance_hz(model: PlantModel) -> float:
    """Undamped resonance of the body with its spring [Hz]; 0 without a spring."""
    stiffness = model.stack().get(SPRING, {"stiffness": 0.0})["stiffness"]
    return math.sqrt(max(stiffness, 0.0)) / (2 * math.pi)


def _with_one_lag(model: PlantModel) -> PlantModel:
    """The model without its second lag, which may stand for the joint as well."""
    second = [effect for effect in model.effects if effect.id in LAGS][1:]
    return replace(
        model, effects=[effect for effect in model.effects if all(effect is not one for one in second)]
    )


def is_same_structure(one: PlantModel, other: PlantModel) -> bool:
    """Whether two models have the same elements.

    Parameters
    ----------
    one, other : PlantModel
    """
    return sorted(effect.id for effect in one.effects) == sorted(effect.id for effect in other.effects)


def with_values_of(given: PlantModel, other: PlantModel) -> PlantModel:
    """A model with the free values of another one of the same elements, modes in the order of frequency.

    Parameters
    ----------
    given, other : PlantModel
    """
    label_in_other = dict(zip(_ordered_labels(given), _ordered_labels(other), strict=True))
    values = []
    for name in given.free_names:
        label, _, parameter = name.rpartition(".")
        values.append(other[f"{label_in_other[label]}.{parameter}"].value)
    return given.with_values(values)


def _ordered_labels(model: PlantModel) -> list[str]:
    """Labels by the id of their effects, those of modes by frequency."""

    def place(pair: tuple[str, Effect]) -> tuple[str, float]:
        effect = pair[1]
        return effect.id, effect.params["f_hz"].value if effect.id == MODE else 0.0

    return [label for label, _ in sorted(model.labels(), key=place)]
