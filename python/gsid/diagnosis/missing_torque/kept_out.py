"""Kept-out cost: one realisation after the other is left out of a fit, linearised, and predicted."""

from __future__ import annotations

import numpy as np

from gsid.diagnosis.leave_out import leave_out
from gsid.diagnosis.missing_torque.linear_fit import LinearFit
from gsid.diagnosis.missing_torque.problem import Problem


def keep_out(
    problem: Problem,
    fit: LinearFit,
    jacobian: np.ndarray,
    n_coefficients: int,
    coefficients: np.ndarray | None = None,
    first: int | None = None,
) -> tuple[float, float, float]:
    """Kept-out cost, scatter of the coefficient over realisations, and its standard error.

    The scatter is infinite where a coefficient has no effect.
    One realisation after the other is left out of the fit, linearised at the fit to all. Of a single record
    thirds of its periods are left out.

    Parameters
    ----------
    problem : Problem
    fit : LinearFit
    jacobian : (n_rows, m) ndarray
        With the derivative by the shape.
    n_coefficients : int
    coefficients : (n_coefficients,) ndarray, optional
        Their values; default the last of the linear part.
    first : int, optional
        Their first column; default the last ones.
    """
    n = jacobian.shape[1]
    first = n - n_coefficients if first is None else first
    chosen = np.arange(first, first + n_coefficients)
    values = fit.part.values[-n_coefficients:] if coefficients is None else coefficients
    size = np.linalg.norm(jacobian, axis=0)
    undetermined = bool(np.any(size[chosen] == 0))
    size = np.where(size > 0, size, 1.0)
    scaled = jacobian / size
    parts = _parts(problem, fit.error, scaled)
    left = leave_out(parts, rcond=1e-15)
    alone = [values + moved[chosen] / size[chosen] for moved in left.moves]
    # Rounding may leave variances below 0.
    errors = [np.sqrt(np.maximum(one, 0.0))[chosen] / size[chosen] for one in left.variances]
    if undetermined:
        return left.kept, np.inf, 0.0
    norm = float(np.linalg.norm(values)) or np.inf
    spread = np.linalg.norm(np.std(alone, axis=0)) / norm
    noise = np.linalg.norm(np.sqrt(np.mean(np.square(errors), axis=0))) / norm
    return left.kept, float(spread), float(noise)


def _parts(problem: Problem, error: np.ndarray, jacobian: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows and error of each realisation; of a single record those of thirds.

    The thirds are those of its periods, or those of its lines where a model error is left.
    """
    if len(problem.records) > 1:
        found = []
        for i in range(len(problem.records)):
            rows = problem.rows_of(i)
            found.append((jacobian[rows], error[rows]))
        return found
    (record,) = problem.records
    if problem.has_model_error:
        # It is the same in all periods: the lines are what is independent.
        of = np.tile(np.arange(len(record.line)) % 3, 2)
        return [(jacobian[of == i], error[of == i]) for i in range(3)]
    thirds = np.array_split(record.spectra.Y[:, record.line], min(3, record.spectra.n_periods))
    found = []
    for third in thirds:
        weight = np.sqrt(len(third) / record.spectra.n_periods)  # of noise that is larger
        change = problem.whiten([third.mean(axis=0) - record.Y])
        found.append((weight * jacobian, weight * (error + change)))
    return found
