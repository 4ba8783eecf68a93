"""Sensor that is sampled and held: its rate from the output's spectrum alone, and its response.

A sensor that is refreshed R times a second shows y(t) - lag(t) dy/dt, where the lag is a sawtooth of that
rate: images of the excited lines around R. The product of dy/dt on the lines of the fit with the output above
them, divided by its variance, has a line at R. One transform shows all rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsid.records.record import Record
from gsid.response.closed_loop import driven_by
from gsid.response.total_variance import is_one_period, unbiased_median
from gsid.spectrum.realisation import listed, spectra_of
from gsid.spectrum.spectra import Spectra

LEAST_POWER = 100.0
"""Least power of the images over that of noise, summed over the records. In 92 development trials it is
31 000 and more with such a sensor, and below 30 without one or play."""
LARGEST_SIZE = 1.5
"""Largest ratio of the images' size to that of a sensor of that rate: play has other sizes."""
LEAST_SHARE = 0.5
"""Least share of the power above the excitation that the images explain. It is 0.99 and more with such a
sensor, with and without friction, and at most 0.15 with hysteresis, whose harmonics are above the excitation
as well."""
IMAGE_PASSES, IMAGE_STEP = 5, 0.7
"""Passes that separate the excited lines from the images on them, and their relaxation: full steps diverge
at a rate near the highest line. The share is the same with 20 passes."""
HARMONICS = 4
"""Highest harmonic of a sawtooth that may be its strongest line: around the first, few images are above the
excitation."""
SAME_LAG = 1e-6
"""Samples by which lags differ that count as one: rounding."""

ROUNDING = 1e-9
"""Standard deviation over the largest line of a simulated output without noise: no sensor is so exact."""
FRACTIONS = 8
"""Parts of a sample at which images of a held command are evaluated."""


@dataclass(frozen=True, eq=False)
class MeanOutput:
    """Mean output of one record over its periods.

    Attributes
    ----------
    y : (N/2 + 1,) complex ndarray
        All lines.
    variance : (N/2 + 1,) ndarray
        Of the noise of `y`.
    top : int
        Highest line that the excitation reaches.
    fs_hz : float
    period_samples : int
        N.
    """

    y: np.ndarray
    variance: np.ndarray
    top: int
    fs_hz: float
    period_samples: int


@dataclass(frozen=True)
class Images:
    """Strongest images around a rate.

    Attributes
    ----------
    rate_hz : float
        Refresh rate of the sensor.
    statistic : float
        Power of the product at that rate over what noise has there, summed over the records.
    size : float
        Size of the images over that of a sensor with this rate.
    """

    rate_hz: float
    statistic: float
    size: float


def mean_outputs(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    reference: str | None = None,
) -> list[MeanOutput]:
    """Mean outputs of the records of two periods or more; one period has no variance.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
    period, settle : int, optional
        Samples; default: what each record states, else what its data show. Not used for Spectra.
    reference : str, optional
        Of records measured in a closed loop: the column of its reference.
    """
    several = [one for one in listed(records) if not is_one_period(one, period, settle)]
    if reference is not None:
        several = [driven_by(one, reference) for one in several]
    measured = spectra_of(several, period=period, settle=settle) if several else []
    return [_mean_output(one) for one in measured if one.n_periods > 1]


def rounding(lines: np.ndarray) -> float:
    """Least variance of a line: that of the output of a simulation without noise would be zero.

    Parameters
    ----------
    lines : (K,) complex ndarray
        Of the mean output.
    """
    return max((ROUNDING * float(np.max(np.abs(lines[1:]), initial=0.0))) ** 2, np.finfo(float).tiny)


def _mean_output(one: Spectra) -> MeanOutput:
    variance = unbiased_median(one.noise_y, one.n_periods - 1) / one.n_periods
    variance = np.maximum(variance, rounding(one.y))
    top = int(np.flatnonzero(one.excited)[-1])
    return MeanOutput(one.y, variance, top, one.fs_hz, one.period_samples)


def find_images(
    outputs: Sequence[MeanOutput], *, least_power: float = LEAST_POWER, largest_size: float = LARGEST_SIZE
) -> Images | None:
    """Rate of the strongest images; None without lines above the excitation.

    Parameters
    ----------
    outputs : sequence of MeanOutput
        Those with the period and sample rate of the first are used.
    least_power, largest_size : float
        As those of `held_rate`.
    """
    if not outputs:
        return None
    n, fs_hz = outputs[0].period_samples, outputs[0].fs_hz
    same = [one for one in outputs if (one.period_samples, one.fs_hz) == (n, fs_hz)]
    lowest = outputs[0].top + 1
    if lowest >= n // 2:
        return None
    found = [_product(one) for one in same]
    ratio = sum(np.abs(p) ** 2 / v for p, v in found)[: n // 2 + 1]

    def images(at: int) -> Images:
        size = float(np.sqrt(np.mean([np.abs(p[at]) ** 2 / v[at] ** 2 for p, v in found])))
        rate_hz, expected = _rate(at, n, fs_hz, size)
        return Images(rate_hz, float(ratio[at]), size / expected)

    strongest = images(int(np.argmax(ratio[lowest:])) + lowest)
    # The k-th harmonic of a sawtooth is as large as the first one of k times its rate.
    for divisor in range(HARMONICS, 1, -1):
        at = round(strongest.rate_hz * n / fs_hz / divisor)
        if at < lowest:
            continue
        first = images(at)
        is_line = first.rate_hz * divisor < strongest.rate_hz * (1 + 1 / at)  # not the image of a faster one
        if is_line and _is_sawtooth(first, least_power, largest_size):
            return first
    return strongest


def _is_sawtooth(images: Images, least_power: float, largest_size: float) -> bool:
    return images.statistic >= least_power and 1 / largest_size < images.size < largest_size


def held_rate(
    outputs: Sequence[MeanOutput], *, least_power: float = LEAST_POWER, largest_size: float = LARGEST_SIZE
) -> float | None:
    """Refresh rate [Hz] of a sensor that is sampled and held; None where there is no sign of it.

    Parameters
    ----------
    outputs : sequence of MeanOutput
    least_power : float
        Of the images, over that of noise.
    largest_size : float
        Ratio of the images' size to that of a sensor of that rate.
    """
    images = find_images(outputs, least_power=least_power, largest_size=largest_size)
    if images is None or not _is_sawtooth(images, least_power, largest_size):
        return None
    return images.rate_hz if _share_of_images(outputs, images.rate_hz) >= LEAST_SHARE else None


def _share_of_images(outputs: Sequence[MeanOutput], rate_hz: float) -> float:
    """Share of the output's power above the excitation, less noise, that images of the excited lines are."""
    power = left = 0.0
    for one in outputs:
        line = np.arange(len(one.y))
        above = line > one.top
        predicted = _with_images(one, (line > 0) & ~above, rate_hz)
        variance = np.maximum(one.variance, np.finfo(float).tiny)[above]
        power += float(np.sum(np.abs(one.y[above]) ** 2 / variance - 1))
        left += float(np.sum(np.abs((one.y - predicted)[above]) ** 2 / variance - 1))
    return 1 - left / power if power > 0 else 0.0


def _with_images(one: MeanOutput, excited: np.ndarray, rate_hz: float) -> np.ndarray:
    """Output of the held sensor whose excited lines, images on them included, are those measured."""
    n, fs_hz = one.period_samples, one.fs_hz
    direct = held_response(np.flatnonzero(excited) * (fs_hz / n), rate_hz, fs_hz, n)
    inverse = np.zeros(len(one.y), complex)
    inverse[excited] = np.conj(direct) / np.maximum(np.abs(direct) ** 2, 0.05)
    before_sensor = inverse * one.y
    for _ in range(IMAGE_PASSES):
        held = held_output(before_sensor, rate_hz, fs_hz, n)
        before_sensor = before_sensor + IMAGE_STEP * inverse * (one.y - held)
    return held_output(before_sensor, rate_hz, fs_hz, n)


def held_response(f_hz: np.ndarray, rate_hz: float, fs_hz: float, n_period: int) -> np.ndarray:
    """Response of a sensor that is sampled and held, without its images: mean of exp(-j w lag_n).  Eq: BLA-4

    Parameters
    ----------
    f_hz : (F,) ndarray
        Hz.
    rate_hz : float
        Refreshes per second.
    fs_hz : float
        Rate at which the sensor is read.
    n_period : int
        Samples over which the lags repeat.

    Returns
    -------
    (F,) complex ndarray
    """
    return _mean_turn(f_hz, _lags(rate_hz, fs_hz, n_period), fs_hz)


def _mean_turn(f_hz: np.ndarray, lags: np.ndarray, fs_hz: float) -> np.ndarray:
    """Mean of exp(-j w lag)."""
    different, count = np.unique(np.round(lags / SAME_LAG), return_counts=True)
    turn = np.exp(-2j * np.pi * np.outer(f_hz, different * (SAME_LAG / fs_hz)))
    return turn @ (count / len(lags))


def lag_fractions(
    f_hz: np.ndarray, rate_hz: float, fs_hz: float, n_period: int
) -> list[tuple[float, np.ndarray]]:
    """Fractions of a sample by which the sensor is refreshed early, and their share in its response.

    Images of a held command depend on the fraction of the delay only.

    Parameters
    ----------
    f_hz, rate_hz, fs_hz, n_period
        As those of `held_response`.

    Returns
    -------
    list of (float, (F,) complex ndarray)
        Fraction [samples], within an eighth of a sample, and share; the shares sum to 1.
    """
    lags = _lags(rate_hz, fs_hz, n_period)
    part = np.round((lags - np.floor(lags + SAME_LAG)) * FRACTIONS).astype(int)
    whole = held_response(f_hz, rate_hz, fs_hz, n_period)
    return [
        (j / FRACTIONS, _mean_turn(f_hz, lags[part == j], fs_hz) * (np.mean(part == j) / whole))
        for j in np.unique(part)
    ]


def held_output(y: np.ndarray, rate_hz: float, fs_hz: float, n_period: int) -> np.ndarray:
    """Lines of the output of a sensor that is sampled and held, images included.

    Parameters
    ----------
    y : (N/2 + 1,) complex ndarray
        Lines of the sensor's input.
    rate_hz, fs_hz, n_period
        As those of `held_response`.

    Returns
    -------
    (N/2 + 1,) complex ndarray
    """
    from scipy.signal import czt  # half of the import of gsid; few records are of such a sensor

    refresh = _refreshes(rate_hz, fs_hz, n_period)
    lines = 2.0 * y  # with those of negative frequency
    lines[0] /= 2
    if n_period % 2 == 0:
        lines[-1] /= 2
    turn = np.exp(2j * np.pi * fs_hz / (rate_hz * n_period))  # of the lowest line, from refresh to refresh
    values = czt(lines, int(refresh[-1]) + 1, turn).real / n_period
    return np.fft.rfft(values[refresh])


def _lags(rate_hz: float, fs_hz: float, n: int) -> np.ndarray:
    """Age of the sensor's value at each sample [samples]."""
    return np.arange(n) - _refreshes(rate_hz, fs_hz, n) * (fs_hz / rate_hz)


def _refreshes(rate_hz: float, fs_hz: float, n: int) -> np.ndarray:
    """Number of the last refresh at each sample; one falls on a sample in spite of rounding."""
    return np.floor(np.arange(n) * (rate_hz / fs_hz) + 1e-9).astype(int)


def _product(one: MeanOutput) -> tuple[np.ndarray, np.ndarray]:
    """Lines of the product, and their variance where the output has nothing but noise above the fit."""
    n = one.period_samples
    line = np.arange(len(one.y))
    low, high = (line > 0) & (line <= one.top), line > one.top
    weight = np.where(high, 1 / np.maximum(one.variance, np.finfo(float).tiny), 0.0)
    slope = np.where(low, 2j * np.pi * line * (one.fs_hz / n) * one.y, 0.0)
    product = np.fft.rfft(np.fft.irfft(slope, n) * np.fft.irfft(weight * one.y, n)) * n
    power = np.fft.rfft(np.fft.irfft(np.abs(slope) ** 2, n) * np.fft.irfft(weight, n)).real * n
    return product, np.maximum(power, np.finfo(float).eps * np.max(power))  # not below their rounding


def _rate(line: int, n: int, fs_hz: float, size: float) -> tuple[float, float]:
    """Rate whose sawtooth has a line of this size there, and its size: the line's, or that of its image."""
    rates = np.array([line, n - line]) * (fs_hz / n)
    sizes = np.array([np.abs(np.fft.fft(_lags(rate, fs_hz, n) / fs_hz)[line]) / n for rate in rates])
    best = int(np.argmin(np.abs(np.log(np.maximum(sizes, 1e-300) / size))))
    return float(rates[best]), float(max(sizes[best], 1e-300))
