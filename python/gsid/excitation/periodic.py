"""Base class of periodic excitations, their crest factors, and checks of their arguments."""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.arguments import real_number
from gsid.base.files import write_atomically
from gsid.base.plottable import Plottable

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.models.rational import RationalModel
    from gsid.plant.model import PlantModel

FINE = 8  # points per sample at which the crest factor between the samples is evaluated


class Periodic(Plottable, ABC):
    """Base class of periodic excitations.

    Attributes
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        Number of samples of a period, N.
    line : (F,) int
        Lines of interest.
    amplitude : float or (F,) float64
        Amplitude of the signal or of each line, unit of the command.
    """

    fs_hz: float
    period_samples: int
    line: np.ndarray
    amplitude: float | np.ndarray

    @abstractmethod
    def table(self) -> np.ndarray:
        """One period of the signal, (N,) float64, unit of the command."""

    @abstractmethod
    def scaled(self, factor: float) -> Periodic:
        """The same signal, times a factor."""

    @abstractmethod
    def _head(self) -> dict[str, object]:
        """Keys and values of the design, for the head of its file."""

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the lines of interest, (F,) [Hz]."""
        return self.line * (self.fs_hz / self.period_samples)

    @property
    def rms(self) -> float:
        """Root mean square of the samples, unit of the command."""
        return float(np.sqrt(np.mean(self.table() ** 2)))

    @property
    def peak(self) -> float:
        """Largest magnitude of the samples, unit of the command."""
        return float(np.abs(self.table()).max())

    @property
    def slew(self) -> float:
        """Largest change from one sample to the next, unit of the command per second."""
        u = self.table()
        return float(np.abs(np.diff(u, append=u[0])).max() * self.fs_hz)

    @property
    def crest_factor(self) -> float:
        """Crest factor of the samples (thesis, definition 3.2.1)."""
        return crest_factor(self.table(), self.line)

    @property
    def crest_factor_fine(self) -> float:
        """Crest factor on an 8 times finer grid, which includes peaks between the samples."""
        return crest_factor(between_samples(self.table()), self.line)

    @property
    def p_int_over_p_tot(self) -> float:
        """Share of the power at the lines of interest (thesis, definition 3.2.1)."""
        return power_share(self.table(), self.line)

    def plot(
        self,
        u_unit: str = "",
        *,
        model: RationalModel | PlantModel | None = None,
        limits: Limits | None = None,
    ) -> matplotlib.figure.Figure:
        """Plot one period and its lines with the crest factors, and the travel predicted by a model.

        Parameters
        ----------
        u_unit : str
            Unit of the input, for the axes.
        model : RationalModel or PlantModel, optional
            Model that predicts the travel.
        limits : Limits, optional
            Limits of command and travel to draw.
        """
        return self._figure(u_unit, model=model, limits=limits)

    def write_table(self, path: str | os.PathLike) -> None:
        """Write one period as CSV with columns t_s and u, below `# key: value` lines with the design.

        Parameters
        ----------
        path : path

        Raises
        ------
        OSError
            The file cannot be written.
        """
        write_period(path, self.table(), self.fs_hz, self._head())


def write_period(path: str | os.PathLike, u: np.ndarray, fs_hz: float, more: Mapping[str, object]) -> None:
    """Write one period of a command as CSV with columns t_s and u, below `# key: value` lines.

    Parameters
    ----------
    path : path
    u : (N,) ndarray
    fs_hz : float
        Sample rate [Hz].
    more : mapping
        Further keys and values of the head.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    head = {"fs_hz": repr(fs_hz), "period_samples": len(u), "hold": "zoh", **more}
    rows = (f"{n / fs_hz!r},{value!r}" for n, value in enumerate(u.tolist()))
    text = [*(f"# {key}: {value}" for key, value in head.items()), "t_s,u", *rows]
    write_atomically(path, lambda part: part.write_text("\n".join(text) + "\n", encoding="utf-8"))


def power_share(u: np.ndarray, line: np.ndarray) -> float:
    """Share P_int/P_tot of the power of a period at the given lines (thesis, definition 3.2.1).

    Parameters
    ----------
    u : (N,) array_like
    line : (F,) int, 0 .. N/2

    Returns
    -------
    float, 0 .. 1
    """
    power = np.abs(np.fft.rfft(u)) ** 2
    power[1 : (len(u) + 1) // 2] *= 2  # the negative frequencies
    return float(power[np.asarray(line)].sum() / power.sum())


def between_samples(u: np.ndarray) -> np.ndarray:
    """Interpolate one period, (N,), to an 8 times finer grid, (8 N,), without lines above fs/2."""
    return FINE * np.fft.irfft(np.fft.rfft(u), FINE * len(u))


def crest_factor(u: np.ndarray, line: np.ndarray | None = None) -> float:
    """Peak of a period over its rms at the lines of interest (thesis, definition 3.2.1).

    Parameters
    ----------
    u : (N,) array_like
        One period.
    line : (F,) int, optional
        Lines of interest; default: all, for which P_int/P_tot is 1.

    Returns
    -------
    float
        Crest factor, >= 1 if all power is at the lines of interest.

    Raises
    ------
    ValueError
        The signal has no power at the lines of interest.
    """
    u = np.asarray(u, float)
    share = 1.0 if line is None else power_share(u, line)
    rms_of_interest = np.sqrt(np.mean(u**2) * share)
    if not rms_of_interest > 0:
        raise ValueError("the signal has no power at the lines of interest: its crest factor is not defined")
    return float(np.abs(u).max() / rms_of_interest)


def require_rate(fs_hz: float) -> None:
    """Raise ValueError for an invalid sample rate."""
    fs_hz = real_number("the sample rate", fs_hz, "Hz")
    if not (math.isfinite(fs_hz) and fs_hz > 0):
        raise ValueError(f"the sample rate must be a positive number of Hz, not {fs_hz}")


def require_one_of(name: str, value: str, known: Iterable[str]) -> None:
    """Raise ValueError for an unknown choice."""
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(known)}, not {value!r}")


def whole_period(period_samples: float) -> int:
    """The period as an integer number of samples. Raise ValueError if it is not a whole number."""
    number = real_number("the period", period_samples, "samples")
    nearest = max(round(number), 3) if math.isfinite(number) else 3
    if nearest != number:
        raise ValueError(
            f"a period of {period_samples} samples is not a whole number of at least 3; the nearest valid "
            f"request is {nearest} samples"
        )
    return nearest


@dataclass(frozen=True)
class Limits:
    """Limits of the rig; None means no limit.

    Attributes
    ----------
    command : float, optional
        Limit of |u|, unit of the command.
    travel : float, optional
        Limit of the angle to each side of its middle position, in degrees for angles, else in the unit of
        the model.
    slew : float, optional
        Limit of the rate of change of the command, unit of the command per second.
    """

    command: float | None = None
    travel: float | None = None
    slew: float | None = None

    def __post_init__(self) -> None:
        for name in ("command", "travel", "slew"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"the limit of {name} must be a positive number, not {value}")
