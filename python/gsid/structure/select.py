"""Selection of a structure: score, allowed error of a linear model, simplest of the likely ones (STR-4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import brentq

from gsid.base.deadline import Deadline
from gsid.base.errors import InputError
from gsid.base.threads import in_parallel
from gsid.fitting.sandwich import correlation_of
from gsid.models.rational import RationalModel
from gsid.response.sample_hold import lag_fractions
from gsid.response.total_variance import TotalVariance, response_level
from gsid.structure.elements import OUTPUTS, Lines, Structure, Values
from gsid.structure.moves import moved, simpler
from gsid.structure.projection import Data, Fitted, linear_fit, refine
from gsid.structure.readings import first_error, first_fits, poles_of, readings
from gsid.structure.refusals import refusal
from gsid.structure.settings import StructureSettings

PER_STRUCTURE = 2
"""Readings of one structure that are refined."""
DEFAULTS = StructureSettings()
Fits = tuple[list[RationalModel], list[RationalModel]]
KEEP = 60.0
"""Scores above the best that is not refused by more are not refined again at the next allowed error."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted structure and its score [nats]."""

    fitted: Fitted
    score: float
    refused: str

    @property
    def structure(self) -> Structure:
        """Its elements."""
        return self.fitted.structure


@dataclass(eq=False)
class Selection:
    """Structures compared at one allowed error of the linear model.

    Attributes
    ----------
    chosen : Candidate
        The fewest parameters among those within the odds of the best.
    likely : list of Candidate
        Those, the best score first.
    relative_error : float
        eps, error that the linear model is allowed over the response.
    scale : float
        Factor on the total variance, at most 1: where the chosen structure leaves less than it, the variance
        is too large, as that of local models at resonances.
    correlation : float
        L, lines that count as one.
    data : Data
    represents : bool
        Whether the chosen structure represents the data.
    settings : StructureSettings
        Constants of the search.
    rational : list of RationalModel
        The rational fits that the search started from.
    complete : bool
        Whether the search ended before its deadline.
    friction : float or None
        Level of the dry friction that decided between the likely structures, in the unit of the command
        (`gsid.structure.friction`); None where it did not.
    """

    chosen: Candidate
    likely: list[Candidate]
    relative_error: float
    scale: float
    correlation: float
    data: Data
    represents: bool
    settings: StructureSettings
    rational: list[RationalModel] = field(default_factory=list)
    complete: bool = True
    friction: float | None = None


def select(
    measured: TotalVariance,
    hold: str,
    outputs: tuple[str, ...] = OUTPUTS,
    settings: StructureSettings = DEFAULTS,
    *,
    expected_output: str | None = None,
    deadline: Deadline | None = None,
    fits: Fits | None = None,
) -> Selection:
    """Choose the structure of an axis.

    Parameters
    ----------
    measured : TotalVariance
    hold : {"zoh", "none"}
    outputs : tuple of str
        What y may be.
    settings : StructureSettings
    expected_output : str, optional
        What y is by its unit: the others have the odds against them.
    deadline : Deadline, optional
        Time at which the search ends with the best structure so far.
    fits : tuple of two lists of RationalModel, optional
        Of `first_fits`; default: made.

    Returns
    -------
    Selection

    Raises
    ------
    OutOfTime
        The deadline was reached before any structure was fitted.
    InputError
        No structure could be fitted.
    """
    return _Search(measured, hold, outputs, settings, expected_output, deadline, fits).run()


def price(structure: Structure, n_lines: int, correlation: float) -> float:
    """L [p/2 ln(2 F/L) + n_modes ln(F/L)]: what the elements of a structure have to lower the cost by.

    Eq: STR-4

    Parameters
    ----------
    structure : Structure
    n_lines : int
    correlation : float
        L, lines that count as one.
    """
    effective = n_lines / correlation
    of_parameters = structure.n_parameters / 2 * np.log(2 * effective)
    return float(correlation * (of_parameters + structure.n_modes * np.log(effective)))


def simplest(likely: list[Candidate]) -> Candidate:
    """The fewest parameters, and the best score among those; a lag goes before modes above the band.

    Those stand at an assumed frequency, and in place of a lag that is within the odds.

    Parameters
    ----------
    likely : list of Candidate
    """
    best = min(likely, key=lambda one: (one.structure.n_parameters, one.score))
    with_lag = replace(best.structure, n_lags=best.structure.n_lags + 1, residual=False)
    return next((one for one in likely if best.structure.residual and one.structure == with_lag), best)


def rescored(
    selection: Selection,
    measured: TotalVariance,
    *,
    relative_error: float,
    correlation: float,
    scale: float,
) -> float:
    """Score of the chosen structure at another allowed error, correlation and scale of the variance.

    Parameters
    ----------
    selection : Selection
    measured : TotalVariance
    relative_error, correlation, scale : float
    """
    hold = "zoh" if selection.data.lines.held else "none"
    search = _Search(measured, hold, (selection.chosen.structure.output,), selection.settings, None)
    search.relative_error, search.correlation, search.scale = relative_error, correlation, scale
    search.weigh()
    return search.score(refine(selection.chosen.fitted.values, search.data))


class _Search:
    def __init__(
        self,
        measured: TotalVariance,
        hold: str,
        outputs: tuple[str, ...],
        settings: StructureSettings,
        expected_output: str | None,
        deadline: Deadline | None = None,
        fits: Fits | None = None,
    ) -> None:
        self.deadline, self.fits = deadline or Deadline(), fits
        self.measured, self.hold, self.outputs, self.settings = measured, hold, outputs, settings
        self.expected_output = expected_output
        self.lines = Lines(measured.f_hz, measured.fs_hz, hold == "zoh", fractions=_fractions(measured))
        self.level = response_level(measured.g)
        self.smooth = measured.smooth_phases
        self.relative_error = first_error(measured, settings)
        self.correlation = settings.correlation_max if self.smooth else 1.0
        self.scale = 1.0
        self.found: dict[Structure, Candidate] = {}
        self.rational: list[RationalModel] = []

    def run(self) -> Selection:
        """Alternate selection and allowed error until both stay."""
        seen: list[Structure] = []
        for n_round in range(self.settings.n_rounds):
            before = self.relative_error
            self.weigh()
            if n_round == 0:
                self._read_poles()
            self._move()
            chosen = self._choose()[0]
            if not self.smooth or n_round == 0:
                self._allow(chosen)
            if self.deadline.is_over:
                break
            stays = abs(self.relative_error / max(before, 1e-12) - 1) < 0.1 or self.relative_error == before
            if seen and seen[-1] == chosen.structure and stays:
                break
            seen.append(chosen.structure)
        self.weigh()
        chosen, likely = self._choose()
        cost = chosen.fitted.cost / len(self.measured)
        at_cap = self.relative_error >= 0.999 * self.settings.error_max
        represents = not chosen.refused and not (at_cap and cost > self.settings.rejected_cost)
        return Selection(
            chosen,
            likely,
            self.relative_error,
            self.scale,
            self.correlation,
            self.data,
            represents,
            self.settings,
            self.rational,
            complete=not self.deadline.is_over,
        )

    def weigh(self) -> None:
        """New weights; the structures found so far are refined again."""
        variance = self.scale * self.measured.var_total + self.relative_error**2 * self.level
        self.data = Data(self.lines, self.measured.g, 1 / np.sqrt(variance))
        before, self.found = self.found, {}
        if before:
            scores = [one.score for one in before.values() if not one.refused]
            least = min(scores or [one.score for one in before.values()])
            for one in sorted(before.values(), key=lambda c: c.score):
                if one.score < least + KEEP and not (self.found and self.deadline.is_over):
                    self._try(one.fitted.values)

    def _read_poles(self) -> None:
        """Rational fits, and the best readings of their poles."""
        fits = self.fits or first_fits(self.measured, self.settings, self.deadline)
        self.rational, models = fits[0], fits[0] + fits[1]
        band = self.lines.w[0], self.lines.w[-1]
        early_s = 0.5 / self.measured.fs_hz if self.lines.held else 0.0
        fast = replace(self.data, lines=replace(self.lines, images=False))
        read: list[tuple[float, Fitted]] = []
        for model in models:
            poles = poles_of(model, *band, early_s, self.settings)
            for values in readings(poles, self.outputs, *band, self.settings):
                one = linear_fit(values, fast)
                read.append((self.score(one), one))
        read.sort(key=lambda pair: pair[0])
        n_of: dict[Structure, int] = {}
        n_refined = 0
        for _, one in read:
            if n_of.get(one.structure, 0) < PER_STRUCTURE:
                n_of[one.structure] = n_of.get(one.structure, 0) + 1
                self._try(one.values)
                n_refined += 1
                if n_refined == self.settings.n_refined or self.deadline.is_over:
                    break
        if not self.found:
            hint = "check the records, or fit a rational model with gsid fit"
            raise InputError("no structure could be fitted", self.measured.name, None, hint)

    def _move(self) -> None:
        """Add and drop elements of the best structures until nothing improves."""
        done: list[Candidate] = []
        for _ in range(self.settings.n_steps_max):
            self._prune(done)
            ordered = self._ordered()[: self.settings.n_moved]
            todo = [one for one in ordered if not any(one is other for other in done)]
            if not todo or self.deadline.is_over:
                return
            least = ordered[0].score
            for one in todo:
                done.append(one)
                self._try_new(moved(one.fitted, self.data, self.settings), least)

    def _prune(self, done: list[Candidate]) -> None:
        """Drop elements of the structures that are refused though their score is the best."""
        while True:
            least = self._ordered()[0].score
            refused = [c for c in self.found.values() if c.refused and c.score < least + self.settings.odds]
            todo = [one for one in refused if not any(one is other for other in done)]
            if not todo or self.deadline.is_over:
                return
            one = min(todo, key=lambda c: c.score)
            done.append(one)
            self._try_new(simpler(one.fitted, self.data), least)

    def _try_new(self, several: Iterator[Values], least: float) -> None:
        """Refine values of structures that are not among the best already."""

        def is_new(values: Values) -> bool:
            known = self.found.get(values.structure)
            return known is None or bool(known.refused) or known.score > least + self.settings.odds

        def refined(values: Values) -> Fitted | None:
            return None if self.deadline.is_over else refine(values, self.data)

        todo = [values for values in several if is_new(values)]
        for values, fitted in zip(todo, in_parallel(refined, todo), strict=True):
            if fitted is not None and is_new(values):
                self._keep(fitted)

    def _try(self, values: Values) -> None:
        self._keep(refine(values, self.data))

    def _keep(self, fitted: Fitted) -> None:
        """Keep refined values if they are the best of their structure."""
        if not np.isfinite(fitted.cost):
            return
        relabelled = fitted.values.relabelled(self.settings.zeta_max)
        if relabelled is not fitted.values:
            fitted = linear_fit(relabelled, self.data)
        known = self.found.get(fitted.structure)
        refused = refusal(fitted, self.data, self.settings) or self._read_wrongly(fitted.values)
        new = Candidate(fitted, self.score(fitted), refused)
        if known is None or (bool(new.refused), new.score) < (bool(known.refused), known.score):
            self.found[fitted.structure] = new

    def _read_wrongly(self, values: Values) -> str:
        """Reason to refuse a structure that is another one in truth, unless its output is stated.

        An acceleration behind a lag that is slower than the body is the rate of a body with that friction.
        """
        is_stated = len(self.outputs) == 1 or self.expected_output == "acceleration"
        slow = values.structure.output == "acceleration" and has_slow_lag(values, self.lines)
        return "an acceleration behind a slow lag is a rate" if slow and not is_stated else ""

    def score(self, fitted: Fitted) -> float:
        """V, the price of the elements, and the odds against unusual axes."""
        structure = fitted.structure
        unusual = self.settings.slow_lag_odds * has_slow_lag(fitted.values, self.lines)
        if len(self.outputs) > 1 and structure.output == "acceleration":
            unusual += self.settings.acceleration_odds
        if len(self.outputs) > 1 and is_overdamped_angle(fitted.values):
            unusual += self.settings.overdamped_odds
        if self.expected_output not in (None, structure.output):
            unusual += self.settings.unit_odds
        return fitted.cost + price(structure, len(self.measured), self.correlation) + unusual

    def _ordered(self) -> list[Candidate]:
        """Candidates, those that are not refused first, the best score first."""
        return sorted(self.found.values(), key=lambda c: (bool(c.refused), c.score))

    def _choose(self) -> tuple[Candidate, list[Candidate]]:
        ordered = self._ordered()
        best = ordered[0]
        likely = [
            one
            for one in ordered
            if bool(one.refused) == bool(best.refused) and one.score <= best.score + self.settings.odds
        ]
        return simplest(likely), likely

    def _allow(self, chosen: Candidate) -> None:
        """Error at which the chosen structure leaves what is expected, scale of the variance, correlation."""
        settings = self.settings
        rest2 = np.abs(self.measured.g - chosen.fitted.response(self.lines)) ** 2
        size2, variance = self.level, self.measured.var_total
        expected = len(rest2) - chosen.structure.n_parameters / 2

        def excess(error: float) -> float:
            return float(np.sum(rest2 / (variance + error**2 * size2)) - expected)

        least = settings.smooth_error if self.smooth else 0.0
        self.scale, self.relative_error = 1.0, 0.0
        if excess(settings.error_max) > 0:
            self.relative_error = settings.error_max
        elif excess(0.0) > 0:
            self.relative_error = brentq(excess, 0.0, settings.error_max, xtol=1e-7)
        elif not self.smooth:
            self.scale = max(1 + excess(0.0) / expected, settings.scale_min)
        self.relative_error = max(self.relative_error, least)
        if not self.smooth:
            weighted = chosen.fitted.error(self.data)
            self.correlation = min(correlation_of(weighted), settings.correlation_max)


def _fractions(measured: TotalVariance) -> list[tuple[float, np.ndarray]] | None:
    if measured.sensor_rate_hz is None:
        return None
    rate_hz, fs_hz, n_period = measured.sensor_rate_hz, measured.fs_hz, measured.period_samples
    return lag_fractions(measured.f_hz, rate_hz, fs_hz, n_period)


def is_overdamped_angle(values: Values) -> bool:
    """Whether a structure is the angle of a spring whose two poles are real.

    Parameters
    ----------
    values : Values
    """
    structure = values.structure
    is_sprung = structure.output == "angle" and structure.body == "sprung"
    return is_sprung and values.rate**2 > 4 * values.stiffness


def has_slow_lag(values: Values, lines: Lines) -> bool:
    """Whether a lag is slower than the body: a slow real pole is friction rather than a lag.

    Parameters
    ----------
    values : Values
    lines : Lines
    """
    body = max(values.rate, np.sqrt(values.stiffness)) or np.sqrt(lines.w[0] * lines.w[-1])
    return bool(max(values.lags, default=0.0) * body > 1)
