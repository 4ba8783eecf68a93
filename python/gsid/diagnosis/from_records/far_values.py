"""A linear effect beside a delay that is far from the given one, or a body without a gain: a wrong minimum.

Damping, lags and modes may exchange their places in equal models, so that their values move far. A delay has
no such counterpart but the hold, which is less than a sample: where it has moved far, delay and effect may
imitate another one together. So may a mode in the place of the sprung body, which leaves a body whose gain
the data do not determine. The gain over a damping may still be determined: its corner is above the band.
A mode that was added may also take the place of a given one, which then does what a lag does.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.doubts import is_resonance
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.linear_fit import basis
from gsid.effects.ids import BODY, DAMPING
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel


def check_far_values(rounds: Rounds) -> None:
    """Make named linear effects the nearest if a value beside them tells of a wrong minimum; in place.

    Parameters
    ----------
    rounds : Rounds
        Of a given model.
    """
    final, given = rounds.final, rounds.first.given
    linear = [one for one in rounds.kept if is_linear(one.decision.effects[0])]
    if not linear or final is None or given is None:
        return
    reason = undetermined_gain(final.model, given) if not _has_high_corner(final, given) else None
    far = far_delay(final.model, given, rounds.settings)
    if far and _is_refuted(rounds, final, far):
        reason = far.sentence
    reason = reason or replaced_mode(final, given, rounds.settings)
    if reason:
        rounds.demote(linear, reason, final)


@dataclass(frozen=True)
class FarDelay:
    """A delay that is far from the given one.

    Attributes
    ----------
    parameter : str
    nearest : float
        The nearest value that is not far [s].
    sentence : str
    """

    parameter: str
    nearest: float
    sentence: str


def far_delay(fitted: PlantModel, given: PlantModel, settings: DecisionSettings) -> FarDelay | None:
    """Find a delay that is more than a factor from the given one, beyond its uncertainty and a sample.

    Parameters
    ----------
    fitted, given : PlantModel
        The first has all effects of the second.
    settings : DecisionSettings
    """
    for parameter, known, found in _values(fitted, given, "delay"):
        if not known or not found.free or found.std is None or not math.isfinite(found.std):
            continue
        nearest = min(max(found.value, known / settings.strayed), known * settings.strayed)
        is_beyond_hold = abs(found.value - known) * given.fs_hz > 1
        if is_beyond_hold and abs(found.value - nearest) > settings.significant * found.std:
            is_now = f"{parameter} is {found.value:.3g} +- {found.std:.1g}"
            return FarDelay(parameter, nearest, f"Beside it {is_now}, and {_in_given(known)}")
    return None


def undetermined_gain(fitted: PlantModel, given: PlantModel) -> str | None:
    """Which gain of a body is smaller than its standard deviation, in a sentence.

    Parameters
    ----------
    fitted, given : PlantModel
        As `far_delay`.
    """
    for parameter, known, found in _values(fitted, given, "gain"):
        if found.free and found.std is not None and not found.std < abs(found.value):
            return f"Beside it the data do not determine {parameter}, which is {_in_given(known)}"
    return None


def replaced_mode(final: Simulated, given: PlantModel, settings: DecisionSettings) -> str | None:
    """Which given mode is no resonance any more where an added one is nearer to its frequency, in a sentence.

    Parameters
    ----------
    final : Simulated
        With all effects of the given model.
    given : PlantModel
    settings : DecisionSettings
    """
    before, after = _frequencies(given), _frequencies(final.model)
    added = [f_hz for label, f_hz in after.items() if label not in before]
    for label, f_hz in before.items():
        moved = abs(math.log(after[label] / f_hz))
        nearer = [one for one in added if abs(math.log(one / f_hz)) < moved]
        if nearer and not is_resonance(final.fit, label, settings):
            place = f"{nearer[0]:.4g} Hz has taken the place of that of {f_hz:.4g} Hz of the given model"
            return f"The mode of {place}, which is no resonance any more: a lag or a delay may do the same."
    return None


def _frequencies(model: PlantModel) -> dict[str, float]:
    """Of the modes, by their label [Hz]."""
    modes = {label: one for label, one in model.labels() if one.type.linear_part == "mode"}
    return {label: one.params["f_hz"].value for label, one in modes.items()}


def _values(fitted: PlantModel, given: PlantModel, form: str) -> Iterator[tuple[str, float, Param]]:
    """Name, given value and fitted parameter of each effect of a form."""
    found = dict(fitted.labels())
    for label, effect in given.labels():
        if effect.type.linear_part == form:
            for name, known in effect.params.items():
                yield f"{label}.{name}", known.value, found[label].params[name]


def _in_given(value: float) -> str:
    return f"{value:.3g} in the given model: together they may stand for another effect."


def _is_refuted(rounds: Rounds, final: Simulated, far: FarDelay) -> bool:
    """Whether the fit with the nearest delay that is not far costs significantly more.

    A standard deviation is that of small changes: a mode that the data hardly determine may make up for a
    large one.
    """
    run, model = rounds.first, copy.deepcopy(final.model)
    model[far.parameter].value, model[far.parameter].free = far.nearest, False
    fits = replace(run.simulations(), deadline=run.deadline.bounded(run.settings.moves_of_fit))
    fitted = fits.fit(model, final.effects)
    return fitted is None or fitted.cost - final.cost > run.settings.significant**2


def _has_high_corner(final: Simulated, given: PlantModel) -> bool:
    """Whether the data determine the gain over a missing damping, to within a factor of e."""
    names, pair = final.model.free_names, (f"{BODY}.gain", f"{DAMPING}.rate")
    if DAMPING in given.stack() or not set(pair) <= set(names):
        return False
    gain, rate = (names.index(name) for name in pair)
    jacobian, values = final.fit.jacobian, final.model.free_values
    by_ratio = values[gain] * jacobian[:, gain]
    by_both = by_ratio + values[rate] * jacobian[:, rate]
    others = basis(np.column_stack([np.delete(jacobian, [gain, rate], axis=1), by_both]))
    own = by_ratio - others @ (others.T @ by_ratio)
    return float(own @ own) > 1  # one over the variance of its logarithm
