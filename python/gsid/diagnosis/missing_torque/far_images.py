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
        self._order = np.concatenate([np.arange(-last, -first), np.arange(first + 1, last + 1)])
        self._at_hz = (self._nodes_hz + self._order[:, None] * fs_hz).ravel()
        self._hold = hold_factor(self._at_hz, fs_hz)
        self._to_lines = np.transpose(
            [BarycentricInterpolator(self._nodes_hz, one)(f_hz) for one in np.eye(NODES)]
        )

    def sum(self, command: Command, delay_s: float) -> np.ndarray:
        """Their sum at each line.

        Parameters
        ----------
        command : callable
            Response to the command without its delay, at some frequencies [Hz], where the response of the
            hold is given.
        delay_s : float
            That delay.

        Returns
        -------
        (K,) complex ndarray
        """
        turned = np.exp(-2j * np.pi * self._order * self._fs_hz * delay_s)  # each image by the delay
        found = turned @ command(self._at_hz, self._hold).reshape(-1, NODES)
        smooth = self._to_lines @ (found / self._of_hold(self._nodes_hz))
        return np.exp(-2j * np.pi * self._f_hz * delay_s) * self._of_hold(self._f_hz) * smooth

    def _of_hold(self, f_hz: np.ndarray) -> np.ndarray:
        """What all images of a line share: the zeros of the hold."""
        return -np.expm1(-2j * np.pi * f_hz / self._fs_hz)
