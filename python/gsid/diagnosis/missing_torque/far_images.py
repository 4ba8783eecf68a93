"""Images of a held command far above the lines: smooth but for delay and hold, few nodes show them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from gsid.base.zero_order_hold import hold_factor

NODES = 8
"""Frequencies at which the images are summed: from the fourth image on this is exact to 1e-8 of the sum, if
the resonances are below two and a half sample rates."""

Command = Callable[[np.ndarray, np.ndarray], np.ndarray]


class FarImages:
    """The images at f + m fs, first < |m| <= last, for the lines f (DIA-4).

    Parameters
    ----------
    f_hz : (K,) ndarray
        Lines [Hz], above 0 and up to half the sample rate.
    fs_hz : float
    first : int
        Image beyond which they are far.
    last : int
    """

    def __init__(self, f_hz: np.ndarray, fs_hz: float, first: int, last: int) -> None:
        self._f_hz, self._fs_hz = f_hz, fs_hz
        angle = np.pi * (np.arange(NODES) + 0.5) / NODES
        self._nodes_hz = float(f_hz.max()) * (1 - np.cos(angle)) / 2
        order = np.concatenate([np.arange(-last, -first), np.arange(first + 1, last + 1)])
        self._at_hz = (self._nodes_hz + order[:, None] * fs_hz).ravel()
        self._hold = hold_factor(self._at_hz, fs_hz)
        self._to_lines = np.transpose(
            [BarycentricInterpolator(self._nodes_hz, one)(f_hz) for one in np.eye(NODES)]
        )

    def sum(self, command: Command, delay_s: float) -> np.ndarray:
        """Their sum at each line.

        Parameters
        ----------
        command : callable
            Response to the command at some frequencies [Hz], where the response of the hold is given.
        delay_s : float
            Delay of that response.

        Returns
        -------
        (K,) complex ndarray
        """
        found = command(self._at_hz, self._hold).reshape(-1, NODES).sum(axis=0)
        smooth = found / self._common(self._nodes_hz, delay_s)
        return self._common(self._f_hz, delay_s) * (self._to_lines @ smooth)

    def _common(self, f_hz: np.ndarray, delay_s: float) -> np.ndarray:
        """What all images of a line share apart from a phase: the delay, and the zeros of the hold."""
        w = 2j * np.pi * f_hz
        return np.exp(-w * delay_s) * -np.expm1(-w / self._fs_hz)
