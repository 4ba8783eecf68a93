"""Covariance of a weighted least squares estimate from the errors that it left (STR-5).

Where the errors exceed the noise, the inverse curvature is not the covariance. The sandwich form uses the
errors that the fit left (White 1982), with their correlation over neighbouring lines (Newey and West 1987).
"""

from __future__ import annotations

import numpy as np

LAGS_OF_CORRELATION = 20
"""Lines over which the residual's correlation is summed."""
RANK = 1e-14
"""Singular value over the largest below which a direction of the parameters is rounding."""
CORRELATION_MAX = 10.0
"""Largest number of lines that count as one where residuals are smooth over frequency."""


def correlation_of(error: np.ndarray) -> float:
    """L = 1 + 2 sum |rho_k|^2 of a residual over lines, less what white noise has.  Eq: STR-4

    Parameters
    ----------
    error : (F,) complex
    """
    n, power = len(error), float(np.sum(np.abs(error) ** 2))
    if power == 0 or n < 3:
        return 1.0
    lags = range(1, min(LAGS_OF_CORRELATION, n - 1))
    rho2 = [abs(np.vdot(error[:-k], error[k:]) / power) ** 2 - 1 / n for k in lags]
    return max(1.0, 1 + 2 * float(np.sum(np.maximum(rho2, 0.0))))


def sandwich(
    slope: np.ndarray, error: np.ndarray, noise: np.ndarray, correlation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance from the errors left, and from the noise alone.  Eq: STR-5

    Parameters
    ----------
    slope : (F, p) complex
        Derivatives of the response by the parameters, times the weight of each line.
    error : (F,) complex
        Errors left, times the weight.
    noise : (F,) ndarray
        Standard deviation of the response by noise, times the weight.
    correlation : float
        Lines over which the errors are correlated.

    Returns
    -------
    sandwich, noise_only : (p, p) ndarray
    """
    n, p = slope.shape
    size = np.linalg.norm(slope, axis=0)
    size[size == 0] = 1.0
    inverse = np.linalg.pinv(np.concatenate([slope.real, slope.imag]) / size, rcond=RANK) / size[:, None]
    of_real, of_imag = inverse[:, :n], inverse[:, n:]
    moved = (of_real * error.real + of_imag * error.imag).T  # change of the parameters by each line
    covariance = moved.T @ moved
    reach = int(np.ceil(2 * (correlation - 1)))
    for lag in range(1, min(reach, n - 1) + 1):
        share = 1 - lag / (reach + 1)
        product = moved[lag:].T @ moved[:-lag]
        covariance += share * (product + product.T)
    noise_only = (of_real * noise**2) @ of_real.T + (of_imag * noise**2) @ of_imag.T
    return covariance * n / max(n - p / 2, 1), noise_only / 2
