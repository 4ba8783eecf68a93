"""Values at the minimum with the exact hold, and their covariance (STR-5).

Where the errors exceed the noise, the inverse curvature is not the covariance. The sandwich form uses the
errors that the fit left (White 1982), with their correlation over neighbouring lines (Newey and West 1987);
the covariance from the noise alone stands beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid.structure.elements import Values, columns
from gsid.structure.projection import Data, Fitted

POLISHED = 3
"""Gauss-Newton steps with exact slopes: the refinement takes the images of the hold as constant."""
STEP_LOG, STEP_DELAY = 1e-4, 1e-3
"""Steps of the central differences: of logarithms, and of the delay over 1/w_hi."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """A structure's values with two covariances.

    Attributes
    ----------
    fitted : Fitted
    covariance : (p, p) ndarray
        Of (theta, gains), sandwich form.
    noise_only : (p, p) ndarray
        The same from the noise of the response alone.
    """

    fitted: Fitted
    covariance: np.ndarray
    noise_only: np.ndarray


def estimate(fitted: Fitted, data: Data, var_noise: np.ndarray, correlation: float) -> Estimate:
    """Move to the exact minimum and estimate the covariance there.

    Parameters
    ----------
    fitted : Fitted
    data : Data
    var_noise : (F,) ndarray
        Variance of the response by noise.
    correlation : float
        Lines over which the errors are correlated.

    Returns
    -------
    Estimate
    """
    for _ in range(POLISHED):
        better = _step(fitted, data)
        if better.cost >= fitted.cost:
            break
        fitted = better
    slope = exact_slopes(fitted, data) * data.weight[:, None]
    size = np.linalg.norm(slope, axis=0)
    slope = slope / size
    bread = np.linalg.pinv((slope.conj().T @ slope).real, rcond=1e-12)
    score = (slope.conj() * fitted.error(data)[:, None]).real
    n, p = slope.shape
    meat = score.T @ score
    for lag in range(1, min(int(np.ceil(2 * (correlation - 1))), n - 1) + 1):
        share = 1 - lag / (np.ceil(2 * (correlation - 1)) + 1)
        product = score[lag:].T @ score[:-lag]
        meat += share * (product + product.T)
    meat *= n / max(n - p / 2, 1)
    weighted = slope * (data.weight * np.sqrt(var_noise / 2))[:, None]
    noise = (weighted.conj().T @ weighted).real
    scale = np.outer(size, size)
    return Estimate(fitted, bread @ meat @ bread / scale, bread @ noise @ bread / scale)


def exact_slopes(fitted: Fitted, data: Data) -> np.ndarray:
    """Derivatives of the response by (theta, gains), images of the hold included, (F, p) complex."""
    theta, structure = fitted.values.theta, fitted.structure
    step = np.full(len(theta), STEP_LOG)
    step[-1] = STEP_DELAY / data.lines.w[-1]
    by_theta = []
    for i, h in enumerate(step):
        moved = [theta.copy(), theta.copy()]
        moved[0][i] += h
        moved[1][i] -= h
        up, down = (columns(Values(structure, t), data.lines) @ fitted.gains for t in moved)
        by_theta.append((up - down) / (2 * h))
    return np.column_stack([*by_theta, columns(fitted.values, data.lines)])


def _step(fitted: Fitted, data: Data) -> Fitted:
    slope = exact_slopes(fitted, data) * data.weight[:, None]
    error = fitted.error(data)
    size = np.linalg.norm(slope, axis=0)
    stacked = np.concatenate([slope.real, slope.imag]) / size
    move = np.linalg.lstsq(stacked, np.concatenate([error.real, error.imag]), rcond=1e-10)[0] / size
    n = len(fitted.values.theta)
    values = Values(fitted.structure, fitted.values.theta + move[:n])
    better = Fitted(values, fitted.gains + move[n:], 0.0)
    return Fitted(values, better.gains, float(np.sum(np.abs(better.error(data)) ** 2)))
