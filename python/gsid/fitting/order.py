"""How many poles and zeros: cost against its expected value, AIC, MDL, F-tests, whiteness (section 7.11).

With V the cost of eq. 7.28 over F lines, freed of what the scatter of its weights adds, and p parameters:

    expected of noise alone  F - p/2, standard deviation sqrt(F - p/2), more where variances have few periods
    AIC = V + p, MDL = V + p/2 ln(2 F)  (ORD-1)
    F-test of q parameters more: (V_small - V) / q over V / (2 F - p) is F(q, 2 F - p) if none is needed
    whiteness over lags 1 .. L: 2 F sum |r_l|^2 is chi-square of 2 L  (ORD-2)

Of a matrix of responses F counts the lines of all of them, whose errors are correlated: the costs' standard
deviation says so, and of the whiteness of n responses the least p counts, n times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from gsid._lib import lib
from gsid.base.errors import GsidError
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
    without_empty,
)
from gsid.models.confidence import LEVEL, NORMAL_95
from gsid.models.mimo import MimoModel
from gsid.response.mimo import MimoFrf

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

POLES_MAX = 9  # the source's highest order
MATRIX_POLES_MAX = lib.GSID_MIMO_POLES_MAX
PATIENCE = 2  # orders without a lower MDL before the search upwards ends
MATRIX_PATIENCE = 4  # one pole more of a matrix, whose modes are pairs, may end in a worse minimum than none
NEAR = 0.5  # a pole and a zero further apart than this part of the pole are never one pair


@dataclass(frozen=True)
class Candidate:
    """One order that was tried.

    Attributes
    ----------
    order : str
    model : RationalModel or MimoModel
    cost, cost_expected : float
        V, and what noise alone leaves of it.
    interval : (float, float)
        In which V lies 95 times in 100 when noise alone is left.
    aic, mdl : float
    p_value : float
        Of the F-test against the next lower order tried; small: the parameters more are needed. NaN for
        the first.
    whiteness : float
        p-value that the residuals are white over frequency.
    held_out : Validation or None
        On the response kept out of the fit, where one was given.
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
    """Orders tried and the one chosen: that of least MDL among stable models.

    Attributes
    ----------
    tried : tuple of Candidate
    chosen : Candidate
    removed : tuple of str
        What was taken out of the first choice, in words.
    """

    tried: tuple[Candidate, ...]
    chosen: Candidate
    removed: tuple[str, ...]

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Return the head and the rows as text."""
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
        return without_empty(head, rows, HELD_OUT)

    def __repr__(self) -> str:
        head, rows = self.table()
        return "\n".join("  ".join(f"{text:>12}" for text in row) for row in [head, *rows])


def select_order(
    frf: Frf | MimoFrf,
    orders: Sequence[str] | None = None,
    *,
    band: tuple[float, float] | None = None,
    held_out: Frf | None = None,
    **options: object,
) -> OrderChoice:
    """Choose numbers of poles and zeros.

    Parameters
    ----------
    frf : Frf or MimoFrf
        A response, or a matrix of them.
    orders : sequence of "POLES/ZEROS", optional
        To try, in rising order; default: 1/0, 2/1, ... while MDL falls, then fewer zeros and without pairs
        that nearly cancel. For a matrix then as many zeros as poles, where the inputs are not held.
    band : (lo, hi), optional
        Lines to use [Hz].
    held_out : Frf, optional
        Response of realisations kept out: every order is judged on it, too (`gsid.fitting.validation`). It
        has no part in the choice. Not for a matrix.
    **options
        Passed to `gsid.fit` or `gsid.fit_mimo`; the method is maximum likelihood.

    Returns
    -------
    OrderChoice

    Raises
    ------
    ValueError
        No order gives a stable model, or wrong arguments.
    """
    is_matrix = isinstance(frf, MimoFrf)
    if is_matrix and held_out is not None:
        raise ValueError("held_out is for one input and one output")
    tried: list[Candidate] = []
    highest = MATRIX_POLES_MAX if is_matrix else POLES_MAX
    upwards = [f"{n}/{n - 1}" for n in range(1, highest + 1)]
    _try_all(frf, orders or upwards, tried, orders is None, band, options)
    if not tried:
        raise ValueError("no order tried has a stable model")
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
            removed.append(f"{best.order} does what {chosen.order}{why} did")
        chosen = best
    if held_out is not None:
        judged = {id(c): replace(c, held_out=validate(c.model, held_out)) for c in tried}
        tried, chosen = [judged[id(c)] for c in tried], judged[id(chosen)]
    return OrderChoice(tuple(tried), chosen, tuple(removed))


def _neighbours(chosen: Candidate) -> list[tuple[int, int]]:
    """Orders that the search upwards leaves out: fewer zeros, no pair; of a matrix, a direct term."""
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
        except (GsidError, ValueError) as error:  # too few lines for the highest orders; no stable model
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
        p_value = float(stats.f.sf(max(ratio, 0.0), q, 2 * n - p))
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
    """`relative_variance` for responses whose errors are correlated, on average over them.  Eq: ORD-1"""
    y = np.einsum("kij->k", np.abs(_correlation(frf.cov_y)) ** 2)
    u = np.einsum("kij->k", np.abs(_correlation(frf.spread)) ** 2)
    weights = 1.0  # what the scatter of the weights, which the responses of an output share, adds
    if inflation > 1:
        m = inflation / (inflation - 1)
        weights = (m - 1) / (m - 2) if m > 2 else np.inf
    return float(np.mean(y * ((frf.n_u**2 + u) * weights - frf.n_u**2)) / (frf.n_y * frf.n_u))


def _correlation(cov: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.einsum("kii->ki", cov).real)
    return cov / (std[:, :, None] * std[:, None, :])


def _matrix_whiteness(model: MimoModel, frf: MimoFrf) -> float:
    """The least p of all responses, times their number."""
    frf = frf.in_band(model.band_hz)
    e = ((frf.g - model.response(frf.f_hz)) / np.sqrt(frf.var_g)).reshape(len(frf.f_hz), -1)
    return min(1.0, e.shape[1] * min(white(one) for one in e.T))


def near_cancelled(model: RationalModel) -> list[tuple[complex, complex]]:
    """Pairs of a pole and a zero that the data cannot tell apart.

    Parameters
    ----------
    model : RationalModel
        With covariance.

    Returns
    -------
    list of (pole, zero)
        In rad/s, or in z; of conjugates one. Their difference is within its 95 % region.
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
        if d[:size] @ np.linalg.solve(cov, d[:size]) < stats.chi2.ppf(LEVEL, size):
            pairs.append((complex(pole), complex(zero)))
            zeros.remove(zero)
    return pairs


def far_out(model: RationalModel) -> list[tuple[str, float]]:
    """Real roots above the band that may lie anywhere, as far as the data tell.

    Parameters
    ----------
    model : RationalModel
        In s, with covariance and band.

    Returns
    -------
    list of ("pole" or "zero", Hz)
        Their 95 % interval holds 0: a model without them follows the data as well, a free delay apart.
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
    """Derivative of a root by (den[1:], num, delay if free)."""
    coef = model.den if is_pole else model.num
    powers = np.arange(len(coef) - 1, -1, -1)
    by = -(root**powers) / np.polyval(np.polyder(coef), root)
    out = np.zeros(model.n_parameters, complex)
    if is_pole:
        out[: model.n_poles] = by[1:]
    else:
        out[model.n_poles : model.n_poles + len(model.num)] = by
    return out
