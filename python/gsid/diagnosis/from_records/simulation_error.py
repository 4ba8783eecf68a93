"""What the simulation of inputs that are not held adds to the misfit of a fit (PLT-3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsid.diagnosis.missing_torque.linear_fit import basis
from gsid.greybox.fit import PlantFit
from gsid.models.misfit import Errors, misfit
from gsid.plant.unheld_input import unheld_error


def simulation_error(fit: PlantFit) -> float:
    """Cost of the error of simulating inputs that are not held, beside what the parameters follow.

    Parameters
    ----------
    fit : PlantFit
    """
    return float(np.sum(_whitened(fit) ** 2))


def noise_p_value(fit: PlantFit) -> float:
    """p-value of what a fit leaves, without the error of its simulation.

    Parameters
    ----------
    fit : PlantFit
    """
    real, imaginary = np.split(_whitened(fit), 2)
    ends = np.cumsum([len(one.line) for one in fit.records])[:-1]
    if not np.any(real) and not np.any(imaginary):
        return fit.noise_p_value
    errors = []
    for one, added in zip(fit.records, np.split(real + 1j * imaginary, ends), strict=True):
        error = one.errors.error + (added / one.weight)[one.line > 0]
        errors.append(replace(one.errors, error=error))
    return misfit(Errors.joined(errors)).p_value_of_fit(len(fit.model.free_names))


def _whitened(fit: PlantFit) -> np.ndarray:
    """By how much the simulated lines are too large, weighted like the residual, beside its tangent."""
    lines = [unheld_error(one.spectra, fit.model)[None, :] for one in fit.records]
    if not any(np.any(one) for one in lines):
        return np.zeros(len(fit.residual))
    column, known = np.ravel(fit.whitened(lines)), basis(fit.jacobian)
    return column - known @ (known.T @ column)
