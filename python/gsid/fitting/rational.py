"""Fit of a rational model to a measured frequency response (thesis, chapter 7)."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.bands import in_band
from gsid.base.errors import GsidError
from gsid.fitting.excess import excess_cost
from gsid.fitting.intervals import mark_undetermined, set_intervals
from gsid.fitting.warnings import chosen_lines, equation_error, noisy_input
from gsid.models.confidence import unwrapped_phase_deg
from gsid.models.fit_warning import FitWarning
from gsid.models.hold import fit_both
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.response.frf import Frf, error_variance
from gsid.response.with_distortion import as_response_with_distortion, weighted_by_total
from gsid.spectrum.pooling import averaged, neighbours
from gsid.spectrum.spectra import Spectra

_log = logging.getLogger(__name__)

METHODS = {
    "ls": lib.GSID_METHOD_LS,
    "iwls": lib.GSID_METHOD_IWLS,
    "ga": lib.GSID_METHOD_GA,
    "nls-output": lib.GSID_METHOD_NLS_OUTPUT,
    "nls": lib.GSID_METHOD_NLS,
    "log": lib.GSID_METHOD_LOG,
    "ml-io": lib.GSID_METHOD_ML_INPUT_OUTPUT,
    "ml": lib.GSID_METHOD_ML,
}
SOLVERS = {"gauss-newton": lib.GSID_SOLVER_GAUSS_NEWTON, "nlopt": lib.GSID_SOLVER_NLOPT}

# Sample variances with fewer degrees of freedom are averaged over neighbouring lines before they are used as
# weights.
DOF_WANTED = 8
ROUNDING = 1e-3
"""Relative tolerance of the product of two variances, which may be in single precision."""


def fit(
    frf: Frf | Record | Spectra | Sequence[Record | Spectra],
    order: str | tuple[int, int] = "4/3",
    *,
    delay: str | float = "free",
    method: str = "ml",
    band: tuple[float, float] | None = None,
    domain: str = "s",
    hold: str | None = None,
    allow_unstable: bool = False,
    min_delay_s: float | None = None,
    exponent: float = 1.0,
    solver: str = "gauss-newton",
    start: RationalModel | None = None,
    seed: int = 0,
    relative_error: float | None = None,
    quiet: bool = False,
) -> RationalModel:
    """Fit a rational transfer function with delay to a measured frequency response.

    Where records show that distortion exceeds the noise, the lines are weighted with the total variance of
    the best linear approximation (EST-15), and the intervals are those of the errors left (STR-5).

    Parameters
    ----------
    frf : Frf, Record or Spectra, or a sequence of records or spectra
        Measured response with variance, from at least two periods. Records are converted to a response with
        the defaults of `gsid.frf`, and their distortion is measured
        (`gsid.response.with_distortion.frf_with_distortion`).
    order : "POLES/ZEROS" or (poles, zeros)
        Degrees of denominator and numerator.
    delay : "free", "none" or float
        "free": estimated; the fit scans 0 to 12 ms for a start. "none": no delay. A number: given delay [s].
    method : str
        "ls": linear least squares (eq. 7.9). "iwls": iteratively reweighted linear least squares (eqs. 7.14
        to 7.16). "ga": evolutionary search for starting values, then "nls" (eq. 7.18). "nls-output" and
        "nls": nonlinear least squares of the output and of the response (eqs. 7.20, 7.21). "log": logarithmic
        least squares (eq. 7.23). "ml": maximum likelihood, weighted with the measured variance (eq. 7.28).
        "ml-io": maximum likelihood with errors in input and output, weighted with their covariance (eqs.
        7.24, 7.26).
    band : (lo, hi), optional
        Lines to use [Hz]; default all.
    domain : "s" or "z"
    hold : "zoh" or "none", optional
        Whether the input was held over each sample; default: as stated in the record. With "zoh" the model
        describes the system behind the hold exactly (MOD-2), and its delay does not include the half sample
        of the hold. If the hold is not stated, both are fitted and the likelier is used ("none" if they
        differ by less than 2 in -2 log likelihood); see `RationalModel.hold_assumed`.
    allow_unstable : bool
        Accept the model of least cost even if it is unstable.
    min_delay_s : float, optional
        Lower bound of a free delay [s]. By default there is none: the estimate of a small delay may be
        negative.
    exponent : float
        r of eq. 7.16, for "iwls": below 1 relaxes the reweighting, above 1 sharpens it.
    solver : "gauss-newton" or "nlopt"
        Solver of the nonlinear methods. Both find the same minimum.
    start : RationalModel, optional
        Starting values of the nonlinear methods; default: the best model of a scan of delays.
    seed : int
        Random seed of the evolutionary search.
    relative_error : float, optional
        Error that a linear model is allowed over the response, beside the total variance. By default the
        total variance is used only if the noise does not explain the errors.
    quiet : bool
        Do not log the warnings of the model.

    Returns
    -------
    RationalModel
        Fitted model. Its covariance includes the uncertainty of the weights (EST-5), and the distortion where
        the errors exceed the noise (EST-15); `cov_noise` is then that of the noise alone. Its `warnings`
        report a bias by noise, with the method to use instead, and errors larger than the noise, with a
        remedy to try.

    Raises
    ------
    ValueError
        An argument is invalid, there are too few lines or periods, or the (co)variances of input and output
        contradict each other.
    TypeError
        frf is neither a response nor records.
    InputError
        The records are not usable; see `gsid.frf`.
    GsidError
        There is no stable model, or the equations are singular.
    """
    frf = as_response_with_distortion(frf)
    if relative_error is not None and (frf.var_total is None or not relative_error >= 0):
        raise ValueError(f"relative_error needs a total variance and is not negative, got {relative_error}")
    options = {
        "delay": delay, "method": method, "band": band, "domain": domain, "hold": hold,
        "allow_unstable": allow_unstable, "min_delay_s": min_delay_s, "exponent": exponent, "solver": solver,
        "start": start, "seed": seed,
    }  # fmt: skip
    noise = replace(frf, var_total=None)
    if relative_error is None:
        model = _fit_weighted(noise, order, **options)
        if frf.var_total is None or not any(warning.what == "excess_cost" for warning in model.warnings):
            return _report(_with_intervals(model, noise, noise, band), quiet)
    weighted = weighted_by_total(frf, relative_error or 0.0)
    model = _fit_weighted(weighted, order, **options)
    model.weights = "total"
    return _report(_with_intervals(model, noise, weighted, band), quiet)


def _fit_weighted(
    frf: Frf,
    order: str | tuple[int, int],
    *,
    delay: str | float,
    method: str,
    band: tuple[float, float] | None,
    domain: str,
    hold: str | None,
    allow_unstable: bool,
    min_delay_s: float | None,
    exponent: float,
    solver: str,
    start: RationalModel | None,
    seed: int,
) -> RationalModel:
    """Fit with the variance of `frf`, under both holds if it is not stated."""
    n_poles, n_zeros = parse_order(order)
    _check_choices(method, domain, solver)
    if hold is None and domain == "s" and frf.hold is None:

        def under(reading: str) -> RationalModel:
            return _fit_weighted(
                frf, order, delay=delay, method=method, band=band, domain=domain, hold=reading,
                allow_unstable=allow_unstable, min_delay_s=min_delay_s, exponent=exponent, solver=solver,
                start=start, seed=seed,
            )  # fmt: skip

        return fit_both(under, weights(frf, in_band(frf.f_hz, band))[1])
    hold = (frf.hold if domain == "s" else "none") if hold is None else hold
    if hold not in ("zoh", "none"):
        raise ValueError(f"hold must be 'zoh' or 'none', got {hold!r}")
    use = in_band(frf.f_hz, band)
    sigma, dof = weights(frf, use)
    n_lines, n_parameters = np.count_nonzero(use), n_poles + n_zeros + 1 + (delay == "free")
    if 2 * n_lines < n_parameters:
        raise ValueError(
            f"{n_parameters} parameters need at least {-(-n_parameters // 2)} lines; the band has {n_lines}"
        )

    _check_rate(frf.fs_hz, frf.f_hz[use], domain, hold)
    cfg = _configuration(
        n_poles, n_zeros, method, domain, hold, delay, frf.fs_hz, allow_unstable=allow_unstable
    )
    if 0 < frf.period_samples / frf.fs_hz <= cfg.delay_s:
        _log.warning("the delay of %g s is not shorter than the period; note that its unit is s", cfg.delay_s)
    cfg.solver, cfg.exponent, cfg.seed = SOLVERS[solver], exponent, seed
    cfg.sigma_dof = 0.0 if np.isinf(dof) else dof
    if min_delay_s is not None:
        cfg.bound_delay, cfg.delay_min_s = True, min_delay_s
    if start is not None:
        if (start.n_poles, start.n_zeros, start.domain) != (n_poles, n_zeros, domain):
            raise ValueError(f"start has order {start.n_poles}/{start.n_zeros} in {start.domain}")
        cfg.start = c_start = start._to_c()  # noqa: F841  (keeps it alive)
    if method == "ml-io":
        _check_covariances(frf, use)
    amplitude = np.ascontiguousarray(np.abs(frf.u[use]))
    cfg.input = ffi.from_buffer("double[]", amplitude)
    data, _keep_alive = _c_lines(frf, use, sigma)
    result = ffi.new("gsid_fit_result *")
    _run(data, cfg, result, f"fit of order {n_poles}/{n_zeros}", method)
    facts = {"method": method, "domain": domain, "hold": hold, "free_delay": delay == "free"}
    model, bias = _answer(result, frf, use, dof, **facts)
    model.warnings = _warnings(model, bias, frf, use, sigma)
    return model


def _with_intervals(
    model: RationalModel, noise: Frf, weighted: Frf, band: tuple[float, float] | None
) -> RationalModel:
    """Set the intervals by the errors left if they exceed the noise, and note what is not determined."""
    use = in_band(noise.f_hz, band)
    lines, sigma = weighted.at(use), weights(weighted, use)[0]
    if model.weights == "total":
        biases = tuple(warning for warning in model.warnings if warning.what != "excess_cost")
        excess = excess_cost(model, noise.at(use), beside=excess_cost(model, lines))
        model.warnings = biases or (() if excess is None else (excess,))
    if model.weights == "total" or any(warning.what == "excess_cost" for warning in model.warnings):
        set_intervals(model, lines, sigma, sigma if weighted is noise else weights(noise, use)[0])
    mark_undetermined(model, lines, sigma)
    return model


def _run(data: Any, cfg: Any, result: Any, doing: str, method: str) -> None:
    try:
        check(lib.gsid_fit_run(data, cfg, result), doing)
    except GsidError as error:
        if error.code == lib.GSID_E_UNSTABLE and method in ("ls", "iwls"):
            hint = f"noise can make the result of {method} unstable; use method ml, which keeps models stable"
            raise GsidError(error.code, error.message, hint) from error
        raise


def _report(model: RationalModel, quiet: bool) -> RationalModel:
    """Log the warnings of a model and return it."""
    for warning in () if quiet else model.warnings:
        _log.warning("%s", warning.text)
    return model


def _warnings(
    model: RationalModel, bias: np.ndarray, frf: Frf, use: np.ndarray, sigma: np.ndarray
) -> tuple[FitWarning, ...]:
    """Errors that the intervals do not include: bias by noise, and errors beyond the noise."""
    f_hz, fitted, found = frf.f_hz[use], frf.at(use), None
    if model.method in ("ls", "iwls"):
        found = equation_error(model, bias, f_hz)
    elif model.method in ("ml", "nls-output"):
        var_u, cov_yu = _input_errors(frf, use, sigma)
        common = cov_yu - var_u * frf.g[use]  # of response and input errors, over |U|^2
        if model.method == "ml":
            found = noisy_input(model, f_hz, 2 * common, 1 / sigma)
        else:
            found = noisy_input(model, f_hz, common / _own_share(frf, use), np.abs(frf.u[use]))
    biases = [warning for warning in (found, chosen_lines(model, fitted, sigma)) if warning is not None]
    if biases:  # a bias also increases the cost
        return tuple(biases)
    excess = excess_cost(model, fitted)
    return () if excess is None else (excess,)


def parse_order(order: str | tuple[int, int]) -> tuple[int, int]:
    """Read "POLES/ZEROS".

    Raises
    ------
    ValueError
        The order does not consist of two whole numbers from 0 to the highest supported order.
    """
    try:
        poles, zeros = (int(part) for part in (order.split("/") if isinstance(order, str) else order))
    except (ValueError, TypeError) as error:
        other = "; use select_order to try several orders" if order == "auto" else ""
        raise ValueError(f"order must be POLES/ZEROS such as 4/3, got {order!r}{other}") from error
    for name, value in (("poles", poles), ("zeros", zeros)):
        if not 0 <= value <= lib.GSID_ORDER_MAX:
            raise ValueError(f"{name} must be 0 to {lib.GSID_ORDER_MAX}, got {value}")
    return poles, zeros


def _check_choices(method: str, domain: str, solver: str) -> None:
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if domain not in ("s", "z"):
        raise ValueError(f"domain must be 's' or 'z', got {domain!r}")
    if solver not in SOLVERS:
        raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {solver!r}")


def _check_rate(fs_hz: float, f_hz: np.ndarray, domain: str, hold: str) -> None:
    if hold == "none" and domain == "s":
        return
    kind = "a model in z" if domain == "z" else "a held input"
    if not math.isfinite(fs_hz):
        raise ValueError(f"{kind} needs the sample rate of the response: Frf.from_arrays(..., fs_hz=...)")
    if f_hz.max() >= fs_hz / 2:
        raise ValueError(
            f"{kind} at {fs_hz:g} Hz needs lines below {fs_hz / 2:g} Hz; the highest is at {f_hz.max():g} Hz"
        )


def _configuration(
    n_poles: int,
    n_zeros: int,
    method: str,
    domain: str,
    hold: str,
    delay: str | float,
    fs_hz: float,
    *,
    allow_unstable: bool,
) -> Any:
    cfg = ffi.new("gsid_fit_cfg *")
    cfg.domain = lib.GSID_DOMAIN_S if domain == "s" else lib.GSID_DOMAIN_Z
    cfg.method = METHODS[method]
    cfg.n_poles, cfg.n_zeros = n_poles, n_zeros
    cfg.sample_s = 1.0 / fs_hz
    cfg.hold = hold == "zoh"
    cfg.allow_unstable = allow_unstable
    if delay == "free":
        cfg.delay = lib.GSID_DELAY_FREE
    elif delay == "none":
        cfg.delay = lib.GSID_DELAY_NONE
    else:
        try:
            delay_s = math.nan if isinstance(delay, bool) else float(delay)
        except (TypeError, ValueError):
            delay_s = math.nan
        if not math.isfinite(delay_s):
            raise ValueError(f"delay must be 'free', 'none' or a number of seconds, got {delay!r}")
        cfg.delay, cfg.delay_s = lib.GSID_DELAY_FIXED, delay_s
    if hold == "zoh" and n_zeros > n_poles:
        raise ValueError(f"with a held input, give no more zeros than poles, got {n_poles}/{n_zeros}")
    return cfg


def weights(frf: Frf, use: np.ndarray) -> tuple[np.ndarray, float]:
    """Standard deviation of the used lines, and the degrees of freedom of its square."""
    dof = float(frf.n_dof)
    if np.isinf(dof) and not np.all(np.isfinite(frf.var_g[use])):
        raise ValueError("the response has no variance: give var_g (ones, if it is not known)")
    if dof < 1:
        raise ValueError(f"the response has {frf.n_periods} good periods: its variance needs at least 2")
    half = neighbours(np.count_nonzero(use), dof, DOF_WANTED)
    var = averaged(frf.var_g[use], half, shortened=True)
    dof *= 2 * half + 1
    if not np.all(var > 0):
        # Noise-free data (a simulation): weight all lines equally relative to their size.
        floor = np.finfo(float).eps * np.abs(frf.g[use])
        var = np.maximum(var, np.maximum(floor, np.finfo(float).tiny ** 0.5) ** 2)
    return np.ascontiguousarray(np.sqrt(var)), dof


def _own_share(frf: Frf, use: np.ndarray) -> np.ndarray:
    """Weight of a line in its own averaged variance."""
    n_lines = np.count_nonzero(use)
    half = neighbours(n_lines, float(frf.n_dof), DOF_WANTED)
    k = np.arange(n_lines)
    return 1 / (np.minimum(k, half) + 1 + np.minimum(k[::-1], half))


def _check_covariances(frf: Frf, use: np.ndarray) -> None:
    """Raise ValueError if the variance of Y - G U would be negative for some G."""
    f_hz, var_u, var_y, cov_yu = frf.f_hz[use], frf.var_u[use], frf.var_y[use], frf.cov_yu[use]
    product = var_u * var_y * (1 + ROUNDING)
    bad = np.flatnonzero((np.abs(cov_yu) ** 2 > product) | (var_u < 0) | (var_y < 0))
    if bad.size:
        k = bad[0]
        raise ValueError(
            f"variances of input and output contradict their covariance at {f_hz[k]:g} Hz: "
            f"var_u {var_u[k]:g}, var_y {var_y[k]:g}, |cov_yu|^2 {abs(cov_yu[k]) ** 2:g}; "
            "method ml uses var_g only"
        )


def _input_errors(frf: Frf, use: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the input error and its covariance with the output error, over |U|^2, scaled like sigma.

    Both are terms of the variance of g (thesis, eq. 7.29) and are scaled like this variance. If it is
    averaged over neighbouring lines, only the part of the line itself depends on the model, so that the
    variance remains positive.
    """
    g, size = frf.g[use], np.abs(frf.u[use]) ** 2
    whole = error_variance(frf.var_u[use], frf.var_y[use], frf.cov_yu[use], g)
    half = neighbours(len(g), float(frf.n_dof), DOF_WANTED)
    pooled = averaged(whole / size, half, shortened=True)
    scale = np.divide(sigma**2, pooled, out=np.zeros(len(g)), where=pooled > 0) * _own_share(frf, use)
    var_u, cov_yu = frf.var_u[use] / size * scale, frf.cov_yu[use] / size * scale
    return np.ascontiguousarray(var_u), np.ascontiguousarray(cov_yu, dtype=complex)


def _c_lines(frf: Frf, use: np.ndarray, sigma: np.ndarray) -> tuple[Any, list[np.ndarray]]:
    """The used lines as a gsid_frd, and the arrays that it points to."""
    f, g = np.ascontiguousarray(frf.f_hz[use]), np.ascontiguousarray(frf.g[use])
    var_u, cov_yu = _input_errors(frf, use, sigma)
    data = ffi.new("gsid_frd *")
    data.n_lines = len(f)
    data.f_hz, data.sigma = ffi.from_buffer("double[]", f), ffi.from_buffer("double[]", sigma)
    data.g = ffi.cast("gsid_cplx *", ffi.from_buffer(g))
    data.var_u = ffi.from_buffer("double[]", var_u)
    data.cov_yu = ffi.cast("gsid_cplx *", ffi.from_buffer(cov_yu))
    return data, [f, g, sigma, var_u, cov_yu]


def initial_delay(frf: Frf, band: tuple[float, float] | None = None) -> float:
    """Delay from the mean slope of the unwrapped phase, the starting value of the thesis (eq. 7.8; EST-7).

    Parameters
    ----------
    frf : Frf
    band : (lo, hi), optional
        Passband in which the slope is evaluated [Hz].

    Returns
    -------
    float
        Delay [s]. It includes the lag of the plant, so that `fit` scans delays from 0 instead of using it.

    Raises
    ------
    ValueError
        The band contains fewer than two lines.
    """
    use = in_band(frf.f_hz, band)
    if np.count_nonzero(use) < 2:
        raise ValueError("the slope of the phase needs two lines")
    phase = np.radians(unwrapped_phase_deg(frf.f_hz[use], frf.g[use], np.sqrt(frf.var_g[use])))
    return float(-np.mean(np.diff(phase) / (2 * np.pi * np.diff(frf.f_hz[use]))))


def inflation(dof: float) -> float:
    """Mean of sigma^2 / s^2 for a sample variance s^2 with `dof` degrees of freedom."""
    return 1.0 if np.isinf(dof) else dof / (dof - 1)


def _answer(
    result: Any, frf: Frf, use: np.ndarray, dof: float, *, method: str, **facts: Any
) -> tuple[RationalModel, np.ndarray]:
    """The fitted model with the requested properties `facts`, and the bias of its parameters."""
    f = frf.f_hz[use]
    num, den, cov, bias = _plain(result, facts["domain"])
    is_ml = method in ("ml", "ml-io")
    if is_ml and 2 < dof < np.inf:
        cov = cov * dof / (dof - 2)
    model = RationalModel(
        num=num,
        den=den,
        delay_s=result.model.delay_s,
        fs_hz=frf.fs_hz,
        cov=cov,
        method=method,
        cost=result.cost if method == "ml-io" else result.cost_ml,
        cost_expected=inflation(dof) * (len(f) - result.n_parameters / 2) if is_ml and dof > 1 else None,
        n_lines=len(f),
        converged=bool(result.converged),
        band_hz=(float(f[0]), float(f[-1])),
        u_unit=frf.u_unit,
        y_unit=frf.y_unit,
        **facts,
    )
    return model, bias


def _plain(result: Any, domain: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """num, den, covariance and bias in unscaled s, highest power first; unchanged in domain z."""
    model, p = result.model, result.n_parameters
    n, m = model.n_poles, model.n_zeros
    num = np.array([model.num[i] for i in range(m + 1)])
    den = np.array([model.den[i] for i in range(n + 1)])
    cov, bias = np.array(ffi.unpack(result.cov, p * p)).reshape(p, p), np.array(ffi.unpack(result.bias, p))
    if domain == "z":
        return num, den, cov, bias
    scale_den = model.scale_rad_s ** (n - np.arange(n + 1.0))
    scale_num = model.scale_rad_s ** (n - np.arange(m + 1.0))
    scale = np.concatenate([scale_den[:-1], scale_num, np.ones(p - n - m - 1)])
    order = np.concatenate([np.arange(n)[::-1], n + np.arange(m + 1)[::-1], np.arange(n + m + 1, p)]).astype(
        int
    )
    cov = (cov * scale[:, None] * scale)[np.ix_(order, order)]
    return (num * scale_num)[::-1], (den * scale_den)[::-1], cov, (bias * scale)[order]
