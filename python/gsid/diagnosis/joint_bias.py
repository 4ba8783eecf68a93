"""Bias of the fit of backlash from the measured motion of the load, removed by simulation.

The noise of the load's motion acts as a torque on the joint: errors in the variables, which shrink the gap
and raise the damping. A record that is simulated with the fitted model, with the same noise, gives a fit with
nearly the same bias (indirect inference). The values are changed until such records give the fit of the
measured ones.
"""

from __future__ import annotations

import copy
from contextlib import suppress
from dataclasses import replace

import numpy as np

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import GsidError
from gsid.diagnosis.joint_fit import fit_joint, fitted_names, values_of
from gsid.greybox.fit import PlantFit
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant

ROUNDS = 4  # two reach the noise of the fit; beyond, other collisions change the cost, and the least is taken
SEED = 16  # of the noise, the same in all rounds: a new draw would move the values by its own error
NOISE_LEFT = 1.15  # cost per degree of freedom at which only noise is left
LARGEST_RATIO = 2.0  # of a value in one round: the bias is smaller, and a fit may send a lag to zero


def without_bias(start: PlantModel, fit: PlantFit, deadline: Deadline) -> PlantModel:
    """Remove the bias of a model that `fit_joint` has fitted (DIA-16).

    Parameters
    ----------
    start : PlantModel
        Of `fit_joint`.
    fit : PlantFit
        Its records, lines and weights.
    deadline : Deadline
        The work of the simulations is taken from it.

    Returns
    -------
    PlantModel
        That of the round with the least cost by simulation; `start` where no round has less.
    """
    names = fitted_names(start)
    biased = values_of(start, names)
    best = model = start
    least = np.inf
    with suppress(GsidError, OutOfTime, np.linalg.LinAlgError):
        for n_left in reversed(range(ROUNDS + 1)):
            plants = [PeriodicPlant.of(model, record.spectra, deadline) for record in fit.records]
            outputs = [plant.run_within(deadline).Y for plant in plants]
            cost = sum(record.cost_of_output(y) for record, y in zip(fit.records, outputs, strict=True))
            if cost < least:
                least, best = cost, model
            if least < NOISE_LEFT * fit.n_dof or n_left == 0:
                break
            again = fit_joint([model, start], _with_output(fit, outputs), deadline)
            ratio = _ratio(biased, values_of(again, names))
            changed = dict(zip(names, values_of(model, names) * ratio, strict=True))
            values = [changed.get(name, model[name].value) for name in model.free_names]
            model = model.with_values(np.clip(values, *model.bounds()))
    return best


def _ratio(wanted: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Ratio of two sets of values, within limits; 1 where they differ in sign."""
    same = wanted * found > 0
    ratio = np.where(same, wanted / np.where(same, found, 1.0), 1.0)
    return np.clip(ratio, 1 / LARGEST_RATIO, LARGEST_RATIO)


def _with_output(fit: PlantFit, outputs: list[np.ndarray]) -> PlantFit:
    """The fit with records of other outputs, and with the noise that the mean of the periods has."""
    rng = np.random.default_rng(SEED)
    records = []
    for record, output in zip(fit.records, outputs, strict=True):
        one = copy.copy(record.spectra)
        parts = rng.standard_normal((2, len(output)))
        noise = np.sqrt(one.noise_y / (2 * one.n_periods)) * (parts[0] + 1j * parts[1])
        one.Y = one.Y - one.y + output + noise
        records.append(replace(record, spectra=one))
    return replace(fit, records=records)
