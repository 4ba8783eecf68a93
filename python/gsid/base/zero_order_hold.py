"""The zero-order hold: an input that keeps its value over each sample."""

from __future__ import annotations

import numpy as np

from gsid._lib import check, ffi, lib


def hold_factor(f_hz: np.ndarray, rate_hz: float) -> np.ndarray:
    """Response of the hold, (1 - exp(-j w T)) / (j w T) with T = 1 / rate_hz, without images.  Eq: MOD-2

    Parameters
    ----------
    f_hz : (F,) ndarray
        Hz.
    rate_hz : float
        Rate of the samples [Hz].

    Returns
    -------
    (F,) complex ndarray
    """
    f = np.ascontiguousarray(f_hz, float)
    hold = np.empty(len(f), complex)
    pointers = ffi.from_buffer("double[]", f), ffi.from_buffer("gsid_cplx[]", hold)
    check(lib.gsid_hold_factor(1.0 / rate_hz, len(f), *pointers), "response of the hold")
    return hold
