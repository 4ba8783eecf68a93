"""Order selection: cost and its expected value, AIC, MDL, F-tests, whiteness (thesis, section 7.11).

V is the cost of eq. 7.28 over F lines, corrected for the scatter of its weights. p is the number of
parameters.

    Expected V for noise alone: F - p/2, standard deviation sqrt(F - p/2), larger with few periods
    AIC = V + p, MDL = V + p/2 ln(2 F)  (ORD-1)
    F-test of q more parameters: (V_small - V) / q over V / (2 F - p) is F(q, 2 F - p) if none is needed
    Whiteness over lags 1 .. L: 2 F sum |r_l|^2 is chi-square with 2 L degrees of freedom  (ORD-2)

For a matrix of responses, F counts the lines of all responses. Their errors are correlated, which increases
the standard deviation of the cost. The whiteness p-value of n responses is n times the least (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from gsid._lib import lib
from gsid.base.errors import GsidError
from gsid.base.tables import Table
from gsid.fitting.mimo import fit_mimo
from gsid.fitting.rational import fit
from gsid.fitting.validation import (
    HELD_OUT,
    Validation,
    held_out_text,
    relative_variance,
    validate,
    white,
    whiteness,
)
from gsid.models.confidence import LEVEL, NORMAL_95
from gsid.models.mimo import MimoModel
from gsid.response.mimo import MimoFrf

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

POLES_MAX = 9  # highest order in the thesis
MATRIX_POLES_MAX = lib.GSID_MIMO_POLES_MAX
PATIENCE = 2  # number of orders without a lower MDL that ends the upward search
MATRIX_PATIENCE = 4  # for a matrix: its modes are pole pairs, so that one more pole may raise the MDL
NEAR = 0.5  # largest distance of a pole and a zero of a cancelling pair, over the magnitude of the pole


@dataclass(frozen=True)
class Candidate:
    """Result for one order.

    Attributes
    ----------
    order : str
    model : RationalModel or MimoModel
    cost, cost_expected : float
        V, and its value expected from noise alone.
    interval : (float, float)
        95 % interval of V if only noise remains.
    aic, mdl : float
        Information criteria.
    p_value : float
        p-value of the F-test against the next lower order tried. A small value shows that the additional
        parameters are needed. NaN for the first order.
    whiteness : float
        p-value of the test that the residuals are white over frequency.
    held_out : Validation or None
        Validation on the held-out response, if given.
    """

    order: str
    model: RationalModel | MimoModel
    cost: float
    cost_expected: float
    interval: tuple[float, float]
    aic: float
    mdl: float
    p_value: float
    whiteness: float
    held_out: Validation | None = None


@dataclass(frozen=True, repr=False)
class OrderChoice:
    """Orders tried and the chosen order, which has the least MDL of all stable models.

    Attributes
    ----------
    tried : tuple of Candidate
    chosen : Candidate
    removed : tuple of str
        Poles and zeros that were removed from the first choice, as sentences.
    """

    tried: tuple[Candidate, ...]
    chosen: Candidate
    removed: tuple[str, ...]

    def table(self) -> Table:
        """Return a row for each order."""
        head = ["order", "cost", "noise alone", "AIC", "MDL", "F-test p", "whiteness p", *HELD_OUT, ""]
        rows = [
            [
                c.order,
                f"{c.cost:.5g}",
                f"{c.interval[0]:.0f} .. {c.interval[1]:.0f}",
                f"{c.aic:.5g}",
                f"{c.mdl:.5g}",
                "-" if np.isnan(c.p_value) else f"{c.p_value:.2g}",
                f"{c.whiteness:.2g}",
                *held_out_text(c.held_out),
                "chosen" if c is self.chosen else "",
            ]
            for c in self.tried
        ]
        return Table(head, rows, left=["order", ""]).without_empty(HELD_OUT)

    def __repr__(self) -> str:
        return self.table().text()

    def _repr_html_(self) -> str:
        return self.table().html()


def select_order(
    frf: Frf | MimoFrf,
    orders: Sequence[str] | None = None,
    *,
    band: tuple[float, float] | None = None,
    held_out: Frf | None = None,
    **options: object,
) -> OrderChoice:
    """Choose the number of poles and zeros.

    Parameters
    ----------
    frf : Frf or MimoFrf
        A response, or a matrix of responses.
    orders : sequence of "POLES/ZEROS", optional
        Orders to try, ascending. By default 1/0, 2/1, ... are tried until MDL stops falling, then orders with
        fewer zeros and without nearly cancelling pairs. For a matrix with inputs that are not held, orders
        with as many zeros as poles are tried instead.
    band : (lo, hi), optional
        Lines to use [Hz].
    held_out : Frf, optional
        Response of held-out realisations, on which every order is validated (`gsid.fitting.validation`). It
        does not affect the choice. Not supported for a matrix.
    **options
        Further arguments of `gsid.fit` or `gsid.fit_mimo`. The method is always maximum likelihood.

    Returns
    -------
    OrderChoice

    Raises
    ------
    ValueError
        No order gives a stable model, or an argument is invalid.
    """
    is_matrix = isinstance(frf, MimoFrf)
    if is_matrix and held_out is not None:
        raise ValueError("held_out is supported for one input and one output only")
    tried: list[Candidate] = []
    highest = MATRIX_POLES_MAX if is_matrix else POLES_MAX
    upwards = [f"{n}/{n - 1}" for n in range(1, highest + 1)]
    _try_all(frf, orders or upwards, tried, orders is None, band, options)
    if not tried:
        raise ValueError("none of the orders tried gives a stable model")
    chosen, removed = min(tried, key=lambda c: c.mdl), []
    while orders is None:
        known = {c.order for c in tried}
        new = [f"{a}/{b}" for a, b in _neighbours(chosen) if a > 0 and b >= 0 and f"{a}/{b}" not in known]
        _try_all(frf, new, tried, False, band, options)
        best = min(tried, key=lambda c: c.mdl)
        if best is chosen:
            break
        if best.model.n_parameters < chosen.model.n_parameters:
            pairs = [] if is_matrix else near_cancelled(chosen.model)
            why = f", whose pair at {abs(pairs[0][0]) / (2 * np.pi):.4g} Hz nearly cancels" if pairs else ""
            removed.append(f"{best.order} fits as well as {chosen.order}{why}")
        chosen = best
    if held_out is not None:
        judged = {id(c): replace(c, held_out=validate(c.model, held_out)) for c in tried}
        tried, chosen = [judged[id(c)] for c in tried], judged[id(chosen)]
    return OrderChoice(tuple(tried), chosen, tuple(removed))


def _neighbours(chosen: Candidate) -> list[tuple[int, int]]:
    """Orders omitted by the upward search: fewer zeros, one pair less; for a matrix, a direct term."""
    n, m = chosen.model.n_poles, chosen.model.n_zeros
    if isinstance(chosen.model, MimoModel):
        return [] if chosen.model.hold == "zoh" else [(n, n), (n - 1, n - 1)]
    return [(n, m - 1), (n, m - 2), (n - 1, m - 1), (n - 2, m - 2)]


def _try_all(
    frf: Frf | MimoFrf, orders: Sequence[str], tried: list[Candidate], until_worse: bool, band, options: dict
) -> None:
    is_matrix = isinstance(frf, MimoFrf)
    fit_any, patience = (fit_mimo, MATRIX_PATIENCE) if is_matrix else (partial(fit, quiet=True), PATIENCE)
    for order in orders:
        try:
            model = fit_any(frf, order, band=band, **{**options, "method": "ml"})
        except (GsidError, ValueError) as error:  # too few lines for the highest orders, or no stable model
            if not until_worse and isinstance(error, ValueError):
                raise
            continue
        tried.append(_judge(frf, order, model, tried))
        least = int(np.argmin([c.mdl for c in tried]))
        if until_worse and len(tried) - 1 - least >= patience:
            return


def _judge(
    frf: Frf | MimoFrf, order: str, model: RationalModel | MimoModel, tried: Sequence[Candidate]
) -> Candidate:
    """Eq: ORD-1"""
    is_matrix = isinstance(frf, MimoFrf)
    n, p = model.n_lines * (frf.n_y * frf.n_u if is_matrix else 1), model.n_parameters
    inflation = model.cost_expected / (n - p / 2)
    v = model.cost / inflation
    spread = (
        _matrix_variance(frf.in_band(model.band_hz), inflation) if is_matrix else relative_variance(inflation)
    )
    spread = NORMAL_95 * np.sqrt((n - p / 2) * spread) * inflation
    smaller = [c for c in tried if c.model.n_parameters < p]
    p_value = np.nan
    if smaller:
        other = max(smaller, key=lambda c: c.model.n_parameters)
        q = p - other.model.n_parameters
        ratio = (other.cost - model.cost) / q / (model.cost / (2 * n - p))
        p_value = float(special.fdtrc(q, 2 * n - p, max(ratio, 0.0)))
    return Candidate(
        order=order,
        model=model,
        cost=float(model.cost),
        cost_expected=float(model.cost_expected),
        interval=(float(model.cost_expected - spread), float(model.cost_expected + spread)),
        aic=float(v + p),
        mdl=float(v + p / 2 * np.log(2 * n)),
        p_value=p_value,
        whiteness=_matrix_whiteness(model, frf) if is_matrix else whiteness(model, frf),
    )


def _matrix_variance(frf: MimoFrf, inflation: float) -> float:
    """`relative_variance` for responses with correlated errors, averaged over responses.  Eq: ORD-1"""
    y = np.einsum("kij->k", np.abs(_correlation(frf.cov_y)) ** 2)
    u = np.einsum("kij->k", np.abs(_correlation(frf.spread)) ** 2)
    weights = 1.0  # factor for the scatter of the weights, which the responses of an output share
    if inflation > 1:
        m = inflation / (inflation - 1)
        weights = (m - 1) / (m - 2) if m > 2 else np.inf
    return float(np.mean(y * ((frf.n_u**2 + u) * weights - frf.n_u**2)) / (frf.n_y * frf.n_u))


def _correlation(cov: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.einsum("kii->ki", cov).real)
    return cov / (std[:, :, None] * std[:, None, :])


def _matrix_whiteness(model: MimoModel, frf: MimoFrf) -> float:
    """Least p-value of all responses times their number (Bonferroni)."""
    frf = frf.in_band(model.band_hz)
    e = ((frf.g - model.response(frf.f_hz)) / np.sqrt(frf.var_g)).reshape(len(frf.f_hz), -1)
    return min(1.0, e.shape[1] * min(white(one) for one in e.T))


def near_cancelled(model: RationalModel) -> list[tuple[complex, complex]]:
    """Pole-zero pairs that the data cannot distinguish.

    Parameters
    ----------
    model : RationalModel
        With covariance.

    Returns
    -------
    list of (pole, zero)
        In rad/s, or in z; one of each conjugate pair. Zero lies in the 95 % region of their difference.
    """
    if model.cov is None:
        return []
    pairs = []
    zeros = [z for z in model.zeros if z.imag >= 0]
    for pole in (p for p in model.poles if p.imag >= 0):
        near = [z for z in zeros if abs(z - pole) < NEAR * abs(pole) and (z.imag > 0) == (pole.imag > 0)]
        if not near:
            continue
        zero = min(near, key=lambda z: abs(z - pole))
        by = _root_slope(model, pole, True) - _root_slope(model, zero, False)
        parts, d = np.array([by.real, by.imag]), np.array([(pole - zero).real, (pole - zero).imag])
        size = 2 if pole.imag > 0 else 1
        cov = (parts @ model.cov @ parts.T)[:size, :size]
        if d[:size] @ np.linalg.solve(cov, d[:size]) < special.chdtri(size, 1 - LEVEL):
            pairs.append((complex(pole), complex(zero)))
            zeros.remove(zero)
    return pairs


def far_out(model: RationalModel) -> list[tuple[str, float]]:
    """Real roots above the band whose position the data do not determine.

    Parameters
    ----------
    model : RationalModel
        Model in s with covariance and band.

    Returns
    -------
    list of ("pole" or "zero", Hz)
        The 95 % interval of such a root includes 0: without it, a model with free delay fits equally well.
    """
    if model.cov is None or model.band_hz is None or model.domain != "s":
        return []
    roots = [("pole", *root) for root in zip(model.poles, model.pole_cov, strict=True)]
    roots += [("zero", *root) for root in zip(model.zeros, model.zero_cov, strict=True)]
    return [
        (kind, abs(root) / (2 * np.pi))
        for kind, root, cov in roots
        if root.imag == 0 and NORMAL_95 * np.sqrt(np.trace(cov)) > abs(root) > 2 * np.pi * model.band_hz[1]
    ]


def _root_slope(model: RationalModel, root: complex, is_pole: bool) -> np.ndarray:
    """Derivative of a root with respect to (den[1:], num, delay if free)."""
    coef = model.den if is_pole else model.num
    powers = np.arange(len(coef) - 1, -1, -1)
    by = -(root**powers) / np.polyval(np.polyder(coef), root)
    out = np.zeros(model.n_parameters, complex)
    if is_pole:
        out[: model.n_poles] = by[1:]
    else:
        out[model.n_poles : model.n_poles + len(model.num)] = by
    return out
