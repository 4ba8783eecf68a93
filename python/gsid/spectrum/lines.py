"""Fourier lines of periods, and their variances."""

from __future__ import annotations

import numpy as np

from gsid._lib import check, ffi, lib

SLOPE_HALF = 10  # lines on each side that show the slope of the noise, to 5 % per line with two periods
STEEPEST = 4.0  # exponent of the noise over frequency: that of torque noise behind two integrators


def lines_of(x: np.ndarray) -> np.ndarray:
    """Compute lines 0 .. N/2 of one period, scaled as in Spectra: |line| is the amplitude of the sine.

    Parameters
    ----------
    x : (..., N) ndarray

    Returns
    -------
    (..., N // 2 + 1) complex ndarray
    """
    n = x.shape[-1]
    lines = np.fft.rfft(x) * (2.0 / n)
    lines[..., 0] /= 2
    if n % 2 == 0:
        lines[..., -1] /= 2
    return lines


def period_of(lines: np.ndarray, n_period: int) -> np.ndarray:
    """Compute one period of the signal with these lines: the inverse of `lines_of`.

    Parameters
    ----------
    lines : (N // 2 + 1,) complex ndarray
    n_period : int
        N.

    Returns
    -------
    (N,) float64 ndarray
    """
    spectrum = lines * (n_period / 2)
    spectrum[0] *= 2
    if n_period % 2 == 0:
        spectrum[-1] *= 2
    return np.fft.irfft(spectrum, n_period)


def period_lines(periods: np.ndarray, line: np.ndarray, settle_samples: int) -> np.ndarray:
    """Compute lines (uint32) of each row of `periods` (P, N): (P, K), phases from the first sample."""
    n_periods, n_period = periods.shape
    periods = np.ascontiguousarray(periods, np.float64)
    lines = np.empty((n_periods, len(line)), complex)
    status = lib.gsid_batch_spectra(
        n_periods,
        n_period,
        ffi.from_buffer("double[]", periods),
        len(line),
        ffi.from_buffer("uint32_t[]", line),
        ffi.from_buffer("gsid_cplx[]", lines),
    )
    check(status, "transforming the periods")
    if settle_samples % n_period:  # settling not a whole number of periods
        lines *= phase_factors(line, settle_samples, n_period)
    return lines


def phase_factors(line: np.ndarray, n_samples: int, n_period: int) -> np.ndarray:
    """Compute the phase factor of each line after n_samples. The angle is reduced in integer arithmetic."""
    return np.exp(-2j * np.pi * (line.astype(np.int64) * (n_samples % n_period) % n_period) / n_period)


def sample_variance(a: np.ndarray) -> np.ndarray:
    """Sample variance over the first axis, (K,): as `covariance(a, a)`, but faster."""
    deviation = a - a.mean(axis=0)
    power = sum(np.einsum("pk,pk->k", part, part) for part in (deviation.real, deviation.imag))
    return power / (len(a) - 1)


def covariance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sample covariance of a and conj(b) over their first axis (thesis, eq. 4.11)."""
    return np.einsum("pk,pk->k", a - a.mean(axis=0), (b - b.mean(axis=0)).conj()) / (len(a) - 1)


def variance_between_lines(lines: np.ndarray, n_period: int, settle_samples: int) -> np.ndarray:
    """Variance of one period's lines, estimated from the bins between them in the whole record (FRF-6).

    If the output drifts, each period begins and ends at different values. The discontinuity leaks into all
    lines of that period, but not into their mean, where the end of one period cancels the beginning of the
    next. The sample variance over the periods (thesis, eq. 4.11) includes this leakage. In the spectrum of
    all P periods together, line k is bin kP. The P - 1 bins around it contain noise only, with the leakage of
    the mean.

    Parameters
    ----------
    lines : (P, K) complex ndarray
        Lines 0 .. N/2 of consecutive periods.
    n_period : int
        N, samples.
    settle_samples : int
        The phases of the lines count from this many samples before the first period.

    Returns
    -------
    (K,) float64 ndarray; for white noise as `covariance`, also with P - 1 degrees of freedom
    """
    return np.mean(np.abs(bins_between_lines(lines, n_period, settle_samples)) ** 2, axis=1)


def bins_between_lines(lines: np.ndarray, n_period: int, settle_samples: int) -> np.ndarray:
    """Noise between the lines, as `variance_between_lines` uses it.  Eq: FRF-6

    Parameters
    ----------
    lines : (P, K) complex ndarray
    n_period, settle_samples : int

    Returns
    -------
    (K, P - 1) complex ndarray
        Independent numbers around each line with the variance of one period's line.
    """
    n_periods, n_lines = lines.shape
    whole = bins_of_record(lines, n_period, settle_samples)
    around = np.arange(-((n_periods - 1) // 2), n_periods // 2 + 1)
    around = around[around != 0]
    bins = n_periods * np.arange(n_lines)[:, None] + around
    scale = np.full(n_lines, (2.0 / n_period) / np.sqrt(n_periods))
    real = np.arange(n_lines) * 2 % n_period == 0
    scale[real] /= 2
    noise = whole[bins % len(whole)] * scale[:, None]
    if n_periods > 1:
        power = np.mean(np.abs(noise[~real]) ** 2, axis=1)
        noise[~real] *= np.sqrt(at_lines_over_between(power, around / n_periods))[:, None]
    return noise


def at_lines_over_between(power: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Power of the noise at the lines over that in the bins around them.  Eq: FRF-6

    With an even number of periods there is one bin more above a line than below it, with two periods only
    one above. Where the noise falls with frequency, its power there is lower than at the line.

    Parameters
    ----------
    power : (K,) ndarray
        Mean power around lines 1 .. K.
    around : (P - 1,) ndarray
        Positions of the bins from a line, in lines.

    Returns
    -------
    (K,) ndarray
        1 with fewer than 21 lines.
    """
    if len(power) < 2 * SLOPE_HALF + 1:
        return np.ones(len(power))
    line = np.arange(1, len(power) + 1)
    level = np.log(np.maximum(power, np.finfo(float).tiny))
    at = line + around.mean()
    steepest = STEEPEST * np.maximum(at / SLOPE_HALF, 1)  # per line, beyond the first ones
    exponent = np.clip(_exponents(at, level), -steepest, steepest)
    return 1 / np.mean(np.exp(exponent[:, None] * np.log1p(around / line[:, None])), axis=1)


def _exponents(x: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Slope of the level over ln x at each line, by least squares over the lines around it without itself."""
    apart = np.arange(-SLOPE_HALF, SLOPE_HALF + 1)
    inner = np.convolve(level, -apart / np.sum(apart**2), mode="valid")
    slopes = np.concatenate([np.zeros(SLOPE_HALF), inner, np.full(SLOPE_HALF, inner[-1])]) * x
    first = np.arange(len(apart))
    for i in range(SLOPE_HALF):  # there the level bends over x, but less over ln x
        others = first[first != i]
        slopes[i] = np.polyfit(np.log(x[others]), level[others], 1)[0]
    return slopes


def bins_of_record(lines: np.ndarray, n_period: int, settle_samples: int) -> np.ndarray:
    """Transform all periods together.

    Parameters
    ----------
    lines : (P, K) complex ndarray
    n_period : int
    settle_samples : int
        As `variance_between_lines`.

    Returns
    -------
    (P N,) complex ndarray
        Not scaled; line k is bin k P.
    """
    lines = lines * phase_factors(np.arange(lines.shape[1]), settle_samples, n_period).conj()
    return np.fft.fft(np.concatenate([period_of(one, n_period) for one in lines]))
