"""Fit of piecewise models: choose the breaks of the band and fit a low-order model to each piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gsid._lib import lib
from gsid.base.bands import in_band
from gsid.base.errors import GsidError
from gsid.base.hold import fit_readings, likelier, other_reading
from gsid.fitting.rational import fit, parse_order
from gsid.models.piecewise import PIECES_MAX, Cut, PiecewiseModel
from gsid.models.rational import RationalModel

if TYPE_CHECKING:
    from gsid.response.frf import Frf

INTERVALS = 20  # of the grid of candidate breaks, evenly spaced in log f
NARROWED_BY = 5  # number of positions tried between two neighbouring candidates, in each refinement


def fit_piecewise(
    frf: Frf,
    order: str | tuple[int, int] = "2/1",
    n_pieces: int | None = None,
    *,
    band: tuple[float, float] | None = None,
    **options: object,
) -> PiecewiseModel:
    """Divide the band into pieces and fit a low-order model to each piece.

    Parameters
    ----------
    frf : Frf
    order : "POLES/ZEROS" or (poles, zeros)
        Order of each piece.
    n_pieces : int, optional
        Number of pieces; default: the number of least MDL, at most `PIECES_MAX`.
    band : (lo, hi), optional
        Lines to use [Hz].
    **options
        Further arguments of `gsid.fit`. The method is always maximum likelihood. A free delay is estimated
        for each piece. If neither the response nor `hold` states the hold, all pieces have the hold of less
        MDL ("none" if they differ by less than 1).

    Returns
    -------
    PiecewiseModel

    Raises
    ------
    ValueError
        An argument is invalid, there are too few lines for the number of pieces, or a band has no stable
        model.
    GsidError
        As for `gsid.fit`, except that a band without a stable model raises ValueError.
    """
    if n_pieces is not None and not 1 <= n_pieces <= PIECES_MAX:
        raise ValueError(f"n_pieces must be 1 to {PIECES_MAX}, got {n_pieces}")
    if frf.hold is None and options.get("hold") is None and options.get("domain", "s") == "s":
        return _likelier(frf, order, n_pieces, band, {**options, "method": "ml"})
    n_poles, n_zeros = parse_order(order)
    if frf.var_total is not None:  # one variance for all bands, so that their costs compare
        options = {"relative_error": 0.0} | options
    bands = _Bands(frf, (n_poles, n_zeros), band, options)
    limit = PIECES_MAX if n_pieces is None else n_pieces
    cuts = {n: bands.refined(edges) for n, edges in bands.best_cuts(limit).items()}
    wanted = cuts if n_pieces is None else {n: cuts[n] for n in (n_pieces,) if n in cuts}
    if not wanted:
        what = (
            f"the band cannot be divided into {n_pieces or 1} bands with enough lines and a stable model each"
        )
        raise ValueError(what) from bands.failure
    judged = {n: bands.judge(edges) for n, edges in cuts.items()}
    chosen = wanted[min(wanted, key=lambda n: judged[n].mdl)]
    pieces = tuple(bands.model(lo, hi) for lo, hi in pairwise(chosen))
    breaks = tuple(float(bands.f_hz[i - 1 : i + 1].mean()) for i in chosen[1:-1])
    return PiecewiseModel(pieces, breaks, tuple(judged[n] for n in sorted(judged)))


def _likelier(
    frf: Frf,
    order: str | tuple[int, int],
    n_pieces: int | None,
    band: tuple[float, float] | None,
    options: dict,
) -> PiecewiseModel:
    """Choose one hold for all pieces of a response that does not state its hold: that of least MDL."""
    options.pop("hold", None)
    found = fit_readings(
        lambda reading: fit_piecewise(frf, order, n_pieces, band=band, hold=reading, **options)
    )
    mdl = {
        reading: next(cut.mdl for cut in model.tried if cut.n_pieces == len(model.pieces))
        for reading, model in found.items()
    }
    taken = likelier({reading: 2 * value for reading, value in mdl.items()})

    def marked(piece: RationalModel) -> RationalModel:
        try:
            other = fit(frf, order, band=piece.band_hz, hold=other_reading(taken), **options)
        except (GsidError, ValueError):  # too many zeros for a held input, or no stable model
            return replace(piece, hold_assumed=True)
        return replace(piece, hold_assumed=True, other_delay_s=other.delay_s)

    return replace(found[taken], pieces=tuple(map(marked, found[taken].pieces)))


class _Bands:
    """Models of bands of lines, each fitted once. A band consists of the used lines lo .. hi - 1."""

    def __init__(self, frf: Frf, order: tuple[int, int], band: tuple[float, float] | None, options: dict):
        self.frf, self.order, self.options = frf, order, options
        self.f_hz = frf.f_hz[in_band(frf.f_hz, band)]
        self.n_parameters = sum(order) + 1 + (options.get("delay", "free") == "free")
        self._models: dict[tuple[int, int], RationalModel | None] = {}
        self.failure: GsidError | None = None
        even = np.geomspace(self.f_hz[0], self.f_hz[-1], INTERVALS + 1)[1:-1]
        inner = np.searchsorted(self.f_hz, even)
        self.grid = [int(i) for i in np.unique([0, *inner, len(self.f_hz)])]

    def model(self, lo: int, hi: int) -> RationalModel | None:
        """The model of a band; None if it has too few lines or periods, or no stable model.

        Raises
        ------
        GsidError
            The fit failed for a reason that does not depend on the band.
        """
        if hi - lo < self.n_parameters:  # at least two real numbers per parameter
            return None
        if (lo, hi) not in self._models:
            band = (self.f_hz[lo], self.f_hz[hi - 1])
            try:
                model = fit(self.frf, self.order, band=band, quiet=True, **{**self.options, "method": "ml"})
            except GsidError as error:
                if error.code not in (lib.GSID_E_UNSTABLE, lib.GSID_E_SINGULAR):
                    raise
                self.failure, model = error, None
            # Without an expected cost, as with two lines of two periods, costs cannot be compared.
            self._models[lo, hi] = None if model is None or model.cost_expected is None else model
        return self._models[lo, hi]

    def cost(self, lo: int, hi: int) -> float:
        """V of a band, corrected for the scatter of its weights; infinite without a model."""
        model = self.model(lo, hi)
        if model is None:
            return np.inf
        return model.cost * (hi - lo - self.n_parameters / 2) / model.cost_expected

    def total(self, edges: Sequence[int]) -> float:
        """Sum of the costs of adjoining bands."""
        return sum(self.cost(lo, hi) for lo, hi in pairwise(edges))

    def best_cuts(self, n_max: int) -> dict[int, list[int]]:
        """Edges of the division of least cost for each number of pieces, on the grid of candidates."""
        best = {1: {hi: ([0, hi], self.cost(0, hi)) for hi in self.grid[1:]}}
        for k in range(2, n_max + 1):
            best[k] = {}
            for hi in self.grid[1:]:
                ways = [
                    ([*edges, hi], cost + self.cost(lo, hi))
                    for lo, (edges, cost) in best[k - 1].items()
                    if lo < hi and np.isfinite(cost)
                ]
                if ways:
                    best[k][hi] = min(ways, key=lambda way: way[1])
        ends = {k: ways[len(self.f_hz)] for k, ways in best.items() if len(self.f_hz) in ways}
        return {k: edges for k, (edges, cost) in ends.items() if np.isfinite(cost)}

    def refined(self, edges: list[int]) -> list[int]:
        """Move each break in turn to the line of least cost between the neighbouring candidates."""
        edges = list(edges)
        for i in range(1, len(edges) - 1):
            at = self.grid.index(edges[i])
            lo, hi, step = self.grid[at - 1], self.grid[at + 1], 0
            while step != 1:
                step = max((hi - lo) // (NARROWED_BY + 1), 1)
                places = {edges[i], *range(lo + step, hi, step)}
                allowed = sorted(p for p in places if edges[i - 1] < p < edges[i + 1])
                edges[i] = min(allowed, key=lambda p: self.total([edges[i - 1], p, edges[i + 1]]))
                lo, hi = edges[i] - step, edges[i] + step
        return edges

    def judge(self, edges: Sequence[int]) -> Cut:
        """Eq: ORD-3"""
        n, models = len(edges) - 1, [self.model(*pair) for pair in pairwise(edges)]
        p = n * self.n_parameters + n - 1
        return Cut(
            n_pieces=n,
            cost=float(sum(model.cost for model in models)),
            cost_expected=float(sum(model.cost_expected for model in models)),
            mdl=float(self.total(edges) + p / 2 * np.log(2 * len(self.f_hz))),
        )
