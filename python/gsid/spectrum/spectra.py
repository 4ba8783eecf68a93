"""Spectral lines of each period of a record.

The phases of the lines count from the first sample of the record, including the discarded settling.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gsid.base.cached import cached_property
from gsid.base.errors import InputError
from gsid.spectrum.lines import covariance, sample_variance, variance_between_lines

CONSTANT = 1e-13  # largest line of a constant output over its mean, due to rounding
DIGEST_LENGTH = 16  # hexadecimal digits
ROUNDING = 1e-9  # of the largest line of the input


@dataclass(repr=False)
class Spectra:
    """Lines of each good period of one record (FRF-1).

    Attributes
    ----------
    fs_hz : float
    period_samples : int
        N.
    line : (K,) int
        All lines 0 .. N/2.
    U, Y : (P, K) complex
        One row per good period, units `u_unit` and `y_unit`. |U| is the amplitude of the sine. Its phase is
        that of a cosine, from the first sample of the record.
    n_spoiled : int
        Periods omitted because they have lost samples.
    settle_samples : int
    excited : (K,) bool
        See `gsid.spectrum.excited.excited_lines`.
    hold : {"zoh", "none"} or None
        As in `gsid.Record`.
    u_unit, y_unit, name : str
    turn : float
        What y gains in each period, which is left out of Y [y_unit] (`gsid.records.turn`).
    digest : str
        Hash of the output samples of the record, including the settling; it identifies the measurement. Empty
        if there is no record.
    left_out : (K,) bool or None
        Lines whose noise is unknown (`gsid.spectrum.ringing`): no fit of a plant uses them.
    """

    fs_hz: float
    period_samples: int
    line: np.ndarray
    U: np.ndarray
    Y: np.ndarray
    n_spoiled: int
    settle_samples: int
    excited: np.ndarray
    hold: str | None = "none"
    u_unit: str = ""
    y_unit: str = ""
    name: str = ""
    turn: float = 0.0
    digest: str = ""
    left_out: np.ndarray | None = None

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the lines, (K,) [Hz]."""
        return self.line * (self.fs_hz / self.period_samples)

    @property
    def n_periods(self) -> int:
        """Good periods P."""
        return len(self.U)

    @property
    def input_repeats(self) -> bool:
        """Whether the input is the same in all periods, to within 1e-9 of its largest line."""
        return bool(np.max(np.abs(self.U - self.U[0])) <= ROUNDING * np.max(np.abs(self.U)))

    @property
    def u(self) -> np.ndarray:
        """Mean of U over periods, (K,) complex (thesis, eq. 4.10)."""
        return self.U.mean(axis=0)

    @property
    def y(self) -> np.ndarray:
        """Mean of Y over periods, (K,) complex (thesis, eq. 4.10)."""
        return self.Y.mean(axis=0)

    @property
    def var_u(self) -> np.ndarray:
        """Sample variance of one period's U, (K,) (thesis, eq. 4.11)."""
        return sample_variance(self.U)

    @property
    def var_y(self) -> np.ndarray:
        """Sample variance of one period's Y, (K,) (thesis, eq. 4.11)."""
        return sample_variance(self.Y)

    @cached_property
    def noise_y(self) -> np.ndarray:
        """Variance of one period's Y without the leakage that cancels in the mean, (K,).

        See `variance_between_lines`. If periods were lost, it equals `var_y`.
        """
        if self.n_spoiled:
            return self.var_y
        return variance_between_lines(self.Y, self.period_samples, self.settle_samples)

    @property
    def cov_yu(self) -> np.ndarray:
        """Sample covariance, mean of Y conj(U), of one period, (K,) complex (thesis, eq. 4.11)."""
        return covariance(self.Y, self.U)

    def __repr__(self) -> str:
        f_hz = self.f_hz[self.excited]
        return (
            f"Spectra({self.name or 'unnamed'}: {self.n_periods} periods of {self.period_samples} at "
            f"{self.fs_hz:g} Hz, {self.n_spoiled} spoiled, settling {self.settle_samples}; "
            f"{len(f_hz)} excited lines {f_hz[0]:g} .. {f_hz[-1]:g} Hz)"
        )


def require_motion_of_output(measured: Iterable[Spectra]) -> None:
    """Refuse to fit records whose output is constant.

    Parameters
    ----------
    measured : iterable of Spectra

    Raises
    ------
    InputError
        All lines of an output except its mean are zero, within rounding.
    """
    for one in measured:
        size = np.abs(one.Y)
        if not np.max(size[:, 1:]) > CONSTANT * np.max(size[:, 0]):
            hint = "check the sensor, and the column that --y selects"
            raise InputError("the output is constant: there is nothing to fit", one.name, None, hint)


def is_open(measured: Sequence[Spectra]) -> bool:
    """Whether the hold of any record is unknown."""
    return any(one.hold is None for one in measured)


def read_as(measured: Sequence[Spectra], hold: str) -> list[Spectra]:
    """Return the records, with `hold` assumed for those whose hold is unknown."""
    taken = [copy.copy(one) if one.hold is None else one for one in measured]
    for one in taken:
        one.hold = hold if one.hold is None else one.hold
    return taken
