"""Monitoring of the limits of a run, on the samples as they arrive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ROUNDING = 1 + 1e-6  # the line carries single precision
ROUNDED_MOST = 0.05  # largest half step of a drive that is allowed, relative to the limit of the command
BLIND_S = 1.0  # longest time without a measured rate


@dataclass(frozen=True)
class RunLimits:
    """Limits that an axis must not exceed during a run; None: not monitored.

    Attributes
    ----------
    command : float or None
        Largest |command|, unit of the command. A drive that rounds may exceed it by half a step.
    travel_deg : float or None
        Largest travel to each side of the angle at the start [deg].
    rate : float or None
        Largest |rate|, unit of the output.

    Raises
    ------
    ValueError
        A limit is not positive and finite.
    """

    command: float | None = None
    travel_deg: float | None = None
    rate: float | None = None

    def __post_init__(self) -> None:
        for name, limit in vars(self).items():
            if limit is not None and not 0 < limit < np.inf:
                raise ValueError(f"the limit of {name} must be positive and finite, not {limit}")


class Watch:
    """Compare samples with limits.

    Parameters
    ----------
    limits : RunLimits
    fs_hz : float
        Sample rate [Hz].
    rate_offset : float
        Offset of the gyro: its output at rest, unit of the output. It is subtracted before the integration.

    Attributes
    ----------
    new_angle_deg : (n,) float64
        Travel at the samples that were checked last [deg].
    """

    def __init__(self, limits: RunLimits, fs_hz: float, rate_offset: float = 0.0) -> None:
        self.limits = limits
        self.fs_hz = fs_hz
        self.rate_offset = rate_offset
        self.angle_deg = 0.0
        self.new_angle_deg = np.zeros(0)
        self._rate = rate_offset
        self._n_blind = 0
        self._step = np.inf  # of the drive: smallest difference of two commands in force

    def check(self, u: np.ndarray, y: np.ndarray, received: np.ndarray) -> tuple[int, str] | None:
        """Check the next samples.

        Parameters
        ----------
        u, y : (n,) float64
            Command in force and rate.
        received : (n,) bool
            False: the sample is lost or not a number. The rate before it is held, for at most `BLIND_S`.

        Returns
        -------
        (int, str) or None
            Index of the first sample that exceeds a limit, and the limit.
        """
        last = np.maximum.accumulate(np.where(received, np.arange(len(y)), -1))
        rate = np.where(last >= 0, y[np.maximum(last, 0)], self._rate)
        blind = np.arange(1, len(y) + 1) + np.where(last >= 0, -1 - last, self._n_blind)
        angle = self.angle_deg + np.cumsum(rate - self.rate_offset) / self.fs_hz
        self.new_angle_deg = angle
        self._rate, self.angle_deg, self._n_blind = float(rate[-1]), float(angle[-1]), int(blind[-1])
        needs_rate = self.limits.rate is not None or self.limits.travel_deg is not None
        found = [
            self._check_command(np.where(received, u, 0.0)),
            self._first(rate, self.limits.rate, "rate"),
            self._first(angle, self.limits.travel_deg, "travel [deg]"),
            self._first(blind / self.fs_hz, BLIND_S if needs_rate else None, "time without a rate [s]"),
        ]
        return min((one for one in found if one is not None), default=None)

    def _check_command(self, u: np.ndarray) -> tuple[int, str] | None:
        """Compare the command in force with its limit: a drive that rounds exceeds it by half a step."""
        limit = self.limits.command
        if limit is None:
            return None
        self._step = float(np.min(np.diff(np.unique(u)), initial=self._step))
        return self._first(u, limit, "command", min(self._step / 2, ROUNDED_MOST * limit))

    @staticmethod
    def _first(
        values: np.ndarray, limit: float | None, what: str, allowed: float = 0.0
    ) -> tuple[int, str] | None:
        if limit is None:
            return None
        beyond = np.flatnonzero(np.abs(values) > limit * ROUNDING + allowed)
        if not len(beyond):
            return None
        return int(beyond[0]), f"{what} {values[beyond[0]]:.4g}, limit {limit:g}"
