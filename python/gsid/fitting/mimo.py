"""Fits of models with common poles to a measured matrix of frequency responses (MIM-1, MIM-3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.zero_order_hold import hold_factor
from gsid.fitting.rational import DOF_WANTED
from gsid.models.hold import fit_both
from gsid.models.mimo import MimoModel
from gsid.response.mimo import MimoFrf
from gsid.spectrum.pooling import averaged, neighbours

METHODS = {"iwls": lib.GSID_METHOD_IWLS, "nls": lib.GSID_METHOD_NLS, "ml": lib.GSID_METHOD_ML}
LINES_AT_ONCE = 256  # lines per block of the sums over lines: limits the memory
HOLD_ROUNDS_MAX = 8
HOLD_SETTLED = 0.02  # largest change of the aliased images, in standard deviations of a line


def fit_mimo(
    frf: MimoFrf,
    order: str | tuple[int, int],
    *,
    delay: str | float | np.ndarray = "free",
    method: str = "ml",
    band: tuple[float, float] | None = None,
    domain: str = "s",
    delay_max_s: float = 0.0,
    allow_unstable: bool = False,
) -> MimoModel:
    """Fit a matrix of transfer functions with one denominator to a measured matrix of responses.

    Parameters
    ----------
    frf : MimoFrf
        Measured responses and their covariance.
    order : "POLES/ZEROS" or (poles, zeros)
        Number of common poles, 1 to 64, and of zeros: as many as poles or one fewer.
    delay : "free", "common", "none", float or (n_y, n_u) array_like
        "free": one estimated delay per response. "common": one estimated delay for all. "none": no delay. A
        number or an array: given delays [s].
    method : str
        "iwls": iteratively reweighted linear least squares. "nls": nonlinear least squares of the response.
        "ml": maximum likelihood, weighted with the measured variance.
    band : (lo, hi), optional
        Lines to use [Hz]; default all.
    domain : "s" or "z"
        If the records state a held input, the model in "s" describes the system behind the hold. If the
        records do not state their hold, both holds are fitted, as in `gsid.fit`.
    delay_max_s : float
        Free delays are searched from 0 to this value [s]; 0 means three periods of the highest frequency.
    allow_unstable : bool
        Accept the model of least cost even if it is unstable.

    Returns
    -------
    MimoModel
        Fitted model. Its covariance includes the correlation of the errors of different responses, and the
        uncertainty of the weights.

    Raises
    ------
    ValueError
        An argument is invalid, there are too few lines, or there are too many parameters.
    GsidError
        The equations are singular.
    """
    n_poles, direct = _order(order)
    _check_choices(method, domain, delay)
    if domain == "s" and frf.hold is None:

        def under(reading: str) -> MimoModel:
            return fit_mimo(
                replace(frf, hold=reading), order, delay=delay, method=method, band=band, domain=domain,
                delay_max_s=delay_max_s, allow_unstable=allow_unstable,
            )  # fmt: skip

        return fit_both(under, _smoothed(frf.in_band(band))[1])
    hold = frf.hold if domain == "s" else "none"
    if hold == "zoh" and direct:
        raise ValueError(
            f"a held input needs one zero fewer than poles: {n_poles}/{n_poles - 1}, or domain z"
        )
    frf = frf.in_band(band)
    n_lines = len(frf.line)
    if n_lines < n_poles + 1:
        raise ValueError(f"{n_poles} common poles need at least {n_poles + 1} lines, got {n_lines}")
    frf = _behind_hold(frf) if hold == "zoh" else frf
    cov_y, dof = _smoothed(frf)
    sigma = np.sqrt(np.einsum("kii,kjj->kij", cov_y, frf.spread).real)
    delay_of = _delay_groups(delay, frf)
    fixed = np.broadcast_to(0.0 if isinstance(delay, str) else delay, (frf.n_y, frf.n_u)).astype(float)
    cfg, _keep = _configuration(
        method, domain, n_poles, direct, frf.n_y * frf.n_u, delay_of, frf.fs_hz
    )  # the array that it points to
    cfg.delay_max_s, cfg.allow_unstable = delay_max_s, allow_unstable
    facts = {
        "domain": domain,
        "hold": hold,
        "fs_hz": frf.fs_hz,
        "delay_of": delay_of,
        "method": method,
        "n_lines": n_lines,
        "band_hz": (float(frf.f_hz[0]), float(frf.f_hz[-1])),
        "inputs": frf.inputs,
        "outputs": frf.outputs,
        "u_units": frf.u_units,
        "y_units": frf.y_units,
    }
    model, half_inverse = _settled(frf, sigma, cfg, fixed, facts)
    weight = np.ones_like(sigma) if method == "nls" else 1 / sigma
    model.cov = _covariance(model, half_inverse, frf, cov_y, weight)
    if method == "ml" and 2 < dof < np.inf:
        model.cov *= dof / (dof - 2)
    if method == "ml" and dof > 1:
        inflation = 1.0 if np.isinf(dof) else dof / (dof - 1)
        model.cost_expected = inflation * (n_lines * frf.n_y * frf.n_u - model.n_parameters / 2)
    return model


def _settled(
    frf: MimoFrf, sigma: np.ndarray, cfg: Any, fixed: np.ndarray, facts: dict[str, Any]
) -> tuple[MimoModel, np.ndarray]:
    """Fit; with a hold, repeat after subtracting the aliased images until they converge. Eq: MOD-2"""
    images = np.zeros_like(frf.g)
    for _ in range(HOLD_ROUNDS_MAX):
        delay_s = fixed.copy()
        found = _run(replace(frf, g=frf.g - images), sigma, cfg, delay_s)
        half_inverse = found.pop("cov")
        model = MimoModel(delay_s=delay_s, **found, **facts)
        if model.hold == "none":
            break
        held = model.response(frf.f_hz) / hold_factor(frf.f_hz, frf.fs_hz)[:, None, None]
        last, images = images, held - model.behind_hold(frf.f_hz)
        if np.max(np.abs(images - last) / sigma) < HOLD_SETTLED:
            break
    else:
        model.converged = False
    return model, half_inverse


def _behind_hold(frf: MimoFrf) -> MimoFrf:
    """The response divided by that of the hold; aliased images remain."""
    hold = hold_factor(frf.f_hz, frf.fs_hz)[:, None, None]
    return replace(frf, g=frf.g / hold, cov_y=frf.cov_y / np.abs(hold) ** 2)


def _order(order: str | tuple[int, int]) -> tuple[int, bool]:
    """Number of poles, and whether there are as many zeros (direct term)."""
    try:
        poles, zeros = (int(part) for part in (order.split("/") if isinstance(order, str) else order))
    except (ValueError, TypeError) as error:
        raise ValueError(f"order must be POLES/ZEROS such as 8/8, got {order!r}") from error
    if not 1 <= poles <= lib.GSID_MIMO_POLES_MAX:
        raise ValueError(f"common poles must be 1 to {lib.GSID_MIMO_POLES_MAX}, got {poles}")
    if poles - zeros not in (0, 1):
        raise ValueError(
            f"with several inputs or outputs, give as many zeros as poles or one fewer, got {order}"
        )
    return poles, zeros == poles


def _configuration(
    method: str,
    domain: str,
    n_poles: int,
    direct: bool,
    n_channels: int,
    delay_of: np.ndarray | None,
    fs_hz: float,
) -> tuple[Any, np.ndarray]:
    """Configuration of the C library, and an array that it points to."""
    cfg = ffi.new("gsid_mimo_cfg *")
    cfg.domain = lib.GSID_DOMAIN_S if domain == "s" else lib.GSID_DOMAIN_Z
    cfg.method, cfg.n_poles, cfg.direct = METHODS[method], n_poles, direct
    cfg.sample_s = 1 / fs_hz if domain == "z" else 0.0
    groups = np.ascontiguousarray(np.zeros(1) if delay_of is None else delay_of.ravel(), np.uint32)
    cfg.n_delays = 0 if delay_of is None else int(delay_of.max()) + 1
    n_parameters = n_channels * (n_poles + direct) + n_poles + cfg.n_delays
    if n_parameters > lib.GSID_LSQ_COLUMNS_MAX:
        raise ValueError(
            f"{n_poles} common poles of {n_channels} responses have {n_parameters} parameters; at most "
            f"{lib.GSID_LSQ_COLUMNS_MAX} are supported: use fewer poles, inputs or outputs"
        )
    cfg.delay_of = ffi.from_buffer("uint32_t[]", groups)
    return cfg, groups


def _check_choices(method: str, domain: str, delay: object) -> None:
    if method not in METHODS:
        raise ValueError(
            f"with several inputs or outputs, method must be one of {', '.join(METHODS)}, not {method!r}"
        )
    if domain not in ("s", "z"):
        raise ValueError(f"domain must be 's' or 'z', got {domain!r}")
    if isinstance(delay, str) and delay not in ("free", "common", "none"):
        raise ValueError(f"delay must be 'free', 'common', 'none' or seconds, got {delay!r}")


def _delay_groups(delay: object, frf: MimoFrf) -> np.ndarray | None:
    if not isinstance(delay, str) or delay == "none":
        return None
    shape = (frf.n_y, frf.n_u)
    return np.arange(frf.n_y * frf.n_u).reshape(shape) if delay == "free" else np.zeros(shape, int)


def _smoothed(frf: MimoFrf) -> tuple[np.ndarray, float]:
    """Covariance of the output errors and its degrees of freedom, smoothed over lines if these are few."""
    half = neighbours(len(frf.cov_y), frf.dof, DOF_WANTED)
    cov, dof = averaged(frf.cov_y, half, shortened=True), frf.dof * (2 * half + 1)
    size = np.einsum("kij->k", np.abs(frf.g) ** 2) / (frf.n_y * frf.n_u)
    floor = np.finfo(float).eps * np.sqrt(size) + np.finfo(float).tiny ** 0.5
    spread = np.einsum("kjj->k", frf.spread).real / frf.n_u
    least = floor**2 / spread  # noise-free data: weight all lines equally relative to their size
    return cov + least[:, None, None] * np.eye(frf.n_y), dof


def _run(frf: MimoFrf, sigma: np.ndarray, cfg: Any, delay_s: np.ndarray) -> dict[str, Any]:
    n_channels, n_local = frf.n_y * frf.n_u, cfg.n_poles + cfg.direct
    f = np.ascontiguousarray(frf.f_hz)
    g = np.ascontiguousarray(np.moveaxis(frf.g, 0, -1).reshape(n_channels, -1))
    sigma = np.ascontiguousarray(np.moveaxis(sigma, 0, -1).reshape(n_channels, -1))
    channels = ffi.new("gsid_frd[]", n_channels)
    for channel, g_row, sigma_row in zip(channels, g, sigma, strict=True):
        channel.n_lines = len(f)
        channel.f_hz, channel.sigma = (ffi.from_buffer("double[]", x) for x in (f, sigma_row))
        channel.g = ffi.cast("gsid_cplx *", ffi.from_buffer(g_row))
    n = n_channels * n_local + cfg.n_poles + cfg.n_delays
    sections, num, cov = np.zeros(cfg.n_poles), np.zeros((n_channels, n_local)), np.zeros((n, n))
    low, high = np.empty(delay_s.shape), np.empty(delay_s.shape)
    result = ffi.new("gsid_mimo_result *")
    arrays = {"section": sections, "num": num, "delay_s": delay_s, "cov": cov}
    for name, array in (arrays | {"delay_low_s": low, "delay_high_s": high}).items():
        setattr(result, name, ffi.from_buffer("double[]", array))
    check(lib.gsid_mimo_run(n_channels, channels, cfg, result), f"fit of {cfg.n_poles} common poles")
    by_section, by_num = _unscaled(result.scale_rad_s, cfg.n_poles, n_local)
    scale = np.concatenate([np.tile(by_num, n_channels), by_section, np.ones(cfg.n_delays)])
    return {
        "sections": sections * by_section,
        "num": (num * by_num).reshape(frf.n_y, frf.n_u, n_local),
        "cov": cov * scale[:, None] * scale,
        "delay_range_s": np.stack([low, high], axis=-1),
        "cost": result.cost_ml,
        "converged": bool(result.converged),
    }


def _unscaled(scale: float, n_poles: int, n_local: int) -> tuple[np.ndarray, np.ndarray]:
    """Factors that convert coefficients in v = s / scale to s, for sections and numerators."""
    by = np.full(n_poles, scale)
    by[: n_poles - n_poles % 2 : 2] = scale**2
    return by, np.concatenate([by, np.ones(n_local - n_poles)])


def _covariance(
    model: MimoModel, half_inverse: np.ndarray, frf: MimoFrf, cov_y: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """M^-1 N M^-1 / 2 as in EST-6, with errors that are correlated between responses (MIM-3)."""
    n_channels = frf.n_y * frf.n_u
    inner = np.zeros_like(half_inverse)
    factor_y, factor_u = np.linalg.cholesky(cov_y), np.linalg.cholesky(frf.spread.conj())
    for first in range(0, len(frf.f_hz), LINES_AT_ONCE):
        some = slice(first, first + LINES_AT_ONCE)
        f = frf.f_hz[some]
        slopes = np.zeros((len(f), n_channels, len(inner)), dtype=complex)
        for i, j in np.ndindex(frf.n_y, frf.n_u):
            rows = model.gradient(f, i, j) * weight[some, i, j, None] ** 2
            slopes[:, i * frf.n_u + j, model._where(i, j)] = rows
        factor = np.einsum("kac,kbd->kabcd", factor_y[some], factor_u[some])
        factor = factor.reshape(len(f), n_channels, n_channels)
        projected = (factor.conj().swapaxes(-1, -2) @ slopes).reshape(-1, len(inner))
        inner += projected.real.T @ projected.real + projected.imag.T @ projected.imag
    return 2 * half_inverse @ inner @ half_inverse
