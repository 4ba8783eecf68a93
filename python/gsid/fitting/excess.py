"""Does a fit leave more than noise? (EST-14)

With the variance of each line known, the squared errors of a right model have a known distribution (CMP-1).
A model of too low an order exceeds it, and so does one of an axis that is not linear, or that is another
minimum of the cost than the least. Errors alone do not tell which, so that the warning names them all.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from gsid.models.fit_warning import FitWarning
from gsid.models.misfit import Errors, misfit
from gsid.spectrum.pooling import for_weights

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

ALPHA = 1e-3
"""Share of right models that are reported to leave more than noise."""
NEGLIGIBLE = 1e-6
"""Of the response: an error that counts as noise, however little the periods differ."""
FREELY = 1e3
"""Standard deviations that a change of the parameters may have without a price."""
LEAST_PRINTED = 1e-12
WHAT_TO_TRY = "another order, start or delay"


def excess(model: RationalModel, frf: Frf) -> tuple[float, float]:
    """How far the errors of a fit exceed noise.  Eq: EST-14

    Parameters
    ----------
    model : RationalModel
        Of any method: what a change of its parameters takes away does not count.
    frf : Frf
        At the fitted lines.

    Returns
    -------
    ratio : float
        Squared errors over those that noise leaves of a right model.
    p_value : float
        Probability of errors this large or larger where the model is right.
    """
    errors = _errors_left(model, frf)
    n_dof = 2 * len(errors) - model.n_parameters * _taken(float(frf.n_dof))
    ratio = np.sum(errors.t / errors.t_expected) / (len(errors) - model.n_parameters / 2)
    return float(ratio), float(stats.chi2.sf(2 * np.sum(errors.q), n_dof))


def excess_cost(model: RationalModel, frf: Frf) -> FitWarning | None:
    """The warning of a fit that leaves more than noise, None where noise explains its errors.

    Parameters
    ----------
    model : RationalModel
    frf : Frf
        At the fitted lines.

    Returns
    -------
    FitWarning or None
        None, too, where the lines are no more than the parameters, or share their variances ("lpm",
        "windows").
    """
    if frf.method != "periods" or 2 * len(frf.f_hz) <= model.n_parameters:
        return None
    ratio, p_value = excess(model, frf)
    if p_value >= ALPHA:
        return None
    probability = f"p = {p_value:.1g}" if p_value > LEAST_PRINTED else f"p < {LEAST_PRINTED:g}"
    text = (
        f"this {model.method} fit leaves {ratio:.3g} times the squared errors that noise explains "
        f"({probability}), and its intervals count the noise alone: the order is too low, the axis is not "
        "linear or changed during the record, or the fit ended in another minimum than the least; try a "
        "higher order, another start (--method ga, start= in Python) or a known delay (--delay SECONDS), and "
        "gsid distortion to see how far the axis is from linear"
    )
    return FitWarning("excess_cost", None, WHAT_TO_TRY, text, ratio, p_value)


def _taken(dof: float) -> float:
    """By how much a fitted parameter lowers the mean of twice the sum of q."""
    return 1.0 if np.isinf(dof) else dof / (dof + 1)


def _errors_left(model: RationalModel, frf: Frf) -> Errors:
    """Errors of a fit beside the best change of its parameters, which is none for maximum likelihood."""
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
    # With their covariance made large no change of the parameters has a price.
    return misfit(replace(errors, by_model=FREELY * model.deviations(frf.f_hz))).left


def _variance_at(frf: Frf, g: np.ndarray) -> np.ndarray:
    """Of y - g u, over |u|^2."""
    common = 2 * np.real(frf.cov_yu * np.conj(g))
    return np.maximum(frf.var_y + frf.var_u * np.abs(g) ** 2 - common, np.finfo(float).tiny)
