"""Select the lines in a frequency band. Edges have a tolerance for rounding."""

from __future__ import annotations

from typing import Any

import numpy as np

from gsid.base.arguments import real_number

#: An edge this close to a line counts as on the line, in units of the line spacing.
ON_A_LINE = 1e-6


def two_frequencies(band: Any) -> tuple[float, float]:
    """Convert both edges of a band (lo, hi) [Hz] to floats; TypeError unless they are two numbers."""
    try:
        lo, hi = (real_number("band", edge, "Hz") for edge in band)
    except (TypeError, ValueError) as error:
        raise TypeError(f"a band is two frequencies (lo, hi) [Hz], got {band!r:.60}") from error
    return lo, hi


def band_edges(band: Any) -> tuple[float, float]:
    """Check a band and return its first and last frequency.

    Parameters
    ----------
    band : (lo, hi)
        Hz, ends included.

    Raises
    ------
    ValueError
        The first edge is above the last, or an edge is NaN.
    TypeError
        The band is not two numbers.
    """
    lo, hi = two_frequencies(band)
    if not lo <= hi:
        raise ValueError(f"a band is (lo, hi) [Hz] with lo below hi, got {lo:g}:{hi:g}")
    return lo, hi


def within(f_hz: np.ndarray, band: tuple[float, float] | None) -> np.ndarray:
    """Mark the frequencies in a band, ends included.

    Parameters
    ----------
    f_hz : (k,) ndarray
        Hz.
    band : (lo, hi) or None
        Hz; None: all.

    Returns
    -------
    (k,) bool ndarray

    Raises
    ------
    TypeError, ValueError
        As `band_edges`.
    """
    band = None if band is None else band_edges(band)
    if band is None or len(f_hz) == 0:
        return np.ones(len(f_hz), dtype=bool)
    spacing = np.abs(np.diff(f_hz)).min() if len(f_hz) > 1 else f_hz[0]
    near = ON_A_LINE * spacing
    return (f_hz >= band[0] - near) & (f_hz <= band[1] + near)


def in_band(f_hz: np.ndarray, band: tuple[float, float] | None) -> np.ndarray:
    """Mark the frequencies in a band as `within` does, and refuse a band without any.

    Parameters
    ----------
    f_hz : (k,) ndarray
        Hz.
    band : (lo, hi) or None
        Hz; None: all.

    Returns
    -------
    (k,) bool ndarray

    Raises
    ------
    ValueError
        No frequency lies in the band.
    """
    use = within(f_hz, band)
    if band is not None and not np.any(use):
        raise ValueError(
            f"no line lies in {band[0]:g}:{band[1]:g} Hz; there are lines in {f_hz[0]:g}:{f_hz[-1]:g} Hz"
        )
    return use
