"""Likely structures compared with dry friction along the measured motion (STR-6).

Friction of a fifth of the drive leaves errors of a third of the response at low frequencies. They hide a
spring below which only a few lines lie. Most of these errors are known: the direction of the measured motion
gives the friction torque but for its level. With that torque as a further column the bodies differ where the
best linear approximation does not decide between them. Lags and modes are not compared: their effect is
smaller than the errors of the measured direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import brentq

from gsid._lib import check, ffi, lib
from gsid.base.deadline import Deadline
from gsid.fitting.sandwich import correlation_of
from gsid.response.total_variance import TotalVariance
from gsid.spectrum.realisation import Realisation
from gsid.structure.elements import INTEGRATIONS, Lines, columns
from gsid.structure.held_sensor import Measurement
from gsid.structure.projection import Data, Fitted, refine
from gsid.structure.select import Candidate, Selection, price, simplest
from gsid.structure.settings import StructureSettings

FIRST_LEFT = 0.3
"""Standard deviation with friction over that without, to begin with."""
LEFT_MIN = 1e-3
"""Least value of it in the iteration; the scores have `StructureSettings.friction_left`."""
IMPROVED, PATIENCE = 0.05, 6
"""Least relative decrease of it that counts, and rounds without one that end the comparison."""


def with_friction(
    selection: Selection, measured: TotalVariance, source: Measurement, deadline: Deadline | None = None
) -> Selection:
    """Choose between the likely structures with dry friction, where the records show it.

    Parameters
    ----------
    selection : Selection
    measured : TotalVariance
    source : Measurement
        The records that it was estimated from.
    deadline : Deadline, optional
        Time at which the comparison ends with its best round so far.

    Returns
    -------
    Selection
        With the same fits to the best linear approximation. The same selection where nothing is left to
        decide, the records show no dry friction, or the motion is not known: in a closed loop, with single
        periods, behind a sensor that is sampled and held. With smooth phases the comparison has no measure
        of what friction leaves.
    """
    has_motion = source.has_periods and measured.sensor_rate_hz is None and not measured.smooth_phases
    is_open = len(rivals(selection)) > 1 and selection.represents and selection.complete
    if not (has_motion and is_open):
        return selection
    parts = source.realisations()
    if min(part.n_periods for part in parts) < 2:
        return selection
    compared = _Comparison(selection, measured, parts)
    compared.run(deadline or Deadline())
    if not compared.shows_friction():
        return selection
    return compared.decided()


def rivals(selection: Selection) -> list[Candidate]:
    """The likely structures that differ from the chosen one in the body only, with it.

    Parameters
    ----------
    selection : Selection
    """
    body = selection.chosen.structure.body
    return [
        one for one in selection.likely if replace(one.structure, body=body) == selection.chosen.structure
    ]


class _Comparison:
    """Structures that differ from the chosen one in the body only: friction acts on it and hides it."""

    def __init__(self, selection: Selection, measured: TotalVariance, parts: list[Realisation]) -> None:
        self.selection, self.measured, self.settings = selection, measured, selection.settings
        self.variance = 1 / selection.data.weight**2
        held = selection.data.lines.held
        self.records = [_Record.of(part, measured, held, selection.settings) for part in parts]
        self.left, self.correlation = FIRST_LEFT, 1.0
        self.candidates = rivals(selection)
        self.fits = [one.fitted for one in self.candidates]
        self.unusual = [one.score - self._score(one.fitted, selection.correlation) for one in self.candidates]
        self.torques = [self._torque(one, 0.0) for one in self.fits]

    def run(self, deadline: Deadline) -> None:
        """Alternate fits, motion, and what friction leaves of the variance.

        Each structure keeps the torque beside which it leaves the least, as they do not converge together.
        """
        least, since = [math.inf] * len(self.fits), 0
        kept = list(self.torques)
        for _ in range(self.settings.friction_rounds):
            self._fit()
            since += 1
            left = [self._left(one) for one in range(len(self.fits))]
            for i in np.flatnonzero(np.array(left) < (1 - IMPROVED) * np.array(least)):
                least[i], kept[i], since = left[i], self.torques[i], 0
            self.left = left[self.best]
            error = self.fits[self.best].error(self.data[self.best])
            self.correlation = min(correlation_of(error), self.settings.correlation_max)
            if since == PATIENCE or deadline.is_over:
                break
            self.torques = [self._torque(one, max(one.gains[-1], 0.0)) for one in self.fits]
        self.left = max(min(least), self.settings.friction_left)
        self._fit_beside_each(kept)

    def shows_friction(self) -> bool:
        """Whether the best fit has friction that the errors without it show."""
        best, data = self.fits[self.best], self.data[self.best]
        drop = refine(best.values, replace(data, lines=replace(data.lines, torque=None))).cost - best.cost
        own = self.correlation / 2 * math.log(2 * len(self.measured) / self.correlation)
        return self._level(best) > 0 and drop > self.settings.odds + own

    def decided(self) -> Selection:
        """The likely structures, with the scores that friction gives their bodies."""
        shift = {
            one.structure.body: new - one.score for one, new in zip(self.candidates, self.scores, strict=True)
        }
        of_others = shift[self.selection.chosen.structure.body]
        likely = [
            replace(one, score=float(one.score + shift.get(one.structure.body, of_others)))
            for one in self.selection.likely
        ]
        likely.sort(key=lambda one: one.score)
        likely = [one for one in likely if one.score <= likely[0].score + self.settings.odds]
        level = self._level(self.fits[self.best])
        return replace(self.selection, chosen=simplest(likely), likely=likely, friction=level)

    @property
    def best(self) -> int:
        """Number of the structure of the best score."""
        return int(np.argmin(self.scores))

    def _fit(self) -> None:
        """Fit all structures with their torques."""
        weight = 1 / np.sqrt(self._variance_of(self.left))
        lines, g = self.selection.data.lines, self.measured.g
        self.data = [Data(replace(lines, torque=torque), g, weight) for torque in self.torques]
        self.fits = [refine(one.values, data) for one, data in zip(self.fits, self.data, strict=True)]
        both = zip(self.fits, self.unusual, strict=True)
        self.scores = [self._score(one, self.correlation) + unusual for one, unusual in both]

    def _score(self, fitted: Fitted, correlation: float) -> float:
        """Without the odds against unusual axes."""
        return fitted.cost + price(fitted.structure, len(self.measured), correlation)

    def _fit_beside_each(self, torques: list[np.ndarray]) -> None:
        """Fit each structure beside the torque of its best score.

        A body that has another one as its limit is then not better by the errors of its own motion.
        """
        results = []
        for torque in torques:
            self.torques = [torque] * len(self.fits)
            self._fit()
            results.append(list(zip(self.scores, self.fits, self.data, strict=True)))
        best = [min(of_one, key=lambda each: each[0]) for of_one in zip(*results, strict=True)]
        self.scores, self.fits, self.data = (list(each) for each in zip(*best, strict=True))

    def _variance_of(self, left: float) -> np.ndarray:
        return self.measured.var_noise + left**2 * self.variance

    def _left(self, number: int) -> float:
        """Share of the standard deviation at which a structure leaves what is expected."""
        fitted, data = self.fits[number], self.data[number]
        rest2 = np.abs(self.measured.g - fitted.response(data.lines)) ** 2
        expected = len(rest2) - (fitted.structure.n_parameters + 1) / 2

        def excess(left: float) -> float:
            return float(np.sum(rest2 / self._variance_of(left)) - expected)

        if excess(1.0) > 0:
            return 1.0
        return LEFT_MIN if excess(LEFT_MIN) < 0 else brentq(excess, LEFT_MIN, 1.0, xtol=1e-4)

    def _level(self, fitted: Fitted) -> float:
        """Friction in the unit of the command."""
        return float(fitted.gains[-1] / fitted.gains[0])

    def _torque(self, fitted: Fitted, level: float) -> np.ndarray:
        """Torque of unit friction along the motion over the command, mean over realisations.  Eq: STR-6"""
        line, total = self.measured.line, np.zeros(len(self.measured), complex)
        for record, share in zip(self.records, self.measured.share, strict=True):
            used = share > 0
            torque = record.friction(fitted, level)[line[used]]
            total[used] += share[used] * torque / record.u[line[used] - 1]
        return total


@dataclass(frozen=True, eq=False)
class _Record:
    """Mean period of a realisation on lines 1 .. K, with what its motion needs.

    Attributes
    ----------
    lines : Lines
    u, y : (K,) complex
    variance : (K,) ndarray
        Of y.
    n, step_s
        Samples of the motion and their distance [s].
    stuck : float
        Rate below which the axis may stick, in standard deviations.
    """

    lines: Lines
    u: np.ndarray
    y: np.ndarray
    variance: np.ndarray
    n: int
    step_s: float
    stuck: float

    @classmethod
    def of(
        cls, part: Realisation, measured: TotalVariance, held: bool, settings: StructureSettings
    ) -> _Record:
        n_period, fs_hz = part.period_samples, part.fs_hz
        top = min(math.ceil(settings.motion_band * measured.line[-1]), (n_period - 1) // 2)
        line = np.arange(1, top + 1)
        each = part.output(line)
        n = next_fast_len(math.ceil(settings.motion_samples * top), real=True)
        return cls(
            Lines(line * (fs_hz / n_period), fs_hz, held),
            part.input(line).mean(axis=0),
            each.mean(axis=0),
            each.var(axis=0, ddof=1) / len(each),
            n,
            n_period / fs_hz / n,
            settings.stuck,
        )

    def friction(self, fitted: Fitted, level: float) -> np.ndarray:
        """Lines 0 .. of a unit of friction along the motion, complex.

        Where the axis may stick, friction is the torque that holds it.

        Parameters
        ----------
        fitted : Fitted
            Gives the part of the modes, the lags, and the torques on the body.
        level : float
            Of the friction, over the inertia; 0: the axis does not stick.
        """
        rate, rate_std = self._rate(fitted)
        w, acceleration = self._signal(rate), self._signal(self.lines.s * rate)
        side = np.empty(self.n)
        doubles = [ffi.from_buffer("double[]", x) for x in (w, acceleration, side)]
        check(lib.gsid_law_side(self.n, self.step_s, *doubles), "direction of the motion")
        if level > 0:
            held = np.clip(self._signal(self._torque_on_body(fitted, rate)) / level, -1, 1)
            side = np.where(np.abs(w) < self.stuck * rate_std, held, side)
        return rfft(side) * (2 / self.n)

    def _rate(self, fitted: Fitted) -> tuple[np.ndarray, float]:
        """Lines of the body's rate, and the standard deviation of its noise."""
        values, structure = fitted.values, fitted.structure
        modes = columns(values, self.lines)[:, 1:] @ fitted.gains[1 : structure.n_columns]
        sensor = self.lines.s ** -INTEGRATIONS[structure.output] * (1 + 0j)
        for tau in values.lags:
            sensor = sensor / (1 + tau * self.lines.s)
        power = np.abs(self.y) ** 2
        wiener = np.maximum(0.0, 1 - self.variance / np.where(power > 0, power, np.inf))
        rate_std = math.sqrt(np.sum(self.variance * (wiener / np.abs(sensor)) ** 2) / 2)
        return wiener * (self.y - modes * self.u) / sensor, rate_std

    def _torque_on_body(self, fitted: Fitted, rate: np.ndarray) -> np.ndarray:
        """Lines of the torques but for inertia and friction, over the inertia: what friction has to hold."""
        s, values = self.lines.s, fitted.values
        drive = fitted.gains[0] * np.exp(-s * values.delay_s) * self.lines.hold * self.u
        return drive - (values.rate + values.stiffness / s) * rate

    def _signal(self, amplitude: np.ndarray) -> np.ndarray:
        """Samples of a period from its lines 1 .. K, (n,)."""
        spectrum = np.zeros(self.n // 2 + 1, complex)
        spectrum[1 : len(amplitude) + 1] = amplitude
        return irfft(spectrum, self.n) * (self.n / 2)
