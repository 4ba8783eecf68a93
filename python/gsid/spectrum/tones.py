"""Detect sines in noise with a stated false-alarm rate, fit them between the bins, and subtract them.

The strongest peak of the periodogram is compared with the noise around it (NOI-1). If noise does not explain
it, a sine is fitted by least squares (NOI-2) and subtracted. This is repeated until only noise remains. In an
excited record the mean period is subtracted first, from the record and from the sines. A disturbance at a
line of the period cannot be distinguished from the response; disturbances at other frequencies can.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.special import gammaln

_log = logging.getLogger(__name__)

MAX_TONES = 64
LEAST_PEAK = 4.0  # times the noise around it: a lower peak counts as noise
GUARD = 2  # bins on each side of a peak that contain its leakage
N_SIDE = 16  # bins on each side, outside the guard, that give the noise level
FEWEST_SIDE = 4  # closer to 0 Hz there are fewer bins, and sines are not searched for
FINE = 4  # points of the periodogram per bin
OFF_LINE = 0.5  # bins from a line of the period within which sines are not searched for
CLOSEST = 0.2  # bins from such a line within which the fit cannot separate a sine from the response
HARMONIC_STD = 3.0  # standard deviations within which a frequency is a multiple of another
HARMONIC_BINS = 0.01  # bins within which it is a multiple in any case: the numerical error without noise
BY_CHANCE = 0.01  # largest probability that an unrelated frequency is this close to a multiple
MAX_STEPS = 20
ROUNDING = 1e-12  # of the signal: what is smaller comes from rounding
CONVERGED = 0.01  # last step, in standard deviations of the frequency
NEGLIGIBLE = 0.1  # effect of a sine on the fits of others, in standard deviations of the amplitude


@dataclass(frozen=True)
class Tone:
    """A periodic disturbance: amplitude cos(2 pi f t + phase), t from the record's first sample.

    Attributes
    ----------
    f_hz, std_f_hz : float
        Frequency [Hz] and its standard deviation (the Cramer-Rao bound, NOI-2).
    amplitude, std_amplitude : float
        Unit of the signal.
    phase_rad : float
    p_value : float
        Probability that noise alone shows such a peak anywhere in the record (NOI-1).
    order, base_hz : int, float
        The frequency is `order` times `base_hz`, the frequency of another disturbance. Order 1: no harmonic.
    image_of_hz : float
        Frequency of the disturbance whose image this is, behind a sensor with a refresh rate; 0: of none.
    """

    f_hz: float
    std_f_hz: float
    amplitude: float
    std_amplitude: float
    phase_rad: float
    p_value: float
    order: int = 1
    base_hz: float = 0.0
    image_of_hz: float = 0.0

    @property
    def name(self) -> str:
        """The frequency as text, for example "61.8 Hz (2 x 30.9 Hz)" or "369.1 Hz (image of 30.9 Hz)"."""
        text = f"{_digits(self.f_hz, self.std_f_hz)} Hz"
        if self.image_of_hz:
            return f"{text} (image of {_digits(self.image_of_hz, self.std_f_hz)} Hz)"
        return (
            text if self.order == 1 else f"{text} ({self.order} x {_digits(self.base_hz, self.std_f_hz)} Hz)"
        )

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Samples of the disturbance at the times t_s, (n,) [s]."""
        return self.amplitude * np.cos(2 * np.pi * self.f_hz * t_s + self.phase_rad)


def _digits(value: float, std: float) -> str:
    """Print as many decimals as the standard deviation justifies, at least two."""
    decimals = int(np.clip(np.ceil(-np.log10(std)), 2, 6)) if std > 0 else 6
    return f"{value:.{decimals}f}"


def n_subtracted(valid: np.ndarray, period: int) -> int:
    """Degrees of freedom of the mean period that `Residual` subtracts; with period 0, of mean and trend."""
    return np.count_nonzero(valid.reshape(-1, period).any(axis=0)) if period else 2


class Residual:
    """Residual of a signal after subtracting its mean and trend, or its mean period.

    Parameters
    ----------
    valid : (n,) bool
        False: the sample was lost. It is 0 in the residual.
    period : int
        N; 0: there is no excitation, and mean and trend are subtracted.
    """

    def __init__(self, valid: np.ndarray, period: int) -> None:
        self._weight, self._period = valid.astype(float), period
        self._spacing = len(valid) // period if period else 0
        self._n_free = np.count_nonzero(valid) - n_subtracted(valid, period)
        self._count = (
            np.maximum(self._weight.reshape(-1, period).sum(axis=0), 1) if period else self._weight.sum()
        )
        if not period:
            t = np.linspace(-1, 1, len(valid))
            t = (t - self._weight @ t / self._count) * self._weight
            self._trend = t / np.linalg.norm(t)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Compute the residual of x, (n,) -> (n,)."""
        x = x * self._weight
        if self._period:
            rows = x.reshape(-1, self._period)
            return ((rows - rows.sum(axis=0) / self._count).ravel()) * self._weight
        x = x - (x.sum() / self._count) * self._weight
        return x - (self._trend @ x) * self._trend

    def variance(self, power: float) -> float:
        """Variance of white noise whose periodogram has this power, away from the lines of the period."""
        off_lines = 1 - (self._period or 2) / len(
            self._weight
        )  # share of the bins that the subtraction left unchanged
        return power * off_lines / self._n_free

    def away_from_lines(self, bins: float) -> float:
        """Return the nearest position that is not too close to a line of the period."""
        if not self._spacing:
            return bins
        line = self._spacing * round(bins / self._spacing)
        return line + float(np.copysign(max(abs(bins - line), CLOSEST), bins - line))


def find_tones(
    x: np.ndarray, fs_hz: float, *, valid: np.ndarray | None = None, period: int = 0, alpha: float = 0.01
) -> tuple[list[Tone], np.ndarray]:
    """Detect the sines in a signal, the strongest first.

    Parameters
    ----------
    x : (n,) float
        Signal; with `period`, a whole number of periods.
    fs_hz : float
    valid : (n,) bool, optional
        False: the sample was lost.
    period : int
        Period of the excitation in samples; its lines are not disturbances. 0: there is no excitation.
    alpha : float
        Probability of detecting any sine in noise that has none.

    Returns
    -------
    tones : list of Tone
        Phases count from x[0].
    residual : (n,) float
        The residual noise, 0 for lost samples.
    """
    n = len(x)
    residual_of = Residual(np.ones(n, bool) if valid is None else np.asarray(valid, bool), period)
    residual = residual_of(np.asarray(x, float))
    noise_floor = _NoiseFloor(n, n // period if period else 0)
    found: list[_Sine] = []
    power = residual @ residual
    while len(found) < MAX_TONES:
        peak = _strongest(residual, noise_floor)
        if peak is None or peak.p_value > alpha or residual @ residual < ROUNDING**2 * power:
            break
        found.append(_fitted(_Sine(peak.bins, 0.0, 0.0, peak.p_value), residual, residual_of))
        residual = residual - residual_of(found[-1].samples(n))
        residual = _fit_again(found, residual, residual_of, peak.std_amplitude)
    else:
        _log.warning("%d periodic disturbances found, which is the limit: there are more", MAX_TONES)
    floor = noise_floor.mean(_periodogram(residual))
    tones = [_tone(sine, residual_of, floor, noise_floor.n_around, fs_hz, n) for sine in found]
    return _harmonics(sorted(tones, key=lambda tone: -tone.amplitude), fs_hz / n), residual


# ---------------------------------------------------------------- the test


@dataclass(frozen=True)
class _Peak:
    bins: float
    p_value: float
    std_amplitude: float  # of a sine in the noise around it


class _NoiseFloor:
    """Noise level around each point of the periodogram of a record of n samples.

    Attributes
    ----------
    n_around : (F,)
        Number of bins that the mean is taken over; 0: the point is not searched.
    leak : (F,)
        Share of the power of a sine that leaks into that mean.
    n_bins : float
        Number of bins that are searched.

    Notes
    -----
    Points between the bins are included, because the leakage of the record's ends differs there.
    """

    def __init__(self, n: int, spacing: int) -> None:
        k = np.arange(FINE * n // 2 + 1)
        self._usable = (k >= FINE) & (2 * k <= FINE * (n - 2))
        if spacing:
            off = np.abs(k - FINE * spacing * np.round(k / (FINE * spacing)))
            self._usable &= off > FINE * OFF_LINE
        last, guard = len(k) - 1, FINE * GUARD
        # the same number on both sides, since the noise spectrum has a slope
        n_side = np.clip(np.minimum(k, last - k) - guard - 1, 0, FINE * N_SIDE)
        self._outer = np.maximum(k - guard - n_side, 0), np.minimum(k + guard + n_side, last) + 1
        self._inner = np.maximum(k - guard, 0), np.minimum(k + guard, last) + 1
        self._n_points = self._around(self._usable)
        fewest = FINE * FEWEST_SIDE
        searched = self._usable & (n_side >= fewest) & (self._n_points >= fewest)
        self.n_around = np.where(searched, self._n_points / FINE, 0)
        self.n_bins = np.count_nonzero(searched) / FINE
        leakage = np.sinc(np.arange(guard + 1, guard + FINE * N_SIDE + 1) / FINE) ** 2
        self.leak = np.concatenate(([0.0], np.cumsum(leakage) / np.arange(1, len(leakage) + 1)))[n_side]

    def _around(self, values: np.ndarray) -> np.ndarray:
        total = np.concatenate(([0], np.cumsum(values)))
        low, high = self._outer
        inner_low, inner_high = self._inner
        return total[high] - total[low] - (total[inner_high] - total[inner_low])

    def mean(self, power: np.ndarray) -> np.ndarray:
        """Mean power around each point, (F,)."""
        mean = self._around(np.where(self._usable, power, 0)) / np.maximum(self._n_points, 1)
        return np.maximum(mean, np.finfo(float).tiny)


def _periodogram(residual: np.ndarray) -> np.ndarray:
    """Power at FINE points per bin, from 0 Hz."""
    return np.abs(fft.rfft(residual, FINE * len(residual))) ** 2


def _strongest(residual: np.ndarray, noise_floor: _NoiseFloor) -> _Peak | None:
    """Most significant peak of the periodogram, located between the bins (NOI-1)."""
    power = _periodogram(residual)
    floor = noise_floor.mean(power)
    is_peak = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]) & (noise_floor.n_around[1:-1] > 0)
    at = np.flatnonzero(is_peak & (power[1:-1] > LEAST_PEAK * floor[1:-1])) + 1
    if not len(at):
        return None
    place, height = _vertex(power, at)
    leakage = height * noise_floor.leak[at]  # of the peak itself
    noise = np.maximum(floor[at] - leakage, 0.01 * floor[at])
    p = false_alarm(height / noise, noise_floor.n_around[at], noise_floor.n_bins)
    best = int(np.argmin(p))
    return _Peak(float(place[best] / FINE), float(p[best]), float(np.sqrt(2 * noise[best])) / len(residual))


def _vertex(power: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertex (position, height) of a parabola through the logarithms of each maximum and its neighbours."""
    tiny = np.finfo(float).tiny
    left, middle, right = (np.log(np.maximum(power[at + i], tiny)) for i in (-1, 0, 1))
    bend = left - 2 * middle + right
    shift = np.where(bend < 0, (left - right) / (2 * np.minimum(bend, -tiny)), 0)
    return at + shift, np.exp(middle - (left - right) * shift / 4)


def false_alarm(ratio: np.ndarray, n_around: np.ndarray, n_bins: float) -> np.ndarray:
    """Probability of a peak this high anywhere, in noise without sines (NOI-1).

    Parameters
    ----------
    ratio : (F,) float
        Height of the peak over the mean power of the bins around it.
    n_around : (F,) float
        Number of those bins.
    n_bins : float
        Number of bins searched.

    Returns
    -------
    (F,) float, at most 1
    """
    ratio, m = np.asarray(ratio, float), np.asarray(n_around, float)
    log_p = (
        np.log(n_bins * np.sqrt(np.pi / 3))
        + 0.5 * np.log(np.maximum(ratio, np.finfo(float).tiny) / m)
        + gammaln(m + 0.5)
        - gammaln(m)
        - (m + 0.5) * np.log1p(ratio / m)
    )
    return np.minimum(np.exp(log_p), 1)


# ---------------------------------------------------------------- the fit


@dataclass(frozen=True)
class _Sine:
    """a cos + b sin of 2 pi bins (i - middle)/n: errors of frequency and mid-record phase are independent."""

    bins: float
    a: float
    b: float
    p_value: float
    spread_bins: float = 0.0  # standard deviations in noise of unit variance
    spread_amplitude: float = 0.0

    @property
    def amplitude(self) -> float:
        return float(np.hypot(self.a, self.b))

    def samples(self, n: int) -> np.ndarray:
        angle = (2 * np.pi * self.bins / n) * _from_middle(n)
        return self.a * np.cos(angle) + self.b * np.sin(angle)


def _from_middle(n: int) -> np.ndarray:
    return np.arange(n) - (n - 1) / 2


def _fitted(sine: _Sine, residual: np.ndarray, residual_of: Residual) -> _Sine:
    """Fit amplitude, phase and frequency by least squares with Gauss-Newton steps (NOI-2)."""
    n = len(residual)
    per_bin = (2 * np.pi / n) * _from_middle(n)
    for _ in range(MAX_STEPS):
        angle = sine.bins * per_bin
        cos, sin = np.cos(angle), np.sin(angle)
        basis = np.column_stack([residual_of(cos), residual_of(sin)])
        normal, right = basis.T @ basis, basis.T @ residual
        a, b = np.linalg.solve(normal, right)
        slope = residual_of((b * cos - a * sin) * per_bin)
        across = slope @ basis
        curvature = slope @ slope - across @ np.linalg.solve(normal, across)
        # at most half a bin: the next minimum is one bin away
        step = float(np.clip((slope @ residual - across @ np.array([a, b])) / curvature, -0.5, 0.5))
        bins, along = residual_of.away_from_lines(sine.bins + step), np.array([a, b]) / np.hypot(a, b)
        # the errors of amplitude and frequency are independent, except next to a subtracted line
        coupling = along @ np.linalg.solve(normal, across)
        var_amplitude = along @ np.linalg.solve(normal, along) + coupling**2 / curvature
        spread = 1 / np.sqrt(curvature), np.sqrt(var_amplitude)
        moved = abs(bins - sine.bins)
        sine = _Sine(bins, float(a), float(b), sine.p_value, *map(float, spread))
        if moved < CONVERGED * spread[0] * np.sqrt(
            max(residual @ residual - right @ np.array([a, b]), 0) / n
        ):
            break
    return sine


def _fit_again(
    found: list[_Sine], residual: np.ndarray, residual_of: Residual, std_amplitude: float
) -> np.ndarray:
    """Refit the newest sine and those it leaks into, until no fit moves by a tenth of its error.

    Updates `found`, and returns the residual.
    """
    n, new = len(residual), found[-1]
    near = [
        i
        for i, s in enumerate(found[:-1])
        if new.amplitude > NEGLIGIBLE * std_amplitude * np.pi * abs(s.bins - new.bins)
    ]
    for _ in range(MAX_STEPS if near else 0):
        moved = 0.0
        for i in [*near, len(found) - 1]:
            old = found[i]
            residual = residual + residual_of(old.samples(n))
            found[i] = _fitted(old, residual, residual_of)
            residual = residual - residual_of(found[i].samples(n))
            moved = max(moved, abs(complex(found[i].a - old.a, found[i].b - old.b)))
        if moved < NEGLIGIBLE * std_amplitude:
            break
    return residual


def _tone(
    sine: _Sine, residual_of: Residual, floor: np.ndarray, n_around: np.ndarray, fs_hz: float, n: int
) -> Tone:
    nearest = min(round(FINE * sine.bins), len(floor) - 1)
    while nearest + 1 < len(floor) and not n_around[nearest]:  # next to a line of the excitation
        nearest += 1
    variance = residual_of.variance(floor[nearest])  # as if the noise around the sine were white
    middle_angle = 2 * np.pi * sine.bins / n * (n - 1) / 2
    phase = np.arctan2(-sine.b, sine.a) - middle_angle
    return Tone(
        f_hz=sine.bins * fs_hz / n,
        std_f_hz=float(np.sqrt(variance)) * sine.spread_bins * fs_hz / n,
        amplitude=sine.amplitude,
        std_amplitude=float(np.sqrt(variance)) * sine.spread_amplitude,
        phase_rad=float(np.angle(np.exp(1j * phase))),
        p_value=sine.p_value,
    )


def _is_multiple(tone: Tone, base: Tone, bin_hz: float) -> bool:
    order = round(tone.f_hz / base.f_hz)
    error_hz = max(HARMONIC_STD * np.hypot(tone.std_f_hz, order * base.std_f_hz), HARMONIC_BINS * bin_hz)
    by_chance = 2 * error_hz / base.f_hz  # multiples lie base.f_hz apart
    return order > 1 and by_chance < BY_CHANCE and abs(tone.f_hz - order * base.f_hz) < error_hz


def _harmonics(tones: list[Tone], bin_hz: float) -> list[Tone]:
    """Mark disturbances whose frequency is a multiple of another's, if this is unlikely by chance."""
    named = []
    for tone in tones:
        near = [other for other in tones if _is_multiple(tone, other, bin_hz)]
        if near:
            base = max(near, key=lambda other: other.amplitude)
            tone = replace(tone, order=round(tone.f_hz / base.f_hz), base_hz=base.f_hz)
        named.append(tone)
    return named
