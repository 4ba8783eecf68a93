"""Test whether the errors of a fit exceed the noise (EST-14).

If the variance of each line is known, the squared errors of a correct model have a known distribution
(CMP-1). They exceed it if the order is too low, if the axis is not linear, or if the fit ended in a local
minimum. The errors do not show which of these is the cause, so that the warning lists all of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gsid.fitting.intervals import OF_NOISE_ONLY
from gsid.models.fit_warning import FitWarning
from gsid.models.misfit import Errors, misfit
from gsid.response.frf import error_variance
from gsid.spectrum.pooling import for_weights

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

ALPHA = 1e-3
"""Share of correct models that are reported to exceed the noise (false-alarm rate)."""
NEGLIGIBLE = 1e-6
"""Errors below this share of the response count as noise, however small the scatter."""
LINES_OF_HANN = 3
"""Lines apart whose errors are independent under a Hann window, which spreads a line over two neighbours."""
FREELY = 1e3
"""Factor on the covariance's square root that makes a change of the parameters free of cost."""
LEAST_PRINTED = 1e-12
WHAT_TO_TRY = "another order, start or delay"
WITH_DISTORTION = "gsid distortion"


def excess(model: RationalModel, frf: Frf) -> tuple[float, float]:
    """Ratio of the errors of a fit to those of noise.  Eq: EST-14

    Parameters
    ----------
    model : RationalModel
        Model fitted by any method. Errors that a change of its parameters would remove do not count.
    frf : Frf
        Response at the fitted lines.

    Returns
    -------
    ratio : float
        Squared errors over those expected from noise for a correct model.
    p_value : float
        Probability of errors this large or larger if the model is correct.
    """
    apart = LINES_OF_HANN if frf.method == "windows" else 1
    errors = _errors_left(model, frf.at(np.arange(len(frf.f_hz)) % apart == 0))
    n_parameters = model.n_parameters / apart
    found = misfit(errors)
    ratio = np.sum(errors.t / errors.t_expected) / (len(errors) - n_parameters / 2)
    return float(ratio), found.p_value_of_fit(n_parameters)


def excess_cost(model: RationalModel, frf: Frf, *, beside: FitWarning | None = None) -> FitWarning | None:
    """Return a warning if the errors of a fit exceed the noise, None if noise explains them.

    Parameters
    ----------
    model : RationalModel
    frf : Frf
        Response at the fitted lines.
    beside : FitWarning, optional
        The same warning for noise and distortion together.

    Returns
    -------
    FitWarning or None
        Also None if there are too few lines for the parameters, or if neighbouring lines share their variance
        ("lpm").
    """
    if frf.method == "lpm" or 2 * len(frf.f_hz) <= model.n_parameters:
        return None
    ratio, p_value = excess(model, frf)
    if p_value >= ALPHA:
        return None
    probability = f"p = {p_value:.1g}" if p_value > LEAST_PRINTED else f"p < {LEAST_PRINTED:g}"
    left = f"this {model.method} fit leaves {ratio:.3g} times the squared errors that noise explains"
    if model.weights == "total" and beside is None:
        text = (
            f"{left} ({probability}); distortion explains the rest: the axis is not linear, and the model is "
            "its best linear approximation at this excitation; gsid distortion measures the nonlinearity and "
            "gsid diagnose finds its cause"
        )
        return FitWarning("excess_cost", None, WITH_DISTORTION, text, ratio, p_value)
    intervals = "its intervals include " + (
        "the noise only" if model.method in OF_NOISE_ONLY else "these errors as if they were random"
    )
    also = "" if beside is None else f" and {beside.cost_per_dof:.3g} times those of noise and distortion"
    leaks = "leakage of the windows biases the response, " if frf.method == "windows" else ""
    text = (
        f"{left}{also} ({probability}), and {intervals}: {leaks}the order is too low, the axis is not "
        "linear or changed during the record, or the fit ended in a local minimum; try a higher order, other "
        "starting values (--method ga, start= in Python) or a known delay (--delay SECONDS), and use "
        "gsid distortion to measure the nonlinearity of the axis"
    )
    return FitWarning("excess_cost", None, WHAT_TO_TRY, text, ratio, p_value)


def _errors_left(model: RationalModel, frf: Frf) -> Errors:
    """Errors of a fit after the best change of its parameters, which is zero for maximum likelihood."""
    dof, response = float(frf.n_dof), model.response(frf.f_hz)
    variance = np.array(frf.var_g, float)
    if model.method == "ml-io":
        variance *= _variance_at(frf, response) / _variance_at(frf, frf.g)
    variance += (NEGLIGIBLE * np.abs(frf.g)) ** 2
    n = len(variance)
    errors = Errors(
        error=frf.g - response,
        var_mean=variance,
        dof=np.full(n, dof),
        var_weight=for_weights(variance, dof),
        real=frf.f_hz == 0,
        by_model=np.zeros((n, 0), complex),
    )
    if model.method in ("ml", "ml-io"):
        return errors
    # With a large covariance, a change of the parameters adds no cost.
    left = misfit(replace(errors, by_model=FREELY * model.deviations(frf.f_hz))).left
    return replace(errors, error=left.error)


def _variance_at(frf: Frf, g: np.ndarray) -> np.ndarray:
    """Variance of y - g u, over |u|^2."""
    return np.maximum(error_variance(frf.var_u, frf.var_y, frf.cov_yu, g), np.finfo(float).tiny)
