"""Fits whose intervals do not hold the truth because noise biases the method, and the method that is right.

An estimate that noise shifts by more than a part of its standard deviation has intervals around the wrong
place. Both biases below follow from the measured variances alone, to first order in them:

    ls, iwls            noise of the response stands in the regressors of the equation error (EST-11)
    ml, nls-output      noise of the input stands in the response and in its weight alike (EST-12)
    every method        lines whose input came out small by chance were left out (EST-13)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsid.models.fit_warning import FitWarning
from gsid.spectrum.excited import ABOVE_NOISE

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

NEAR_NOISE = 4 * ABOVE_NOISE
"""|U|^2 over the variance of its mean, of lines that chance might have left out."""
BIAS_MOST = 0.5
"""Standard deviations: shifted by so much, an interval of 95 % holds the truth in 92 %."""


def largest_shift(model: RationalModel, bias: np.ndarray, f_hz: np.ndarray) -> float:
    """Largest of a bias over its standard deviation.

    Parameters
    ----------
    model : RationalModel
        With covariance.
    bias : (p,) ndarray
        Of the parameters, in the order of `model.cov`.
    f_hz : (F,) ndarray
        Lines at which the response counts, too [Hz].

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
    """Variance of each response, columns scaled so that the powers of s do not swamp one another."""
    scale = np.sqrt(np.maximum(np.diag(cov), np.finfo(float).tiny))
    slope = slope * scale
    return np.einsum("ki,ij,kj->k", slope, cov / np.outer(scale, scale), slope.conj()).real


def equation_error(model: RationalModel, bias: np.ndarray, f_hz: np.ndarray) -> FitWarning | None:
    """The warning of a linear fit that noise biases (EST-11), None where it does not matter.

    Parameters
    ----------
    model : RationalModel
        By "ls" or "iwls".
    bias : (p,) ndarray
        Expected shift of its parameters, in the order of `model.cov`.
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
        f"noise shifts this {model.method} fit by up to {size:.2g} standard deviations, since it is in the "
        "regressors of the equation error: its intervals do not hold the truth; method ml has no such bias"
    )
    return FitWarning("equation_error_bias", size, "ml", text)


def noisy_input(
    model: RationalModel, f_hz: np.ndarray, pull: np.ndarray, weight: np.ndarray
) -> FitWarning | None:
    """The warning of a fit that noise in the measured input biases (EST-12), None where it does not matter.

    Parameters
    ----------
    model : RationalModel
        By "ml" or "nls-output".
    f_hz : (F,) ndarray
        Fitted lines [Hz].
    pull : (F,) complex ndarray
        What correlation of error and weight adds to the response on average, as the estimator sees it.
    weight : (F,) ndarray
        Of the error of the response.

    Returns
    -------
    FitWarning or None
    """
    size = _shift_by(model, f_hz, pull, weight)
    if size <= BIAS_MOST:
        return None
    text = (
        f"noise in the measured input shifts this {model.method} fit by up to {size:.2g} standard "
        "deviations: its intervals do not hold the truth; method ml-io counts that noise, and a recorded "
        "reference (--r) has none"
    )
    return FitWarning("noisy_input_bias", size, "ml-io", text)


def _shift_by(model: RationalModel, f_hz: np.ndarray, pull: np.ndarray, weight: np.ndarray) -> float:
    """`largest_shift` of a weighted least squares fit when the response at each line moves by `pull`."""
    if not np.any(pull):
        return 0.0
    hold = np.sinc(f_hz / model.fs_hz) if model.hold == "zoh" else np.ones(len(f_hz))
    slope = model.gradient(f_hz) * (weight * np.abs(hold))[:, None]
    right = weight * pull
    rows, right = np.concatenate([slope.real, slope.imag]), np.concatenate([right.real, right.imag])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    return largest_shift(model, np.linalg.lstsq(rows / scale, right, rcond=None)[0] / scale, f_hz)


def chosen_lines(model: RationalModel, frf: Frf, sigma: np.ndarray) -> FitWarning | None:
    """The warning of a fit to lines that chance chose (EST-13), None where it does not matter.

    A line is used where the mean of its input stands out of its noise. Near that limit the lines that do
    have an input that noise made larger, and a response that it made smaller.

    Parameters
    ----------
    model : RationalModel
    frf : Frf
        At the fitted lines.
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
        return None  # none, or left out for another reason
    relative = _relative_shift(len(f_hz) / (len(f_hz) + n_left_out), n_periods)
    size = _shift_by(model, f_hz, -relative * frf.g, 1 / sigma)
    if size <= BIAS_MOST:
        return None
    text = (
        f"{n_left_out} lines were left out for their noisy input, and chance made that of the others larger: "
        f"it shifts this {model.method} fit by about {size:.2g} standard deviations, since the response is "
        f"about {100 * relative:.2g} % too small; measure more periods, or use a recorded reference (--r)"
    )
    return FitWarning("chosen_lines_bias", size, "reference", text)


def _relative_shift(share: float, n_periods: float) -> float:
    """By how much the input of the lines used is too large, of itself, when this share of lines is used.

    All in units of the standard deviation of the mean: its real part scatters by 1/sqrt(2), the limit, which
    is a multiple of a sample's standard deviation, by half of the limit over sqrt(n_periods - 1).
    """
    from scipy.stats import norm

    limit = np.sqrt(ABOVE_NOISE)
    spread = np.sqrt(0.5 + ABOVE_NOISE / (4 * (n_periods - 1)))
    below = norm.ppf(1 - share)
    return float(0.5 / spread * norm.pdf(below) / share / (limit - below * spread))
