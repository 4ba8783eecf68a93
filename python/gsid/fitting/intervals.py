"""Intervals of a fit whose errors exceed the noise, and parameters that the data do not determine.

The covariance of a fit (EST-5, EST-6) is that of the noise. Where the errors exceed it, the covariance of
EST-15 takes its place and that of the noise stands beside it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsid.fitting.sandwich import CORRELATION_MAX, correlation_of, sandwich

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

OF_NOISE_ONLY = ("ls", "iwls")
"""Linear methods: their errors are those of an equation, not of the response."""
UNDETERMINED = 10.0
"""Standard deviation over the size that a coefficient has by its roots, from which on the data do not
determine it: it may be anything, and the inverse of the curvature is rounding."""


def set_intervals(model: RationalModel, frf: Frf, sigma: np.ndarray, noise: np.ndarray) -> None:
    """Give a model the covariance of the errors that its fit left, beside that of the noise.  Eq: EST-15

    The sandwich form is unbiased but scatters where few lines determine a parameter. Half of it is replaced
    by what the variance of the weights predicts, times the ratio of the cost to the expected one.

    Parameters
    ----------
    model : RationalModel
        `cov` is that of the variance of the weights.
    frf : Frf
        Response at the fitted lines.
    sigma, noise : (F,) ndarray
        Standard deviation that weighted the lines, and that of the noise.
    """
    if model.method in OF_NOISE_ONLY:
        return
    weight = _weight(model, frf, sigma)
    slope = model.derivatives(frf.f_hz) * weight[:, None]
    error = (frf.g - model.response(frf.f_hz)) * weight
    correlation = min(correlation_of(error), CORRELATION_MAX)
    by_errors, predicted = sandwich(slope, error, sigma * weight, correlation)
    expected = np.sum((sigma * weight) ** 2) * (1 - model.n_parameters / (2 * len(error)))
    excess = max(1.0, float(np.sum(np.abs(error) ** 2) / max(expected, np.finfo(float).tiny)))
    if model.weights == "noise":
        model.cov_noise = model.cov
    else:
        model.cov_noise = sandwich(slope, error, noise * weight, correlation)[1]
    model.cov = (by_errors + excess * predicted) / 2


def mark_undetermined(model: RationalModel, frf: Frf, sigma: np.ndarray) -> None:
    """Note the parameters that the data do not determine.

    Parameters
    ----------
    model : RationalModel
    frf : Frf
        Response at the fitted lines.
    sigma : (F,) ndarray
        Standard deviation that weighted the lines.
    """
    weight = _weight(model, frf, sigma)
    slope = model.derivatives(frf.f_hz) * weight[:, None]
    size = np.linalg.norm(slope, axis=0)
    shown = size > 0
    slope = np.concatenate([slope.real, slope.imag]) / np.where(shown, size, 1.0)
    _, values, directions = np.linalg.svd(slope, full_matrices=False)
    values = np.maximum(values, np.finfo(float).eps * values[0])
    std = np.sqrt(np.mean((sigma * weight) ** 2) / 2 * np.sum((directions / values[:, None]) ** 2, axis=0))
    std = np.divide(std, size, out=np.full(len(std), np.inf), where=shown)
    std = np.maximum(std, np.sqrt(np.maximum(np.diag(model.cov), 0.0)))
    lost = ~(std <= UNDETERMINED * _size_by_roots(model, frf.f_hz))
    model.undetermined = tuple(int(i) for i in np.flatnonzero(lost))


def _size_by_roots(model: RationalModel, f_hz: np.ndarray) -> np.ndarray:
    """Size of (den[1:], num, delay if free) if no two roots cancel in a coefficient; at least that of a root
    at the lowest line, since the data do not show how far below it a root is."""
    least = 2 * np.pi * f_hz[f_hz > 0].min() if model.domain == "s" else 1.0
    den, num = (
        np.atleast_1d(np.poly(-np.maximum(np.abs(roots), least))) for roots in (model.poles, model.zeros)
    )
    first = np.zeros(len(model.num) - len(num))  # leading coefficients of 0 have no root
    num = np.concatenate([first, num * np.abs(model.num[len(first)])])
    return np.concatenate([den[1:], num, [1 / f_hz[f_hz > 0].min()] if model.free_delay else []])


def _weight(model: RationalModel, frf: Frf, sigma: np.ndarray) -> np.ndarray:
    """Equivalent weight of the error of the response, EST-6."""
    if model.method in ("ml", "ml-io"):
        return 1 / sigma
    if model.method == "nls-output":
        return np.abs(frf.u)
    if model.method == "log":
        return 1 / np.maximum(np.abs(frf.g), np.finfo(float).tiny)
    return np.ones(len(frf.g))
