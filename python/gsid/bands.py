"""Which lines lie in a band: an edge that is meant to be on a line is on it, whatever the rounding."""

from __future__ import annotations

import numpy as np

#: Edges this near to a line, in spacings of the lines, are meant to be on it.
ON_A_LINE = 1e-6


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
    """
    if band is None or len(f_hz) == 0:
        return np.ones(len(f_hz), dtype=bool)
    spacing = np.abs(np.diff(f_hz)).min() if len(f_hz) > 1 else f_hz[0]
    near = ON_A_LINE * spacing
    return (f_hz >= band[0] - near) & (f_hz <= band[1] + near)


def in_band(f_hz: np.ndarray, band: tuple[float, float] | None) -> np.ndarray:
    """Mark the frequencies in a band as `within` does, where there must be one.

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
