"""Kept-out cost: one realisation after the other is left out of a fit, linearised, and predicted."""

from __future__ import annotations

import numpy as np

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
    total = sum(gram for gram, _, _, _ in parts)
    right = sum(slope for _, slope, _, _ in parts)
    squares, alone, errors = 0.0, [], []
    for gram, slope, rows, error in parts:
        moved = -_solve(total - gram, right - slope)
        squares += float(np.sum((error + rows @ moved) ** 2))
        alone.append(values - _solve(gram, slope)[chosen] / size[chosen])
        variances = np.maximum(np.diag(np.linalg.pinv(gram)), 0.0)  # rounding may leave them below 0
        errors.append(np.sqrt(variances)[chosen] / size[chosen])
    n_rows = sum(len(error) for *_, error in parts)
    if undetermined:
        return squares / n_rows, np.inf, 0.0
    norm = float(np.linalg.norm(values)) or np.inf
    spread = np.linalg.norm(np.std(alone, axis=0)) / norm
    noise = np.linalg.norm(np.sqrt(np.mean(np.square(errors), axis=0))) / norm
    return squares / n_rows, float(spread), float(noise)


def _parts(
    problem: Problem, error: np.ndarray, jacobian: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Normal equations, rows and error of each realisation; of a single record those of thirds.

    The thirds are those of its periods, or those of its lines where a model error is left.
    """
    if len(problem.records) > 1:
        found = []
        for i in range(len(problem.records)):
            rows = problem.rows_of(i)
            found.append(_normal(jacobian[rows], error[rows]))
        return found
    (record,) = problem.records
    if problem.has_model_error:
        # It is the same in all periods: the lines are what is independent.
        of = np.tile(np.arange(len(record.line)) % 3, 2)
        return [_normal(jacobian[of == i], error[of == i]) for i in range(3)]
    thirds = np.array_split(record.spectra.Y[:, record.line], min(3, record.spectra.n_periods))
    found = []
    for third in thirds:
        weight = np.sqrt(len(third) / record.spectra.n_periods)  # of noise that is larger
        change = problem.whiten([third.mean(axis=0) - record.Y])
        found.append(_normal(weight * jacobian, weight * (error + change)))
    return found


def _normal(rows: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return rows.T @ rows, rows.T @ error, rows, error


def _solve(gram: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(gram, right, rcond=1e-12)[0]
