"""Periodic disturbances between the lines of the excitation, such as a fan: found in spectra, and subtracted.

Their frequency is no line, so that they turn from period to period and nearly cancel in the mean. The bins
between the lines (FRF-6) contain all of them: the noise of the nearest lines is overestimated many times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.spectrum.lines import bins_of_record, lines_of, phase_factors
from gsid.spectrum.spectra import Spectra
from gsid.spectrum.tones import GUARD, Tone, find_tones

ALPHA = 1e-4  # false-alarm rate of a record: a false sine costs a line, a weak one that stays hardly any
LOWEST = 1.5  # lines; below, a drift of the output is taken for a sine
ABOVE_BAND = 1.25  # highest frequency of a sine over that of an excited line; fewer samples take less time
ROUNDING = 1e-9  # of the input


def find_fans(one: Spectra) -> list[Tone]:
    """Find the sines between the lines of the output.

    Parameters
    ----------
    one : Spectra

    Returns
    -------
    list of Tone
        Their phases count from the first period. Empty if a period was lost, or if the input differs between
        the periods: in a closed loop it contains the disturbance too.
    """
    if one.n_periods < 2 or one.n_spoiled or not _repeats(one.U):
        return []
    highest = min(int(ABOVE_BAND * np.flatnonzero(one.excited)[-1]) + 1, len(one.line) - 1)
    n = min(2 * (highest + 1), one.period_samples)  # samples of a period at a lower rate
    y = _resampled(bins_of_record(one.Y, one.period_samples, one.settle_samples), n * one.n_periods)
    tones, _ = find_tones(y, n * one.f_hz[1], period=n, alpha=ALPHA)
    return [tone for tone in tones if LOWEST * one.f_hz[1] < tone.f_hz < one.f_hz[highest]]


def without_fans(one: Spectra, tones: Sequence[Tone]) -> Spectra:
    """Subtract sines from the output, and leave out the lines beside them.

    Their noise is too small without the bins of the sine: no response is estimated there.

    Parameters
    ----------
    one : Spectra
    tones : sequence of Tone
        Of `find_fans`.
    """
    if not tones:
        return one
    n = one.period_samples
    t_s = np.arange(n * one.n_periods) / one.fs_hz
    samples = sum(tone.at(t_s) for tone in tones).reshape(one.n_periods, n)
    part = lines_of(samples) * phase_factors(one.line, one.settle_samples, n)
    beside = np.any([_beside(one, tone) for tone in tones], axis=0)
    left_out = beside if one.left_out is None else beside | one.left_out
    return replace(one, Y=one.Y - part, left_out=left_out, excited=one.excited & ~beside)


def _repeats(u: np.ndarray) -> bool:
    return bool(np.max(np.abs(u - u[0])) <= ROUNDING * np.max(np.abs(u)))


def _resampled(bins: np.ndarray, n: int) -> np.ndarray:
    """A signal of n samples with the lowest bins of a longer one."""
    lowest = bins[: n // 2 + 1].copy()
    if n < len(bins):
        lowest[-1] = 0.0  # half of the new rate: of a real signal
    return np.fft.irfft(lowest, n) * (n / len(bins))


def _beside(one: Spectra, tone: Tone) -> np.ndarray:
    """Lines with the sine among the bins that give their noise, (K,) bool."""
    offset_hz = np.abs(one.f_hz - tone.f_hz)
    return offset_hz * one.n_periods / one.f_hz[1] <= one.n_periods / 2 + GUARD
