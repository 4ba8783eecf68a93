"""Where the fit of a joint with play between motor and load begins.

A joint changes the linear part too: two masses on a spring, softer the more of the time the play is open. So
that part is fitted first, to the frequency response measured at the highest level, where the play matters
least. Its spring is softer than the true one: stiffer ones with more play go as starts into a fit that takes
the load's motion as measured (`gsid.diagnosis.joint_fit`). In closed loop, and behind a sensor that holds,
the play is looked for by simulation.
"""

from __future__ import annotations

import copy

import numpy as np

from gsid.base.errors import GsidError
from gsid.diagnosis.joint_fit import fit_joint
from gsid.greybox.fit import PlantFit
from gsid.greybox.linear_start import LINEAR, linear_error, linear_start
from gsid.plant.linear_response import JOINT
from gsid.plant.model import PlantModel
from gsid.spectrum.lines import lines_of
from gsid.spectrum.spectra import Spectra

FREQUENCIES = (0.4, 0.6, 0.9, 1.6)  # of the joint, over the highest excited line
LOUD = 0.95  # of the largest input: records of the highest level
GAPS = (0.1, 0.3, 1.0, 3.0, 10.0)  # over the twist that the motor's torque makes
RATIOS = (0.4, 0.15)  # of the inertias: the response does not tell them
STIFFER = (1.0, 2.5, 6.0, 20.0)  # the spring in contact, over the one that the response shows
DAMPING = 0.1  # over the critical one
FALL = 0.9  # of the response's error, for a joint to be worth its simulations


def joint_starts(fit: PlantFit, measured: list[Spectra], given: PlantModel) -> list[tuple[PlantModel, float]]:
    """Models with a joint added, and by how much each lowers the response's error.

    Parameters
    ----------
    fit : PlantFit
        Of the model without it.
    measured : list of Spectra
    given : PlantModel
        The model before it was fitted. Without a joint a fit may bend a mode far away to stand for it, and
        the way back leads past other minima.

    Returns
    -------
    list of (PlantModel, float)
        At most one, of the frequencies tried the best; none when a joint does not help the response.
    """
    largest = max(float(np.linalg.norm(one.u)) for one in measured)
    loud = [one for one in measured if np.linalg.norm(one.u) > LOUD * largest]
    highest = max(float(one.f_hz[one.excited].max()) for one in loud)
    before = linear_error(linear_start(fit.model, loud), loud)
    tried = []
    for origin in (fit.model, _as_given(fit.model, given)):
        for share in FREQUENCIES:
            model = linear_start(_with_joint(origin, share * highest, RATIOS[0]), loud)
            tried.append((linear_error(model, loud), origin, share, model))
    least, origin, share, soft = min(tried, key=lambda one: one[0])
    if not least < FALL * before:
        return []
    others = [linear_start(_with_joint(origin, share * highest, ratio), loud) for ratio in RATIOS[1:]]
    if not (
        fit.model.has_controller or any(effect.id == "sensor_sample_hold" for effect in fit.model.effects)
    ):
        starts = [one for model in (soft, *others) for one in _with_play(fit, model, measured)]
        return [(fit_joint(starts, fit, measured), before - least)]
    looked = [start for model in (soft, *others) if (start := _best_gap(fit, model, measured)) is not None]
    return [(min(looked, key=lambda one: one[0])[1], before - least)] if looked else []


def _as_given(model: PlantModel, given: PlantModel) -> PlantModel:
    """The linear part's free parameters at the values that were given, as far as there are any."""
    known = set(given.free_names) & LINEAR
    return model.with_values([(given if name in known else model)[name].value for name in model.free_names])


def _with_play(fit: PlantFit, model: PlantModel, measured: list[Spectra]) -> list[PlantModel]:
    """Stiffer springs with play, each of which may look like the soft one of the response."""
    twist = _largest_twist(fit, model, measured)
    starts = []
    for stiffer in STIFFER:
        for gap in GAPS:
            start = copy.deepcopy(model)
            start[f"{JOINT}.stiffness"].value *= stiffer
            start[f"{JOINT}.gap_deg"].value = float(gap * twist)
            starts.append(start)
    return starts


def _with_joint(model: PlantModel, f_hz: float, ratio: float) -> PlantModel:
    rad_s, reduced = 2 * np.pi * f_hz, ratio / (1 + ratio)
    values = {
        "gap_deg": 0.0,
        "stiffness": rad_s**2 * reduced,
        "inertia_ratio": ratio,
        "damping": 2 * DAMPING * rad_s * reduced,
    }
    larger = model.with_effect(JOINT, values)
    _refer_to_load(larger, 1 + ratio)
    return larger


def _refer_to_load(model: PlantModel, inertia: float) -> None:
    """Torques over the load's inertia, where they were over the whole axis's."""
    for effect in model.effects[:-1]:
        known = effect.type
        for name, param in effect.params.items():
            if known.stage == "torque" and (known[name].null_value == 0 or effect.id == "rigid_body"):
                param.value *= inertia
            elif effect.id == "flexible_mode" and name == "residue":
                param.value /= inertia


def _best_gap(fit: PlantFit, model: PlantModel, measured: list[Spectra]) -> tuple[float, PlantModel] | None:
    """Cost, and the model with the play that costs least; None when none can be simulated."""
    least, best = np.inf, None
    for gap in _largest_twist(fit, model, measured) * np.array(GAPS):
        model[f"{JOINT}.gap_deg"].value = float(gap)
        try:
            cost = sum(
                float(np.sum(np.abs((one.y - model.predict(one).Y)[record.line] * record.weight) ** 2))
                for record, one in zip(fit.records, measured, strict=True)
            )
        except GsidError:
            continue
        if cost < least:
            least, best = cost, float(gap)
    if best is None:
        return None
    model[f"{JOINT}.gap_deg"].value = best
    return least, model


def _largest_twist(fit: PlantFit, model: PlantModel, measured: list[Spectra]) -> float:
    """Of all records."""
    commands = [
        fit.model.drive_command(one, record.prediction)
        for record, one in zip(fit.records, measured, strict=True)
    ]
    return max(_twist(model, one, command) for one, command in zip(measured, commands, strict=True))


def _twist(model: PlantModel, one: Spectra, command: np.ndarray) -> float:
    """Root mean square of the twist that the motor's torque would make of the spring."""
    view = model.linear_response(one)
    torque = np.linalg.norm(view.drive * lines_of(command)) / np.sqrt(2)
    return float(torque / model[f"{JOINT}.stiffness"].value)
