"""Search for an order with the total variance of the best linear approximation (EST-16).

By the noise alone every pole that follows the distortion is significant. With the total variance it is not,
if the error that a linear model is allowed, the correlation of what it leaves, and the number of frequencies
that a mode is the best of are counted as well, as for structures (STR-4).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from gsid.base.bands import in_band
from gsid.base.errors import GsidError
from gsid.fitting.rational import fit
from gsid.fitting.roots import Doubtful, doubtful
from gsid.fitting.sandwich import CORRELATION_MAX, correlation_of
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf
from gsid.response.with_distortion import weighted_by_total

FIRST_ERROR, ERROR_MAX, SMOOTH_ERROR = 0.03, 0.25, 0.2
"""Error that a linear model is allowed over the response: at the start, at most, and where the phases are
smooth, so that the excitation hides its distortion."""
N_ROUNDS = 3
"""Repetitions of allowed error and search: most reach a fixed point in two."""
PATIENCE = 2
"""Orders without a better score that end the upward search."""
ODDS = float(np.log(1000.0))
"""Difference of scores [nats] within which orders are equal: odds of 1000 to 1."""
FLAT = 0.5
"""Ratio of the costs of two orders above which the higher one does not explain what is left."""
N_STEPS = 4
"""Searches for neighbours of the best order."""


@dataclass(frozen=True, eq=False)
class Scored:
    """An order, fitted and scored.

    Attributes
    ----------
    order : str
    model : RationalModel
    score : float
        V + L [p/2 ln(2 F/L) + n ln(F/L)].
    doubts : list of Doubtful
        Reasons to avoid it.
    """

    order: str
    model: RationalModel
    score: float
    doubts: list[Doubtful]


class Search:
    """Orders of one response, which is weighted with its total variance.

    Parameters
    ----------
    frf : Frf
        With `var_total`.
    band : (lo, hi) or None
    options : dict
        Further arguments of `gsid.fit`.
    poles_max : int

    Attributes
    ----------
    relative_error, correlation : float
        Allowed error of the linear model, and lines that count as one.
    found : list of Scored
        In the order in which they were tried.
    """

    def __init__(self, frf: Frf, band: tuple[float, float] | None, options: dict, poles_max: int) -> None:
        self.frf, self.band, self.poles_max = frf, band, poles_max
        self.options = {**options, "method": "ml", "band": band, "quiet": True}
        self.lines = frf.at(in_band(frf.f_hz, band))
        self.relative_error = SMOOTH_ERROR if frf.smooth_phases else FIRST_ERROR
        self.correlation = CORRELATION_MAX if frf.smooth_phases else 1.0
        self.found: list[Scored] = []
        self.starts: dict[str, RationalModel] = {}

    def run(self) -> Scored:
        """Alternate the search and the allowed error until both stay.

        Raises
        ------
        ValueError
            No order gives a stable model.
        """
        before = None
        for n_round in range(N_ROUNDS):
            chosen = self._round()
            self.options["hold"] = chosen.model.hold if self.options.get("domain", "s") == "s" else None
            if self.frf.smooth_phases or n_round == N_ROUNDS - 1:
                break
            error = self._allowed(chosen)
            self.correlation = self._correlation(chosen)
            stays = abs(error - self.relative_error) <= 0.1 * max(error, 1e-3)
            if before == chosen.order and stays:
                break
            self.relative_error, before = error, chosen.order
        return chosen

    def _round(self) -> Scored:
        self.starts = {one.order: one.model for one in self.found}
        self.found = []
        self._try(((n, n - 1) for n in range(1, self.poles_max + 1)), until_worse=True)
        if not self.found:
            raise ValueError("none of the orders tried gives a stable model")
        for _ in range(N_STEPS):
            n_before = len(self.found)
            least = min(self.found, key=lambda one: one.score)
            for one in {least.order: least, self._choose().order: self._choose()}.values():
                n, m = one.model.n_poles, one.model.n_zeros
                self._try([(n, m - 1), (n, m - 2), (n - 1, m - 1), (n - 2, m - 2)])
            if len(self.found) == n_before:
                break
        return self._choose()

    def _try(self, orders: Iterable[tuple[int, int]], until_worse: bool = False) -> None:
        response = weighted_by_total(self.frf, self.relative_error)
        known = {one.order for one in self.found}
        for n, m in orders:
            order = f"{n}/{m}"
            if n < 1 or m < 0 or order in known:
                continue
            try:
                model = fit(response, order, start=self.starts.get(order), **self.options)
            except (GsidError, ValueError) as error:
                if isinstance(error, ValueError) and n == 1:
                    raise
                continue
            doubts = doubtful(model, self.lines.f_hz, small_pairs=True)
            self.found.append(Scored(order, model, self._score(model), doubts))
            least = int(np.argmin([one.score for one in self.found]))
            if until_worse and len(self.found) - 1 - least >= PATIENCE:
                return

    def _score(self, model: RationalModel) -> float:
        """Eq: EST-16"""
        effective = model.n_lines / self.correlation
        pairs = [p for p in model.poles if p.imag > 0]
        price = model.n_parameters / 2 * np.log(2 * effective) + len(pairs) * np.log(effective)
        return float(model.cost + self.correlation * price)

    def _choose(self) -> Scored:
        """Fewest parameters within the odds of the best, those without doubtful roots if there are any."""
        sound: Sequence[Scored] = [one for one in self.found if not one.doubts] or self.found
        least = min(one.score for one in sound)
        likely = [one for one in sound if one.score <= least + ODDS]
        fewest = min(one.model.n_parameters for one in likely)
        return min((one for one in likely if one.model.n_parameters == fewest), key=lambda one: one.score)

    def _allowed(self, chosen: Scored) -> float:
        """Error of the linear model at which it leaves what is expected."""
        from gsid.response.total_variance import response_level

        assert self.lines.var_total is not None
        rest2 = np.abs(self.lines.g - chosen.model.response(self.lines.f_hz)) ** 2
        level, expected = response_level(self.lines.g), len(rest2) - chosen.model.n_parameters / 2

        def excess(error: float) -> float:
            return float(np.sum(rest2 / (self.lines.var_total + error**2 * level)) - expected)

        if excess(0.0) <= 0:
            return 0.0
        return ERROR_MAX if excess(ERROR_MAX) > 0 else float(brentq(excess, 0.0, ERROR_MAX, xtol=1e-7))

    def is_linear(self, chosen: Scored) -> bool:
        """Whether the noise alone explains what is left at the chosen order or a higher one.

        The total variance is too large where a local model does not follow a narrow resonance.
        """
        noise = replace(self.frf, var_total=None)
        n, m = chosen.model.n_poles, chosen.model.n_zeros
        least, n_flat = np.inf, 0
        for order in [(n, m), *((k, k - 1) for k in range(n + 1, self.poles_max + 1))]:
            try:
                model = fit(noise, order, **self.options)
            except (GsidError, ValueError):
                continue
            ratio = next((w.cost_per_dof for w in model.warnings if w.what == "excess_cost"), None)
            if ratio is None:
                return True
            n_flat = n_flat + 1 if ratio > FLAT * least else 0
            least = min(least, ratio)
            if n_flat == PATIENCE:
                return False
        return False

    def _correlation(self, chosen: Scored) -> float:
        variance = weighted_by_total(self.lines, self.relative_error).var_g
        error = (self.lines.g - chosen.model.response(self.lines.f_hz)) / np.sqrt(variance)
        return min(correlation_of(error), CORRELATION_MAX)
