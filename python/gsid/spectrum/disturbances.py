"""Periodic disturbances between the lines of the excitation, such as a fan: found in spectra, and subtracted.

Their phase changes from period to period, so that they nearly cancel in the mean. The bins between the lines
(FRF-6) contain all of their power: the noise of the nearest lines is overestimated many times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.spectrum.lines import bins_of_record, lines_of, phase_factors
from gsid.spectrum.spectra import Spectra
from gsid.spectrum.tones import GUARD, Tone, find_tones

ALPHA = 1e-4  # false-alarm rate of a record: a false sine costs a line or two, a missed weak one nothing
LOWEST = 1.5  # lowest frequency of a sine [lines]: below it, a drift of the output is taken for one
ABOVE_BAND = 1.25  # highest frequency of a sine over that of an excited line; a lower rate takes less time


def find_disturbances(one: Spectra) -> list[Tone]:
    """Find the sines between the lines of the output (NOI-1, NOI-2).

    Parameters
    ----------
    one : Spectra

    Returns
    -------
    list of Tone
        Their phases count from the first period. Empty if a period was lost, or if the input differs between
        the periods: in a closed loop it contains the disturbance too. Empty also if no excited line would be
        left beside them.
    """
    if one.n_periods < 2 or one.n_spoiled or not one.input_repeats:
        return []
    highest = min(int(ABOVE_BAND * np.flatnonzero(one.excited)[-1]) + 1, len(one.line) - 1)
    n = min(2 * (highest + 1), one.period_samples)  # samples of a period at a lower rate
    y = _resampled(bins_of_record(one.Y, one.period_samples, one.settle_samples), n * one.n_periods)
    tones, _ = find_tones(y, n * one.f_hz[1], period=n, alpha=ALPHA)
    found = [tone for tone in tones if LOWEST * one.f_hz[1] < tone.f_hz < one.f_hz[highest]]
    return found if np.any(one.excited & ~_beside(one, found)) else []


def without_disturbances(one: Spectra, tones: Sequence[Tone]) -> Spectra:
    """Subtract sines from the output, and leave out the lines beside them.

    The variance of these lines lacks what the fit of the sine took from their bins. They no longer count as
    excited, so that no response is estimated from them either.

    Parameters
    ----------
    one : Spectra
    tones : sequence of Tone
        Of `find_disturbances`.
    """
    if not tones:
        return one
    n = one.period_samples
    t_s = np.arange(n * one.n_periods) / one.fs_hz
    samples = sum(tone.at(t_s) for tone in tones).reshape(one.n_periods, n)
    part = lines_of(samples) * phase_factors(one.line, one.settle_samples, n)
    return without_lines_beside(replace(one, Y=one.Y - part), tones)


def without_lines_beside(one: Spectra, tones: Sequence[Tone]) -> Spectra:
    """Leave out the lines beside sines; all lines stay if no excited one would be left.

    Parameters
    ----------
    one : Spectra
    tones : sequence of Tone
        Also those of other records of the same axis.
    """
    beside = _beside(one, tones)
    if not np.any(beside) or not np.any(one.excited & ~beside):
        return one
    left_out = beside if one.left_out is None else beside | one.left_out
    return replace(one, left_out=left_out, excited=one.excited & ~beside)


def _resampled(bins: np.ndarray, n: int) -> np.ndarray:
    """A signal of n samples with the lowest bins of a longer one."""
    lowest = bins[: n // 2 + 1].copy()
    if n < len(bins):
        lowest[-1] = 0.0  # half of the new rate: of a real signal
    return np.fft.irfft(lowest, n) * (n / len(bins))


def _beside(one: Spectra, tones: Sequence[Tone]) -> np.ndarray:
    """Lines with a sine among the bins that give their noise, (K,) bool."""
    bins_per_hz = one.n_periods / one.f_hz[1]
    offset_hz = np.abs(one.f_hz[:, None] - np.array([tone.f_hz for tone in tones]))
    return np.any(offset_hz * bins_per_hz <= one.n_periods / 2 + GUARD, axis=1)
