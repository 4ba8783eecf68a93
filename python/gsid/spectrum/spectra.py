"""Lines of each period of a record: the transform, and which lines are excited.

The phases of the lines count from the record's first sample on, whatever was thrown away to settle.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gsid.base.cached import cached_property
from gsid.base.errors import InputError
from gsid.spectrum.lines import covariance, sample_variance, variance_between_lines

CONSTANT = 1e-13  # largest line of an output over its mean, by rounding
DIGEST_LENGTH = 16  # hexadecimal digits


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
        One row per good period, units `u_unit` and `y_unit`; |U| is the amplitude of the sine, its phase that
        of a cosine from the record's first sample on.
    n_spoiled : int
        Periods left out because samples of them were lost.
    settle_samples : int
    excited : (K,) bool
        See `gsid.spectrum.excited.excited_lines`.
    hold : {"zoh", "none"} or None
        As in `gsid.Record`.
    u_unit, y_unit, name : str
    digest : str
        Of the record's output samples, whatever was thrown away to settle: which measurement it is. Empty
        where there is no record.
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
    digest: str = ""

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the lines, (K,) [Hz]."""
        return self.line * (self.fs_hz / self.period_samples)

    @property
    def n_periods(self) -> int:
        """Good periods P."""
        return len(self.U)

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
        """Variance of one period's Y as the mean over periods sees it, (K,), see `variance_between_lines`.

        Where periods in between were lost, `var_y`.
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
    """Refuse records to fit whose output is constant.

    Parameters
    ----------
    measured : iterable of Spectra

    Raises
    ------
    InputError
        An output has no lines but its mean, to rounding.
    """
    for one in measured:
        size = np.abs(one.Y)
        if not np.max(size[:, 1:]) > CONSTANT * np.max(size[:, 0]):
            hint = "look at the sensor, and at the column that --y names"
            raise InputError("the output is constant: there is nothing to fit", one.name, None, hint)


class HasOutput(Protocol):
    """A record of one output or several, or its spectra."""

    name: str

    @property
    def y(self) -> np.ndarray:
        """Output."""
        ...


def require_not_fitted(fitted: Sequence[HasOutput], held_out: Sequence[HasOutput]) -> None:
    """Refuse to judge on a record that is fitted.

    Parameters
    ----------
    fitted, held_out : sequence of Record, MimoRecord or Spectra

    Raises
    ------
    InputError
        A record kept out is one of those fitted, whatever its name.
    """
    for one in held_out:
        if any(np.array_equal(one.y, other.y) for other in fitted):
            hint = "leave it out of the records to fit, or judge on another"
            raise InputError("a record is fitted and kept out", one.name, None, hint)


def is_open(measured: Sequence[Spectra]) -> bool:
    """Whether a record does not say whether its input was held."""
    return any(one.hold is None for one in measured)


def read_as(measured: Sequence[Spectra], hold: str) -> list[Spectra]:
    """The records, with those that do not say it read one way."""
    taken = [copy.copy(one) if one.hold is None else one for one in measured]
    for one in taken:
        one.hold = hold if one.hold is None else one.hold
    return taken
