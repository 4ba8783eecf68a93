"""Warnings about fits that noise biases, and the method to use instead.

If the bias of an estimate is not small against its standard deviation, its confidence intervals are centred
at a wrong value. The biases below follow from the measured variances, to first order:

    ls, iwls            noise of the response appears in the regressors of the equation error (EST-11)
    ml, nls-output      noise of the input appears in the response and in its weight (EST-12)
    every method        lines whose measured input was small by chance were omitted (EST-13)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsid.base.zero_order_hold import hold_factor
from gsid.models.fit_warning import FitWarning
from gsid.spectrum.excited import ABOVE_NOISE

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

NEAR_NOISE = 4 * ABOVE_NOISE
"""Largest |U|^2, over the variance of its mean, of lines that may be omitted by chance."""
BIAS_MOST = 0.5
"""Bias over standard deviation that reduces the coverage of 95 % intervals to 92 %."""


def largest_shift(model: RationalModel, bias: np.ndarray, f_hz: np.ndarray) -> float:
    """Largest ratio of bias to standard deviation.

    Parameters
    ----------
    model : RationalModel
        Model with covariance.
    bias : (p,) ndarray
        Bias of the parameters, in the order of `model.cov`.
    f_hz : (F,) ndarray
        Lines at which the response is also checked [Hz].

    Returns
    -------
    float
    """
    std = np.sqrt(np.maximum(np.diag(model.cov), 0))
    by_parameter = model.gradient(f_hz)
    shift = np.abs(by_parameter @ bias)
    spread = np.sqrt(np.maximum(_variance(by_parameter, model.cov), 0))
    shifts, spreads = np.concatenate([np.abs(bias), shift]), np.concatenate([std, spread])
    known = spreads > 0
    return float(np.max(shifts[known] / spreads[known], initial=0.0))


def _variance(slope: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Variance of the response at each line. Columns are scaled, because powers of s differ in magnitude."""
    scale = np.sqrt(np.maximum(np.diag(cov), np.finfo(float).tiny))
    slope = slope * scale
    return np.einsum("ki,ij,kj->k", slope, cov / np.outer(scale, scale), slope.conj()).real


def equation_error(model: RationalModel, bias: np.ndarray, f_hz: np.ndarray) -> FitWarning | None:
    """Return a warning if noise biases a linear fit (EST-11), None if the bias is small.

    Parameters
    ----------
    model : RationalModel
        Model fitted by "ls" or "iwls".
    bias : (p,) ndarray
        Expected bias of its parameters, in the order of `model.cov`.
    f_hz : (F,) ndarray
        Fitted lines [Hz].

    Returns
    -------
    FitWarning or None
    """
    size = largest_shift(model, bias, f_hz)
    if size <= BIAS_MOST:
        return None
    text = (
        f"noise in the regressors of the equation error biases this {model.method} fit by up to {size:.2g} "
        "standard deviations: its confidence intervals are not valid; method ml does not have this bias"
    )
    return FitWarning("equation_error_bias", size, "ml", text)


def noisy_input(
    model: RationalModel, f_hz: np.ndarray, bias_g: np.ndarray, weight: np.ndarray
) -> FitWarning | None:
    """Return a warning if noise in the measured input biases a fit (EST-12), None if the bias is small.

    Parameters
    ----------
    model : RationalModel
        Model fitted by "ml" or "nls-output".
    f_hz : (F,) ndarray
        Fitted lines [Hz].
    bias_g : (F,) complex ndarray
        Bias of the response that the correlation of error and weight causes in the estimator.
    weight : (F,) ndarray
        Weight of the error of the response.

    Returns
    -------
    FitWarning or None
    """
    size = _shift_by(model, f_hz, bias_g, weight)
    if size <= BIAS_MOST:
        return None
    text = (
        f"noise in the measured input biases this {model.method} fit by up to {size:.2g} standard "
        "deviations: its confidence intervals are not valid; use method ml-io, which models this noise, or a "
        "recorded reference (--r), which has none"
    )
    return FitWarning("noisy_input_bias", size, "ml-io", text)


def _shift_by(model: RationalModel, f_hz: np.ndarray, bias_g: np.ndarray, weight: np.ndarray) -> float:
    """`largest_shift` of a weighted least-squares fit for a bias `bias_g` of the response."""
    if not np.any(bias_g):
        return 0.0
    hold = hold_factor(f_hz, model.fs_hz) if model.hold == "zoh" else np.ones(len(f_hz))
    slope = model.gradient(f_hz) * (weight * np.abs(hold))[:, None]
    right = weight * bias_g
    rows, right = np.concatenate([slope.real, slope.imag]), np.concatenate([right.real, right.imag])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    return largest_shift(model, np.linalg.lstsq(rows / scale, right, rcond=None)[0] / scale, f_hz)


def chosen_lines(model: RationalModel, frf: Frf, sigma: np.ndarray) -> FitWarning | None:
    """Return a warning if the selection of lines biases a fit (EST-13), None if the bias is small.

    A line is used if the mean of its input exceeds the noise by a factor. Near this threshold, noise has
    increased the input of the selected lines, and therefore reduced their response.

    Parameters
    ----------
    model : RationalModel
    frf : Frf
        Response at the fitted lines.
    sigma : (F,) ndarray
        Standard deviation of the response.

    Returns
    -------
    FitWarning or None
    """
    f_hz, n_periods = frf.f_hz, frf.n_periods / frf.n_realisations
    n_left_out = np.count_nonzero((frf.rejected_hz >= f_hz[0]) & (frf.rejected_hz <= f_hz[-1]))
    n_near = np.count_nonzero(np.abs(frf.u) ** 2 * n_periods < NEAR_NOISE * frf.var_u)
    if n_left_out == 0 or n_periods < 2 or n_near < min(n_left_out, len(f_hz) / 2):
        return None  # no lines were omitted, or for another reason
    relative = _relative_shift(len(f_hz) / (len(f_hz) + n_left_out), n_periods)
    size = _shift_by(model, f_hz, -relative * frf.g, 1 / sigma)
    if size <= BIAS_MOST:
        return None
    text = (
        f"{n_left_out} lines were omitted because of their noisy input. The selection of the other lines "
        f"biases this {model.method} fit by about {size:.2g} standard deviations, because their response is "
        f"about {100 * relative:.2g} % too small; measure more periods, or use a recorded reference (--r)"
    )
    return FitWarning("chosen_lines_bias", size, "reference", text)


def _relative_shift(share: float, n_periods: float) -> float:
    """Relative bias of the input of the selected lines if this share of the lines is selected.

    All values are in units of the standard deviation of the mean. The real part of the mean scatters by
    1/sqrt(2). The threshold is a multiple of the sample standard deviation; it scatters by half of its value
    over sqrt(n_periods - 1).
    """
    from scipy.special import ndtri

    limit = np.sqrt(ABOVE_NOISE)
    spread = np.sqrt(0.5 + ABOVE_NOISE / (4 * (n_periods - 1)))
    below = ndtri(1 - share)
    density = np.exp(-(below**2) / 2) / np.sqrt(2 * np.pi)
    return float(0.5 / spread * density / share / (limit - below * spread))
