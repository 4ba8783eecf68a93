"""Response of a zero-order hold."""

from __future__ import annotations

import numpy as np


def hold_response(w: np.ndarray, sample_s: float) -> np.ndarray:
    """Zero-order hold: (1 - exp(-s h)) / (s h), (F,)."""
    return -np.expm1(-1j * w * sample_s) / (1j * w * sample_s)
