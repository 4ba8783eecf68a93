"""Validation of a fitted model on held-out realisations (thesis, section 7.11).

On new data of the same kind, the cost of eq. 7.28 contains the new noise and the model error by the old one,

    V = sum of |g - G|^2 / s^2,   E V = (F + tr(A C)) nu / (nu - 1),   A = sum of Re(x^H x) / s^2  (VAL-1)

where x contains the derivatives of G with respect to the parameters, and C is their covariance. The cost on
held-out data exposes a model of too high an order, whose own cost is too low. The test of adequacy is
that of `gsid.models.misfit`, as in `gsid.compare` (CMP-1), with the response in place of the output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from gsid.base.bands import in_band
from gsid.base.errors import InputError
from gsid.fitting.rational import inflation, weights
from gsid.models.confidence import NORMAL_95
from gsid.models.misfit import Errors, misfit
from gsid.models.sample_rate import at_rate_of
from gsid.records.mimo import MimoRecord
from gsid.response.frf import check_response
from gsid.response.mimo import any_excited, channel_lines
from gsid.spectrum.pooling import for_weights

if TYPE_CHECKING:
    from gsid.models.mimo import MimoModel
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

LAGS = 10
ALPHA = 0.05  # false-alarm rate of the test for adequacy
HELD_OUT = ("held-out cost", "of a correct model", "p", "error [dB]", "noise [dB]")
"""Columns of the validation in tables that compare models."""


@dataclass(frozen=True)
class Validation:
    """Error of a model on data that were held out of its fit.

    Attributes
    ----------
    n_lines : int
    cost, cost_expected : float
        V, and its mean for a correct model.
    interval : (float, float)
        95 % interval of V for a correct model.
    p_value : float
        Probability of a misfit this large or larger if the model is correct, with its uncertainty included.
    error_db, noise_db : float
        Rms over the lines of the complex error relative to the response, and of the noise of these data
        relative to the response [dB].
    whiteness : float
        p-value that the residuals are white over frequency (ORD-2).
    """

    n_lines: int
    cost: float
    cost_expected: float
    interval: tuple[float, float]
    p_value: float
    error_db: float
    noise_db: float
    whiteness: float

    @property
    def adequate(self) -> bool:
        """Whether noise and model uncertainty explain the error, at a false-alarm rate of 5 %."""
        return self.p_value >= ALPHA


def validate(model: RationalModel, held_out: Frf) -> Validation:
    """Validate a model on a held-out response.  Eq: VAL-1

    Parameters
    ----------
    model : RationalModel
        Model, with covariance if it was fitted.
    held_out : Frf
        Response of realisations that the fit did not use. Its lines in the band of the fit are compared.

    Returns
    -------
    Validation

    Raises
    ------
    ValueError
        The band contains no line, the response has no variance, or a model in z has another sample rate.
    """
    check_response(held_out)
    model = at_rate_of(model, held_out)
    use = in_band(held_out.f_hz, model.band_hz)
    f, g = held_out.f_hz[use], held_out.g[use]
    sigma, dof = weights(held_out, use)
    error = g - model.response(f)
    n, deviations = len(f), model.deviations(f)
    x = deviations / sigma[:, None]
    moved = (x.conj().T @ x).real
    by_model, scatter = float(np.trace(moved)), float(np.sum(moved**2))
    factor = inflation(dof) if dof > 1 else np.nan
    expected = factor * (n + by_model)
    spread = NORMAL_95 * factor * np.sqrt(n * relative_variance(factor) + 2 * by_model + 2 * scatter)
    return Validation(
        n_lines=n,
        cost=float(np.sum(np.abs(error / sigma) ** 2)),
        cost_expected=float(expected),
        interval=(float(expected - spread), float(expected + spread)),
        p_value=misfit(_errors(error, g, held_out, use, deviations)).p_value,
        error_db=_rms_db(error / g),
        noise_db=_rms_db(sigma / g),
        whiteness=whiteness(model, held_out),
    )


def _errors(
    error: np.ndarray, g: np.ndarray, held_out: Frf, use: np.ndarray, deviations: np.ndarray
) -> Errors:
    dof = float(held_out.n_dof)
    variance = np.maximum(held_out.var_g[use], (np.finfo(float).eps * np.abs(g)) ** 2)
    return Errors(
        error=error,
        var_mean=variance,
        dof=np.full(len(error), dof),
        var_weight=for_weights(variance, dof),
        real=np.zeros(len(error), bool),
        by_model=deviations,
    )


def whiteness(model: RationalModel, frf: Frf, n_lags: int = LAGS) -> float:
    """p-value of the test that the normalised residuals are white over frequency.  Eq: ORD-2

    Parameters
    ----------
    model : RationalModel
    frf : Frf
        The lines in the model's band are used.
    n_lags : int

    Returns
    -------
    float
        Uniform in 0 .. 1 if only noise remains; small if the residuals of neighbouring lines are correlated.
    """
    use = in_band(frf.f_hz, model.band_hz)
    return white((frf.g[use] - model.response(frf.f_hz[use])) / np.sqrt(frf.var_g[use]), n_lags)


def white(e: np.ndarray, n_lags: int = LAGS) -> float:
    """p-value of the whiteness test of the complex residuals of one response, (F,).  Eq: ORD-2"""
    n = len(e)
    lags = range(1, min(n_lags, n - 2) + 1)
    power = np.sum(np.abs(e) ** 2)
    r2 = [abs(np.vdot(e[lag:], e[:-lag]) / power) ** 2 * n / (n - lag) for lag in lags]
    return float(special.chdtrc(2 * len(r2), 2 * n * np.sum(r2)))


def relative_variance(inflation: float) -> float:
    """Variance of |e|^2/s^2 over its squared mean, F(2, 2 m) with m/(m - 1) = inflation."""
    if inflation <= 1:
        return 1.0
    m = inflation / (inflation - 1)
    return m / (m - 2) if m > 2 else np.inf


def held_out_text(validation: Validation | None) -> list[str]:
    """Text of the columns `HELD_OUT` for one model."""
    if validation is None:
        return [""] * len(HELD_OUT)
    v = validation
    interval = f"{v.interval[0]:.0f} .. {v.interval[1]:.0f}"
    return [f"{v.cost:.5g}", interval, f"{v.p_value:.2g}", f"{v.error_db:.1f}", f"{v.noise_db:.1f}"]


def _rms_db(x: np.ndarray) -> float:
    return float(10 * np.log10(np.mean(np.abs(x) ** 2)))


def nrmse(
    model: MimoModel, records: Sequence[MimoRecord], *, band: tuple[float, float] | None = None
) -> np.ndarray:
    """Normalised rms error of a model in steady state, over all periods of all records and all lines above 0.

    Parameters
    ----------
    model : MimoModel
    records : sequence of MimoRecord
    band : (lo, hi), optional
        Lines of error and output to use [Hz]. Outside the band of its fit, a model extrapolates.

    Returns
    -------
    (n_y,) ndarray
        Rms error over the rms of each output.

    Raises
    ------
    InputError
        A record is not usable (see `frf_mimo`), or its channels differ from those of the model.
    ValueError
        The band contains no line.
    """
    records = [records] if isinstance(records, MimoRecord) else list(records)
    error, size = np.zeros(model.n_y), np.zeros(model.n_y)
    for record in records:
        if (record.inputs, record.outputs) != (model.inputs, model.outputs):
            raise InputError(
                "the channels differ from those of the model", record.name, record.inputs + record.outputs
            )
        u, y, n_period = part = channel_lines(record)
        chosen = any_excited(part, n_period)
        f_hz = np.arange(len(chosen)) * (record.fs_hz / n_period)
        left = y.copy()
        left[..., chosen] -= np.einsum("kij,pjk->pik", model.response(f_hz[chosen]), u[..., chosen])
        use = in_band(f_hz, band) & (f_hz > 0)
        error += np.sum(np.abs(left[..., use]) ** 2, axis=(0, 2))
        size += np.sum(np.abs(y[..., use]) ** 2, axis=(0, 2))
    return np.sqrt(error / size)
