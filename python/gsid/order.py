"""How many poles and zeros: cost against its expected value, AIC, MDL, F-tests, whiteness (section 7.11).

With V the cost of eq. 7.28 over F lines, freed of what the scatter of its weights adds, and p parameters:

    expected of noise alone  F - p/2, standard deviation sqrt(F - p/2), more where variances have few periods
    AIC = V + p, MDL = V + p/2 ln(2 F)  (ORD-1)
    F-test of q parameters more: (V_small - V) / q over V / (2 F - p) is F(q, 2 F - p) if none is needed
    whiteness over lags 1 .. L: 2 F sum |r_l|^2 is chi-square of 2 L  (ORD-2)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from gsid.confidence import LEVEL, NORMAL_95
from gsid.errors import GsidError
from gsid.fit import fit, parse_order
from gsid.validation import (
    HELD_OUT,
    Validation,
    held_out_text,
    relative_variance,
    validate,
    whiteness,
    without_empty,
)

if TYPE_CHECKING:
    from gsid.frf import Frf
    from gsid.model import RationalModel

POLES_MAX = 9  # the source's highest order
PATIENCE = 2  # orders without a lower MDL before the search upwards ends
NEAR = 0.5  # a pole and a zero further apart than this part of the pole are never one pair


@dataclass(frozen=True)
class Candidate:
    """One order that was tried.

    Attributes
    ----------
    order : str
    model : RationalModel
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
    model: RationalModel
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
    frf: Frf,
    orders: Sequence[str] | None = None,
    *,
    band: tuple[float, float] | None = None,
    held_out: Frf | None = None,
    **options: object,
) -> OrderChoice:
    """Choose numbers of poles and zeros.

    Parameters
    ----------
    frf : Frf
    orders : sequence of "POLES/ZEROS", optional
        To try, in rising order; default: 1/0, 2/1, ... while MDL falls, then fewer zeros and without pairs
        that nearly cancel.
    band : (lo, hi), optional
        Lines to use [Hz].
    held_out : Frf, optional
        Response of realisations kept out: every order is judged on it, too (`gsid.validation`). It has no
        part in the choice.
    **options
        Passed to `gsid.fit.fit`; the method is maximum likelihood.

    Returns
    -------
    OrderChoice

    Raises
    ------
    ValueError
        No order gives a stable model, or wrong arguments.
    """
    tried: list[Candidate] = []
    _try_all(
        frf, orders or [f"{n}/{n - 1}" for n in range(1, POLES_MAX + 1)], tried, orders is None, band, options
    )
    if not tried:
        raise ValueError("no order tried has a stable model")
    chosen, removed = min(tried, key=lambda c: c.mdl), []
    while orders is None:
        n, m = parse_order(chosen.order)
        smaller = [(n, m - 1), (n, m - 2), (n - 1, m - 1), (n - 2, m - 2)]
        pairs = near_cancelled(chosen.model)
        known = {c.order for c in tried}
        new = [f"{a}/{b}" for a, b in smaller if a > 0 and b >= 0 and f"{a}/{b}" not in known]
        _try_all(frf, new, tried, False, band, options)
        best = min(tried, key=lambda c: c.mdl)
        if best is chosen:
            break
        why = f", whose pair at {abs(pairs[0][0]) / (2 * np.pi):.4g} Hz nearly cancels" if pairs else ""
        removed.append(f"{best.order} does what {chosen.order}{why} did")
        chosen = best
    if held_out is not None:
        judged = {id(c): replace(c, held_out=validate(c.model, held_out)) for c in tried}
        tried, chosen = [judged[id(c)] for c in tried], judged[id(chosen)]
    return OrderChoice(tuple(tried), chosen, tuple(removed))


def _try_all(
    frf: Frf, orders: Sequence[str], tried: list[Candidate], until_worse: bool, band, options: dict
) -> None:
    for order in orders:
        try:
            model = fit(frf, order, band=band, **{**options, "method": "ml"})
        except (GsidError, ValueError) as error:  # too few lines for the highest orders; no stable model
            if not until_worse and isinstance(error, ValueError):
                raise
            continue
        tried.append(_judge(frf, order, model, tried))
        least = int(np.argmin([c.mdl for c in tried]))
        if until_worse and len(tried) - 1 - least >= PATIENCE:
            return


def _judge(frf: Frf, order: str, model: RationalModel, tried: Sequence[Candidate]) -> Candidate:
    """Eq: ORD-1"""
    n, p = model.n_lines, model.n_parameters
    inflation = model.cost_expected / (n - p / 2)
    v = model.cost / inflation
    spread = NORMAL_95 * np.sqrt((n - p / 2) * relative_variance(inflation)) * inflation
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
        whiteness=whiteness(model, frf),
    )


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
