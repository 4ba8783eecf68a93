"""Values at the minimum with the exact hold, and their covariance (STR-5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid.fitting.sandwich import sandwich
from gsid.structure.elements import Values, columns
from gsid.structure.projection import Data, Fitted

POLISHED = 3
"""Gauss-Newton steps with exact slopes: the refinement takes the images of the hold as constant."""
STEP_MAX = 0.7
"""Largest change of a logarithm in one of them: a factor of 2."""
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
        if not better.cost < fitted.cost:  # also where it is not a number
            break
        fitted = better
    slope = exact_slopes(fitted, data) * data.weight[:, None]
    noise = data.weight * np.sqrt(var_noise)
    return Estimate(fitted, *sandwich(slope, fitted.error(data), noise, correlation))


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
    size = np.where(size > 0, size, 1.0)
    stacked = np.concatenate([slope.real, slope.imag]) / size
    move = np.linalg.lstsq(stacked, np.concatenate([error.real, error.imag]), rcond=1e-10)[0] / size
    n = len(fitted.values.theta)
    move[: n - 1] = np.clip(move[: n - 1], -STEP_MAX, STEP_MAX)  # logarithms
    values = Values(fitted.structure, fitted.values.theta + move[:n])
    better = Fitted(values, fitted.gains + move[n:], 0.0)
    return Fitted(values, better.gains, float(np.sum(np.abs(better.error(data)) ** 2)))
