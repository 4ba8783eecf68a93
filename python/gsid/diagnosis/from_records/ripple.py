"""Period over the position of what a law leaves: ripple of a screw, a gear or a motor.

The error of the simulated output is fitted, at each of many periods, by the sine and the cosine of the
simulated position as a torque. The error is whitened by its own level over neighbouring lines, or a slow
remainder would hide a ripple.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import rfft
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from gsid.greybox.weights import lines_used
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra

NEIGHBOURS = 61  # lines of the level: wider than the lines of one ripple, narrower than the band
TURNS_LEAST = 3.0  # periods in the travel: fewer are a spring
STEP = 1 / 3  # of a period, over the travel, between the periods that are tried
MOST = 3000  # periods tried
CHANCE = 1e-3  # of any period, where nothing repeats
STANDS_OUT = (
    20.0  # least ratio to the median of all periods: what depends on the position otherwise has no period
)


@dataclass(frozen=True)
class Ripple:
    """What repeats over the position.

    Attributes
    ----------
    period : float
        In the unit of the angle.
    unit : str
    share : float
        Share of what the law leaves, whitened, that repeats with it.
    """

    period: float
    unit: str
    share: float

    @property
    def sentence(self) -> str:
        """The period and its share as a sentence."""
        period = f"{self.period:.4g} {self.unit}"
        return f"What is left repeats over the position every {period} ({self.share:.0%} of it, whitened)."


def remaining_ripple(
    model: PlantModel, measured: Sequence[Spectra], band: tuple[float, float] | None
) -> Ripple | None:
    """The dominant period of what a model leaves, over its position; None if none exceeds the others.

    Parameters
    ----------
    model : PlantModel
        Fitted, with the law.
    measured : sequence of Spectra
    band : (lo, hi) or None
        Hz.
    """
    parts = [_Part.of(model, one, band) for one in measured]
    travel = max(float(np.ptp(part.angle)) for part in parts)
    # A finer ripple lies above the band even where the axis is slow.
    slow = max(float(np.quantile(part.moving, 0.25)) for part in parts)
    finest = max(part.highest_hz for part in parts) / slow * travel if slow > 0 else 0.0
    turns = np.arange(TURNS_LEAST, finest, STEP)[:MOST]
    if not len(turns):
        return None

    def gain(periods_in_travel: float) -> float:
        return _gain(parts, 2 * np.pi * periods_in_travel / travel)

    gains = np.array([gain(each) for each in turns])
    best = turns[int(np.argmax(gains))]
    found = minimize_scalar(lambda x: -gain(x), bounds=(best - STEP, best + STEP), method="bounded")
    total = sum(float(np.sum(np.abs(part.error) ** 2)) for part in parts)
    n = 2 * sum(len(part.error) for part in parts)
    share = -float(found.fun) / total
    # The share of two columns in n numbers of noise is exponentially distributed with a mean of 2 / n.
    if share < max(2 / n * np.log(len(turns) / CHANCE), STANDS_OUT * np.median(gains) / total):
        return None
    return Ripple(travel / float(found.x), model.angle_unit, share)


@dataclass(frozen=True, eq=False)
class _Part:
    """One record: whitened error, its response to a torque, and the motion."""

    error: np.ndarray
    entry: np.ndarray
    line: np.ndarray
    angle: np.ndarray
    moving: np.ndarray
    highest_hz: float

    @staticmethod
    def of(model: PlantModel, one: Spectra, band: tuple[float, float] | None) -> _Part:
        use = lines_used(model, one, band) & (one.line > 0)
        answer = model.predict(one)
        torque = (one.y - answer.Y)[use] / model.linear_response(one, use).torque
        level = np.sqrt(median_filter(np.abs(torque) ** 2, NEIGHBOURS, mode="nearest") / np.log(2))
        rate = np.abs(answer.rate)
        return _Part(
            error=torque / level,
            entry=1 / level,
            line=one.line[use],
            angle=answer.angle,
            moving=rate[rate > 0.01 * rate.max()],
            highest_hz=float(one.f_hz[use][-1]),
        )


def _gain(parts: Sequence[_Part], per_unit: float) -> float:
    """What the sine and the cosine of the position explain of the whitened error."""
    columns = []
    for part in parts:
        waves = np.stack([np.cos(per_unit * part.angle), np.sin(per_unit * part.angle)])
        columns.append(rfft(waves)[:, part.line] * part.entry)
    rows = np.concatenate(columns, axis=1)
    error = np.concatenate([part.error for part in parts])
    gram, right = (rows.conj() @ rows.T).real, (rows.conj() @ error).real
    return float(right @ np.linalg.lstsq(gram, right, rcond=1e-10)[0])
