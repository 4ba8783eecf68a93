"""Order selection: cost and its expected value, AIC, MDL, F-tests, whiteness (thesis, section 7.11).

V is the cost of eq. 7.28 over F lines, corrected for the scatter of its weights. p is the number of
parameters.

    Expected V for noise alone: F - p/2, standard deviation sqrt(F - p/2), larger with few periods
    AIC = V + p, MDL = V + p/2 ln(2 F)  (ORD-1)
    F-test of q more parameters: (V_small - V) / q over V / (2 F - p) is F(q, 2 F - p) if none is needed
    Whiteness over lags 1 .. L: 2 F sum |r_l|^2 is chi-square with 2 L degrees of freedom  (ORD-2)

Where distortion exceeds the noise, V is weighted with the total variance, and MDL is the score of EST-16.

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
from gsid.fitting.order_total import Scored, Search
from gsid.fitting.rational import fit
from gsid.fitting.roots import near_cancelled
from gsid.fitting.validation import (
    HELD_OUT,
    Validation,
    held_out_text,
    relative_variance,
    validate,
    white,
    whiteness,
)
from gsid.models.confidence import NORMAL_95
from gsid.models.mimo import MimoModel
from gsid.response.mimo import MimoFrf
from gsid.response.with_distortion import weighted_by_total

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel
    from gsid.response.frf import Frf

POLES_MAX = 9  # highest order in the thesis
MATRIX_POLES_MAX = lib.GSID_MIMO_POLES_MAX
PATIENCE = 2  # number of orders without a lower MDL that ends the upward search
AVOIDED_SHOWN = 3  # orders of lower MDL with doubtful roots that are named
MATRIX_PATIENCE = 4  # for a matrix: its modes are pole pairs, so that one more pole may raise the MDL


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
        Information criteria; `mdl` is the score of EST-16 with the total variance.
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
        Poles and zeros that were removed from the first choice, and orders that were avoided, as sentences.
    relative_error : float or None
        Error of the response that the linear model was allowed, for `gsid.fit`. None if the weights are those
        of the noise.
    """

    tried: tuple[Candidate, ...]
    chosen: Candidate
    removed: tuple[str, ...]
    relative_error: float | None = None

    def table(self) -> Table:
        """Return a row for each order."""
        expected = "noise alone" if self.relative_error is None else "expected"
        head = ["order", "cost", expected, "AIC", "MDL", "F-test p", "whiteness p", *HELD_OUT, ""]
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
        A response, or a matrix of responses. With the total variance of
        `gsid.response.with_distortion.frf_with_distortion`, orders that follow distortion are avoided.
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
    if orders is None and not is_matrix and frf.var_total is not None:
        search = Search(frf, band, options, POLES_MAX)
        best = search.run()
        if not search.is_linear(best):
            return _by_total(search, best, held_out)
        frf = replace(frf, var_total=None)
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
    return _judged(OrderChoice(tuple(tried), chosen, tuple(removed)), held_out)


def _judged(choice: OrderChoice, held_out: Frf | None) -> OrderChoice:
    """The choice with each order validated on a held-out response, if given."""
    if held_out is None:
        return choice
    judged = {id(c): replace(c, held_out=validate(c.model, held_out)) for c in choice.tried}
    return replace(choice, tried=tuple(judged[id(c)] for c in choice.tried), chosen=judged[id(choice.chosen)])


def _by_total(search: Search, best: Scored, held_out: Frf | None) -> OrderChoice:
    """The choice of a search with the total variance.  Eq: EST-16"""
    weighted = weighted_by_total(search.frf, search.relative_error)
    tried: list[Candidate] = []
    for one in search.found:
        tried.append(replace(_judge(weighted, one.order, one.model, tried), mdl=one.score))
    chosen = tried[search.found.index(best)]
    removed = [
        f"{one.order} has a lower MDL, but {one.doubts[0].text}"
        for one in sorted(search.found, key=lambda one: one.score)
        if one.score < best.score and one.doubts and not best.doubts
    ][:AVOIDED_SHOWN]
    return _judged(OrderChoice(tuple(tried), chosen, tuple(removed), search.relative_error), held_out)


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
