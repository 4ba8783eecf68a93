"""Transient signals: random burst, impulse, rectangular pulse and 3-2-1-1 doublets (thesis, section 3.1).

A response that has decayed by the end of the period has no leakage, and the signal repeats as any other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gsid.excitation.generators import request
from gsid.excitation.periodic import Periodic, require_one_of

KINDS = ("random-burst", "impulse", "pulse", "3-2-1-1")
STEPS = np.repeat([1.0, -1.0, 1.0, -1.0], [3, 2, 1, 1])  # of doublets, in units of the shortest


@dataclass(repr=False)
class Transient(Periodic):
    """Signal at the start of a period, and zero input for the rest of it (EXC-12).

    Attributes
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        Number of samples of a period, N.
    n_samples : int
        Number of samples of the signal; those that follow are zero.
    line : (F,) int
        Lines of interest.
    amplitude : float
        Largest magnitude, unit of the command.
    kind : {"random-burst", "impulse", "pulse", "3-2-1-1"}
    seed : int
        Of a random burst.
    """

    fs_hz: float
    period_samples: int
    n_samples: int
    line: np.ndarray
    amplitude: float = 1.0
    kind: str = "random-burst"
    seed: int = 0

    @classmethod
    def design(
        cls,
        fs_hz: float,
        period_samples: int,
        band_hz: tuple[float, float],
        *,
        kind: str = "random-burst",
        length_s: float | None = None,
        amplitude: float = 1.0,
        seed: int = 0,
    ) -> Transient:
        """Design a transient signal.

        Parameters
        ----------
        fs_hz : float
            Sample rate [Hz].
        period_samples : int
            Number of samples of a period, N. The response must have decayed at its end.
        band_hz : (lo, hi)
            Band of interest [Hz]. The signal has power outside too.
        kind : {"random-burst", "impulse", "pulse", "3-2-1-1"}
            White normal noise; one sample; a rectangular pulse; steps of alternating sign with lengths in the
            ratios 3, 2, 1 and 1.
        length_s : float, optional
            Duration of the signal [s], rounded to samples, of doublets to 7 samples. Default: half a period
            of a burst, and half a cycle of the upper edge of the band for a pulse or the shortest doublet.
        amplitude : float
            Largest magnitude, unit of the command.
        seed : int
            Of the burst.

        Returns
        -------
        Transient

        Raises
        ------
        ValueError
            The request cannot be met.
        """
        require_one_of("kind", kind, KINDS)
        n, line = request(fs_hz, period_samples, band_hz, amplitude)
        if kind == "impulse" and length_s is not None:
            raise ValueError("an impulse lasts one sample: leave out its length")
        unit = len(STEPS) if kind == "3-2-1-1" else 1
        default_s = 0.5 * n / fs_hz if kind == "random-burst" else 0.5 * unit / band_hz[1]
        seconds = default_s if length_s is None else length_s
        if not (math.isfinite(seconds) and seconds > 0):
            raise ValueError(f"the length must be a positive number of seconds, not {seconds}")
        n_samples = 1 if kind == "impulse" else unit * max(1, round(seconds * fs_hz / unit))
        if n_samples >= n:
            longest = f"the period lasts {n / fs_hz:g} s"
            raise ValueError(f"the signal of {n_samples / fs_hz:g} s leaves no zero input: {longest}")
        return cls(float(fs_hz), n, n_samples, line, float(amplitude), kind, int(seed))

    def table(self) -> np.ndarray:
        """One period, (N,) float64, unit of the command."""
        u = np.zeros(self.period_samples)
        if self.kind == "random-burst":
            noise = np.random.default_rng(self.seed).standard_normal(self.n_samples)
            u[: self.n_samples] = noise / np.abs(noise).max()
        elif self.kind == "3-2-1-1":
            u[: self.n_samples] = np.repeat(STEPS, self.n_samples // len(STEPS))
        else:
            u[: self.n_samples] = 1.0
        return self.amplitude * u

    def scaled(self, factor: float) -> Transient:
        """The same signal, times a factor."""
        return replace(self, amplitude=self.amplitude * factor)

    def _head(self) -> dict[str, object]:
        return {"transient": f"{self.kind}, {self.n_samples} samples"}

    def __repr__(self) -> str:
        seconds = f"{self.n_samples / self.fs_hz:g} s of {self.period_samples / self.fs_hz:g} s"
        return f"Transient({self.kind}, {seconds}, +-{self.amplitude:g})"
