"""Starting values of an effect that is added, from the first stage of the diagnosis.

A law gets those of its joint fit with the linear part along the measured motion, an effect of the linear
part those of its fit in the frequency domain. A sensor that is sampled and held gets its rate from its
images. Play gets those of its fit along the measured motion of the load. What has no such start (play that
this motion does not show, a map of the command inside a closed loop) gets the best of several sizes by
simulation.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from gsid._lib import ffi
from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError
from gsid.diagnosis.from_records.law_part import is_of_linear_part, linear_only, without_laws
from gsid.diagnosis.held_sensor_rates import likely_rates
from gsid.diagnosis.joint_start import joint_start
from gsid.diagnosis.missing_torque import catalogue
from gsid.diagnosis.missing_torque.law_columns import Law
from gsid.diagnosis.missing_torque.linear_fit import fit_null
from gsid.diagnosis.missing_torque.motion import motions
from gsid.diagnosis.missing_torque.problem import Problem, linear_part
from gsid.diagnosis.missing_torque.ranking import Candidate, Scan, linear_candidates, scan_laws
from gsid.diagnosis.missing_torque.refit import refit
from gsid.diagnosis.missing_torque.settings import DEFAULTS
from gsid.effects.types import EffectType
from gsid.greybox.fit import CANNOT_FIT, PlantFit
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel

GRID_STARTS = 2  # points of a law's grid that are starts beside the joint fit
TOGETHER = 50  # maps of the command at a time, for their memory
SIZES = (0.03, 0.1, 0.3, 1.0, 3.0)  # times the typical size, for effects without a column
SIMULATED = 12  # points of a grid that are simulated for them
DELAY = "transport_delay.delay_s"

Limits = dict[str, tuple[float, float]]


def fixed_parameters(effect: EffectType) -> tuple[str, ...]:
    """Parameters without a derivative, which a fit leaves at their starting value.

    Parameters
    ----------
    effect : EffectType
    """
    jumps = effect.linear_part == "hold"
    return tuple(p.name for p in effect.parameters if jumps or (p.grid and p.grid.spacing == "rounding"))


def effect_starts(
    fit: PlantFit,
    effect: EffectType,
    band: tuple[float, float] | None = None,
    deadline: Deadline | None = None,
    given: PlantModel | None = None,
) -> list[PlantModel]:
    """Models with one more effect, at the values that a fit by simulation should start from.

    Parameters
    ----------
    fit : PlantFit
        Of the model without the effect.
    effect : EffectType
        Of the catalogue.
    band : (lo, hi), optional
        Hz; default as in `gsid.fit_plant`.
    deadline : Deadline, optional
    given : PlantModel, optional
        The model before its fit, which may have moved a mode to imitate play.

    Returns
    -------
    list of PlantModel
        At least one.

    Raises
    ------
    OutOfTime
        The deadline was reached.
    """
    if effect.linear_part == "hold":
        (rate,) = effect.names
        return [_held(fit, effect, rate, rate_hz) for rate_hz in likely_rates(fit, effect[rate].grid)]
    found = []
    if effect.id == BACKLASH:
        found = _of_joint(fit, given or fit.model, deadline)
    elif _has_column(effect, fit.model):
        found = _by_first_stage(fit, effect, band, deadline or Deadline())
    return found or [_best_size(fit, effect)]


def _of_joint(fit: PlantFit, given: PlantModel, deadline: Deadline | None) -> list[PlantModel]:
    """The model with play as the measured motion of the load shows it; none where it shows none."""
    with suppress(*CANNOT_FIT):
        start = joint_start(fit, given, deadline, is_clear=True)
        return [] if start is None else [start]
    return []


def _has_column(effect: EffectType, model: PlantModel) -> bool:
    """Whether the first stage knows what the effect adds to the measured output."""
    if effect.linear_part in catalogue.LINEAR_KINDS:
        return True
    if effect.c.command != ffi.NULL:
        return not model.has_controller
    return effect.c.torque != ffi.NULL and effect.c.n_states == 0


# ---- first stage -------------------------------------------------------------------------------------------


def _by_first_stage(
    fit: PlantFit, effect: EffectType, band: tuple[float, float] | None, deadline: Deadline
) -> list[PlantModel]:
    """The model with the effect at the values of the joint fit, and at those of the scan."""
    model, measured = fit.model, [record.spectra for record in fit.records]
    if not all(is_of_linear_part(each) for each in model.effects):
        measured = without_laws(measured, model, deadline)
    linear = linear_only(model)
    problem, given = Problem(linear, measured, band, DEFAULTS, deadline), linear_part(linear)
    null = fit_null(problem, given)
    moved = motions(problem, null.part)
    scan, scales = Scan(problem, null, moved), catalogue.scales(problem, moved)
    if effect.linear_part in catalogue.LINEAR_KINDS:
        (one,) = linear_candidates(scan, [effect], scales)
        refit(problem, null, one, moved, given)
        return [_joint(model, one, _limits_of_mode(one))]
    several = len(problem.records) if len(problem.records) > 1 else 0
    law = catalogue.law(effect, 0 if problem.has_mean_angle(null.part) else several)
    limits, fixed = _limits(law, scales), fixed_parameters(effect)
    starts = [model.with_effect(effect, each, limits, fixed) for each in _on_grid(scan, law, scales)]
    for one in scan_laws(scan, [law], scales):
        refit(problem, null, one, moved, given)
        if one.fit is not None:
            starts.insert(0, _joint(model, one, limits))
    return starts


def _joint(model: PlantModel, one: Candidate, limits: Limits) -> PlantModel:
    """A model with an effect, and with the linear part of their joint fit."""
    moved = _with_values(model, one.fit.part.stack)
    return moved.with_effect(one.effect, one.params, limits, fixed_parameters(one.effect))


def _on_grid(scan: Scan, law: Law, scales: dict[str, float]) -> list[dict[str, float]]:
    """Values of a law at the best points of its grid, beside a linear part that stays as it is.

    A law with memory may be a spring here: the effect is given, not named.
    """
    points, error = law.points(scales), scan.freed(scan.fit.error)
    if not len(points):
        return []
    if law.is_command:
        few = np.array_split(points, math.ceil(len(points) / TOGETHER))
        gains = np.concatenate([scan.command_gains(law, some, error) for some in few])
    else:
        gains, found = scan.torque_gains(law, points, error)
    best = [i for i in np.argsort(gains)[::-1][:GRID_STARTS] if gains[i] > 0]
    if law.is_command:
        return [{law.shapes[0].name: float(points[i, 0])} for i in best]
    return [law.params(points[i], found[i]) for i in best]


def _limits(law: Law, scales: dict[str, float]) -> Limits:
    """Range of a shape in a fit: that of its grid, beyond which the law is a simpler one in these data."""
    if len(law.shapes) != 1 or law.shapes[0].grid.spacing == "rounding":
        return {}
    points = law.points(scales)
    if not len(points):
        return {}
    return {law.shapes[0].name: (float(points.min()), float(points.max()))}


def _limits_of_mode(one: Candidate) -> Limits:
    """Of a mode, the frequencies of the search."""
    start = one.start
    ends = zip(start.names, start.lower, start.upper, strict=True)
    return {name.rpartition(".")[2]: (lo, hi) for name, lo, hi in list(ends)[-3:] if name.endswith(".f_hz")}


def _with_values(model: PlantModel, stack: Mapping[str, Mapping[str, float]]) -> PlantModel:
    """A copy of a model with the free values of a fitted linear part."""
    moved = copy.deepcopy(model)
    for label, effect in moved.labels():
        for name, value in stack.get(label, {}).items():
            if effect.params[name].free:
                effect.params[name].value = value
    return moved


def _held(fit: PlantFit, effect: EffectType, name: str, rate_hz: float) -> PlantModel:
    """The model with a sensor of a rate; half a hold time is taken from its delay."""
    larger = fit.model.with_effect(effect, {name: rate_hz}, fixed=fixed_parameters(effect))
    if DELAY in larger.free_names:
        larger[DELAY].value = max(larger[DELAY].value - 0.5 / rate_hz, 0.0)
    return larger


# ---- by simulation -----------------------------------------------------------------------------------------


def _best_size(fit: PlantFit, effect: EffectType) -> PlantModel:
    """The model with the effect at the size that simulates best."""
    fixed = fixed_parameters(effect)
    starts = [fit.model.with_effect(effect, params, fixed=fixed) for params in _sizes(fit, effect)]
    return min(starts, key=lambda model: _cost(model, fit))


def _sizes(fit: PlantFit, effect: EffectType) -> list[dict[str, float]]:
    if effect.c.command != ffi.NULL:
        (p,) = effect.parameters
        commands = [fit.model.drive_command(one.spectra, one.prediction) for one in fit.records]
        points = p.grid.at(max(float(np.max(np.abs(u))) for u in commands))
        return [{p.name: float(size)} for size in points[:: max(len(points) // SIMULATED, 1)]]
    strengths = [p for p in effect.parameters if p.null_value is not None]
    signs = (1, -1) if all(p.lower < 0 for p in strengths) else (1,)
    return [{p.name: sign * size * p.typical for p in strengths} for sign in signs for size in SIZES]


def _cost(model: PlantModel, fit: PlantFit) -> float:
    """Cost of a model with the weights of a given fit; infinite if the model cannot be simulated."""
    try:
        return fit.cost_of(model)
    except GsidError:
        return np.inf
