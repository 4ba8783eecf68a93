"""Noise that rings with a resonance narrower than the bins of a record.

Noise that excites such a resonance is one slow oscillation: nearly all its power is in one bin. If that is
the bin of a line, the noise between the lines (FRF-6) is far below the noise of the line.
"""

from __future__ import annotations

import numpy as np

from gsid.spectrum.spectra import Spectra


def bin_power(offset_hz: np.ndarray, decay_per_s: float, record_s: float) -> np.ndarray:
    """Mean power in a bin of an oscillation that white noise excites, apart from a constant.  Eq: FRF-9

    Parameters
    ----------
    offset_hz : ndarray
        Of the bin from the resonance.
    decay_per_s : float
        Of the amplitude of its free oscillation, positive.
    record_s : float
        Length of the record; it is not tapered.
    """
    s = decay_per_s + 2j * np.pi * np.asarray(offset_hz)
    return np.real(1 / s + np.expm1(-s * record_s) / (s**2 * record_s))


def noise_ratio(one: Spectra, line: np.ndarray, f_hz: float, decay_per_s: float) -> np.ndarray:
    """Noise of lines over that between the lines if all of it excites one resonance (FRF-9), (k,).

    Parameters
    ----------
    one : Spectra
    line : (k,) int
    f_hz : float
        Of the resonance.
    decay_per_s : float
        Of its free oscillation, positive.
    """
    record_s = one.n_periods * one.period_samples / one.fs_hz
    around = np.arange(-((one.n_periods - 1) // 2), one.n_periods // 2 + 1) / record_s
    offset_hz = one.f_hz[line] - f_hz
    between = bin_power(offset_hz[:, None] + around[around != 0], decay_per_s, record_s)
    return bin_power(offset_hz, decay_per_s, record_s) / between.mean(axis=1)
