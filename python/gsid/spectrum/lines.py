"""Fourier lines of periods, and the variances of their means."""

from __future__ import annotations

import numpy as np

from gsid._lib import check, ffi, lib


def lines_of(x: np.ndarray) -> np.ndarray:
    """Lines 0 .. N/2 of one period, as Spectra has them: |line| is the amplitude of the sine.

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
    """One period of the signal that has these lines: the inverse of `lines_of`.

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
    """Lines (uint32) of each row of `periods` (P, N), referred to the record's first sample, (P, K)."""
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
        lines *= _turns(line, settle_samples, n_period)
    return lines


def _turns(line: np.ndarray, n_samples: int, n_period: int) -> np.ndarray:
    """Each line's phase after n_samples, as a factor; the angle is reduced with integers."""
    return np.exp(-2j * np.pi * (line.astype(np.int64) * (n_samples % n_period) % n_period) / n_period)


def sample_variance(a: np.ndarray) -> np.ndarray:
    """Sample variance over the first axis, (K,): `covariance(a, a)` in half of the passes."""
    away = a - a.mean(axis=0)
    power = sum(np.einsum("pk,pk->k", part, part) for part in (away.real, away.imag))
    return power / (len(a) - 1)


def covariance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sample covariance of a and conj(b) over their first axis (thesis, eq. 4.11)."""
    return np.einsum("pk,pk->k", a - a.mean(axis=0), (b - b.mean(axis=0)).conj()) / (len(a) - 1)


def variance_between_lines(lines: np.ndarray, n_period: int, settle_samples: int) -> np.ndarray:
    """Variance of one period's lines, from between them in the spectrum of the whole record (FRF-6).

    A wandering output makes each period begin and end at different values. The jump leaks into all lines of
    that period, but not into their mean: what one period's end adds the next one's beginning takes away. The
    sample variance over the periods (thesis, eq. 4.11) counts it. In the spectrum of all P periods together
    line k is bin kP, and the P - 1 bins around it hold noise alone, leakage as in the mean.

    Parameters
    ----------
    lines : (P, K) complex ndarray
        Lines 0 .. N/2 of consecutive periods.
    n_period : int
        N, samples.
    settle_samples : int
        The lines' phases count from that long before the first period.

    Returns
    -------
    (K,) float64 ndarray; of white noise as `covariance`, with P - 1 degrees of freedom too
    """
    n_periods, n_lines = lines.shape
    lines = lines * _turns(np.arange(n_lines), settle_samples, n_period).conj()
    whole = np.fft.fft(np.concatenate([period_of(one, n_period) for one in lines]))
    around = np.arange(-((n_periods - 1) // 2), n_periods // 2 + 1)
    bins = n_periods * np.arange(n_lines)[:, None] + around[around != 0]
    size = np.abs(whole[bins % len(whole)]) ** 2
    scale = np.full(n_lines, (2.0 / n_period) ** 2 / n_periods)
    real = np.arange(n_lines) * 2 % n_period == 0
    scale[real] /= 4
    return size.mean(axis=1) * scale
