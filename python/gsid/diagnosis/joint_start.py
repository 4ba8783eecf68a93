"""Starting values of a fit with backlash between motor and load.

Backlash changes the linear part too: to two masses with a spring, whose effective stiffness falls with the
share of time in the gap. The linear part is therefore fitted first, to the frequency response at the highest
level, where backlash has the least influence. The spring found is softer than the true one. Stiffer springs
with a larger gap are the starts of a fit that uses the measured motion of the load
(`gsid.diagnosis.joint_fit`), whose bias simulations then remove (`gsid.diagnosis.joint_bias`). In closed
loop, and with a sample and hold in the sensor, the gap is searched by simulation.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np

from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError
from gsid.diagnosis.joint_bias import without_bias
from gsid.diagnosis.joint_fit import fit_joint, joint_cost
from gsid.greybox.fit import PlantFit
from gsid.greybox.linear_start import LINEAR, linear_error, linear_start
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel
from gsid.spectrum.lines import lines_of
from gsid.spectrum.spectra import Spectra

DELAY = "transport_delay.delay_s"
FREQUENCIES = (0.4, 0.6, 0.9, 1.6)  # resonance of the joint, relative to the highest excited line
LOUD = 0.95  # least input of the records of the highest level, relative to the largest input
GAPS = (0.1, 0.3, 1.0, 3.0, 10.0)  # relative to the twist due to the torque of the motor
RATIOS = (0.4, 0.15)  # of the inertias, which the response does not determine
STIFFER = (1.0, 2.5, 6.0, 20.0)  # stiffness in contact, relative to that of the response
DAMPING = 0.1  # damping ratio
FALL = 0.9  # largest error of the response with backlash, relative to that without, for backlash to be fitted
BIAS_SHARE = 0.25  # of the work, for the removal of the bias
FALL_OF_COST = 0.5  # the same of the cost, given the load's motion, where the response does not improve


def joint_start(
    fit: PlantFit,
    given: PlantModel,
    deadline: Deadline | None = None,
    pruned: Callable[[PlantModel], PlantModel] = lambda model: model,
    *,
    is_clear: bool = False,
) -> PlantModel | None:
    """The model with backlash at the best of `FREQUENCIES`; None if it does not improve the response.

    Parameters
    ----------
    fit : PlantFit
        Fit of the model without backlash.
    given : PlantModel
        The model before the fit. A fit without backlash may move the frequency of a mode to imitate it, and
        a fit that starts there may end in a local minimum.
    deadline : Deadline, optional
        Checked before each step; by default there is none. A quarter of its work is for simulations.
    pruned : callable
        Removes elements of a stack that became zero: a lag of zero makes the simulation stiff.
    is_clear : bool
        Whether the misfit is clear: then the measured motion of the load decides where the response does not.
        A lag and a delay may have the response of a joint far above the band.

    Returns
    -------
    PlantModel or None

    Raises
    ------
    OutOfTime
        The deadline was reached.
    """
    deadline = deadline or Deadline()
    measured = [record.spectra for record in fit.records]
    largest = max(float(np.linalg.norm(one.u)) for one in measured)
    loud = [one for one in measured if np.linalg.norm(one.u) > LOUD * largest]
    highest = max(float(one.f_hz[one.excited].max()) for one in loud)
    before = linear_error(linear_start(fit.model, loud), loud)
    trials = []
    origins = [fit.model] if given is fit.model else [fit.model, _as_given(fit.model, given)]
    for origin in [*origins, *turned(fit.model)]:
        for share in FREQUENCIES:
            deadline.check()
            model = linear_start(_with_joint(origin, share * highest, RATIOS[0]), loud)
            trials.append((linear_error(model, loud), origin, share, model))
    least, origin, share, soft = min(trials, key=lambda one: one[0])
    improves = least < FALL * before
    if not improves and not is_clear:
        return None
    others = [linear_start(_with_joint(origin, share * highest, ratio), loud) for ratio in RATIOS[1:]]
    if not (
        fit.model.has_controller or any(effect.id == "sensor_sample_hold" for effect in fit.model.effects)
    ):
        starts = [one for model in (soft, *others) for one in _with_play(fit, model)]
        start = fit_joint(starts, fit, deadline)
        if not improves and joint_cost(start, fit) >= FALL_OF_COST * fit.cost:
            return None
        with deadline.portion(BIAS_SHARE * deadline.moves_left) as work:
            return without_bias(pruned(start), fit, work)
    if not improves:
        return None
    looked = [start for model in (soft, *others) if (start := _best_gap(fit, model)) is not None]
    return pruned(min(looked, key=lambda one: one[0])[1]) if looked else None


def turned(model: PlantModel) -> list[PlantModel]:
    """The model with the opposite modes, and with the delay that has the same response; none without both.

    Near its resonance a mode with the opposite residue has the same response behind a delay that differs by
    half its period. A fit without the joint, whose phase it takes for a delay, may end in the wrong one.

    Parameters
    ----------
    model : PlantModel
        With several modes the delay is that of the first.
    """
    names = model.free_names
    modes = [label for label, one in model.labels() if one.type.linear_part == "mode"]
    modes = [label for label in modes if f"{label}.residue" in names]
    if not modes or DELAY not in names:
        return []
    delay_s, half_s = model[DELAY].value, 0.5 / model[f"{modes[0]}.f_hz"].value
    values = {f"{label}.residue": -model[f"{label}.residue"].value for label in modes}
    values[DELAY] = delay_s - half_s if delay_s > half_s else delay_s + half_s
    changed = [values.get(name, model[name].value) for name in names]
    return [model.with_values(np.clip(changed, *model.bounds()))]


def _as_given(model: PlantModel, given: PlantModel) -> PlantModel:
    """Reset the free parameters of the linear part to the given values, where there are any."""
    known = set(given.free_names) & LINEAR
    return model.with_values([(given if name in known else model)[name].value for name in model.free_names])


def _with_play(fit: PlantFit, model: PlantModel) -> list[PlantModel]:
    """Models with stiffer springs and a gap, which may have the same response as the soft spring."""
    twist = _largest_twist(fit, model)
    starts = []
    for stiffer in STIFFER:
        for gap in GAPS:
            start = copy.deepcopy(model)
            start[f"{BACKLASH}.stiffness"].value *= stiffer
            start[f"{BACKLASH}.gap_deg"].value = float(gap * twist)
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
    larger = model.with_effect(BACKLASH, values)
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


def _best_gap(fit: PlantFit, model: PlantModel) -> tuple[float, PlantModel] | None:
    """Lowest cost over `GAPS`, and the model with that gap; None if no gap can be simulated."""
    least, best = np.inf, None
    for gap in _largest_twist(fit, model) * np.array(GAPS):
        model[f"{BACKLASH}.gap_deg"].value = float(gap)
        try:
            cost = fit.cost_of(model)
        except GsidError:
            continue
        if cost < least:
            least, best = cost, float(gap)
    if best is None:
        return None
    model[f"{BACKLASH}.gap_deg"].value = best
    return least, model


def _largest_twist(fit: PlantFit, model: PlantModel) -> float:
    """Largest twist over all records."""
    return max(
        _twist(model, record.spectra, fit.model.drive_command(record.spectra, record.prediction))
        for record in fit.records
    )


def _twist(model: PlantModel, one: Spectra, command: np.ndarray) -> float:
    """Root mean square of the twist of the spring due to the torque of the motor."""
    view = model.linear_response(one)
    torque = np.linalg.norm(view.drive * lines_of(command)) / np.sqrt(2)
    return float(torque / model[f"{BACKLASH}.stiffness"].value)
