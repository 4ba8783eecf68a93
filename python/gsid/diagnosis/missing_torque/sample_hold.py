"""Detection of a sensor that is sampled and held, from the output's spectrum alone.

A sensor that is refreshed R times a second shows y(t) - lag(t) dy/dt, where the lag is a sawtooth of that
rate: images of the excited lines around R. The product of dy/dt on the lines of the fit with the output above
them, divided by its variance, has a line at R. One transform shows all rates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid.diagnosis.missing_torque.linear_fit import Lines, Problem


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


def find_images(problem: Problem) -> Images | None:
    """Rate of the strongest images; None without lines above those of the fit.

    Parameters
    ----------
    problem : Problem
    """
    first = problem.records[0]
    same = [
        r
        for r in problem.records
        if (r.spectra.period_samples, r.spectra.fs_hz) == (first.spectra.period_samples, first.spectra.fs_hz)
    ]
    n, fs_hz = first.spectra.period_samples, first.spectra.fs_hz
    lowest = first.line[-1] + 1
    if lowest >= n // 2:
        return None
    found = [_product(r) for r in same]
    ratio = sum(np.abs(p) ** 2 / v for p, v in found)[lowest : n // 2 + 1]
    at = int(np.argmax(ratio)) + lowest
    size = np.sqrt(np.mean([np.abs(p[at]) ** 2 / v[at] ** 2 for p, v in found]))
    rate_hz, expected = _rate(at, n, fs_hz, float(size))
    return Images(rate_hz, float(ratio[at - lowest]), float(size / expected))


def held_rate(problem: Problem) -> float | None:
    """Refresh rate of a sensor that is sampled and held; None where there is no sign of it.

    Parameters
    ----------
    problem : Problem
    """
    images, settings = find_images(problem), problem.settings
    if images is None or images.statistic < settings.images_least:
        return None
    is_sawtooth = 1 / settings.images_size < images.size < settings.images_size
    return images.rate_hz if is_sawtooth else None


def _product(r: Lines) -> tuple[np.ndarray, np.ndarray]:
    """Lines of the product, and their variance where the output has nothing but noise above the fit."""
    n, top = r.spectra.period_samples, r.line[-1]
    line = np.arange(len(r.y))
    low, high = (line > 0) & (line <= top), line > top
    weight = np.where(high, 1 / np.maximum(r.variance, np.finfo(float).tiny), 0.0)
    slope = np.where(low, 2j * np.pi * r.spectra.f_hz * r.y, 0.0)
    product = np.fft.rfft(np.fft.irfft(slope, n) * np.fft.irfft(weight * r.y, n)) * n
    power = np.fft.rfft(np.fft.irfft(np.abs(slope) ** 2, n) * np.fft.irfft(weight, n)).real * n
    return product, np.maximum(power, np.finfo(float).tiny)


def _rate(line: int, n: int, fs_hz: float, size: float) -> tuple[float, float]:
    """Rate whose sawtooth has a line of this size there, and its size: the line's, or that of its image."""
    rates = np.array([line, n - line]) * (fs_hz / n)
    time_s = np.arange(n) / fs_hz
    # A refresh falls on a sample in spite of rounding.
    lags = [(time_s - np.floor(time_s * rate + 1e-9) / rate) for rate in rates]
    sizes = np.array([np.abs(np.fft.fft(lag)[line]) / n for lag in lags])
    best = int(np.argmin(np.abs(np.log(np.maximum(sizes, 1e-300) / size))))
    return float(rates[best]), float(max(sizes[best], 1e-300))
