"""Position of an axis: the integral of its measured rate without the offset of the gyro."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gsid.base.errors import InputError
from gsid.records.periods import split_periods
from gsid.records.record import Record

RATE = "/s"  # end of the unit of a rate


@dataclass(frozen=True, repr=False, eq=False)
class Position:
    """Position over time, 0 at the first sample.

    Attributes
    ----------
    angle : (n,) float64
        Position [unit].
    offset, std_offset : float
        Offset of the gyro that was subtracted, and its standard deviation [unit/s] (POS-1); NaN if the
        offset was given.
    lo, hi : float
        Least and largest position in the record [unit].
    fs_hz : float
    unit : str
        Unit of the output without "/s".
    name : str
    """

    angle: np.ndarray
    offset: float
    std_offset: float
    lo: float
    hi: float
    fs_hz: float
    unit: str
    name: str = ""

    @property
    def std_end(self) -> float:
        """Standard deviation of the last position against the first by the error of the offset [unit]."""
        return self.std_offset * (len(self.angle) - 1) / self.fs_hz

    def within(self, lo: float, hi: float) -> bool:
        """Whether the position stays between two limits.

        Parameters
        ----------
        lo, hi : float
            From the position at the first sample [unit].
        """
        return lo <= self.lo and self.hi <= hi

    def from_deg(self, angle_deg: tuple[float, float]) -> tuple[float, float]:
        """Angles in the unit of the position.

        Parameters
        ----------
        angle_deg : (lo, hi)
            [deg]

        Raises
        ------
        InputError
            The unit is neither deg nor rad.
        """
        if self.unit not in ("deg", "rad"):
            hint = "state the unit: --unit NAME=deg/s or NAME=rad/s, with --factor if it needs one"
            raise InputError("the position is not an angle", self.name, self.unit or "no unit", hint)
        lo, hi = angle_deg
        return (lo, hi) if self.unit == "deg" else (math.radians(lo), math.radians(hi))

    def __repr__(self) -> str:
        return f"Position({self.name or 'unnamed'}: {self.words})"

    @property
    def words(self) -> str:
        """Range and offset."""
        unit = f" {self.unit}" if self.unit else ""
        error = "" if math.isnan(self.std_offset) else f" +- {self.std_offset:.2g}"
        return (
            f"position {self.lo:.4g} to {self.hi:.4g}{unit} from the start, "
            f"less an offset of {self.offset:.4g}{error}{unit}/s"
        )


def position(
    record: Record,
    *,
    period: int | None = None,
    settle: int | None = None,
    offset: float | None = None,
) -> Position:
    """Integrate the output, a rate (thesis, figures 4.5, 4.12 and 4.19).

    Parameters
    ----------
    record : Record
        With a periodic input, or with an offset that is known. At a lost sample the rate is interpolated.
    period, settle : int, optional
        Samples; default: what the record states, else found from the data.
    offset : float, optional
        Of the gyro, unit of y; for example the mean of a record with zero input. Default: the mean output
        over the periods, in which the axis returns to where it was.

    Returns
    -------
    Position

    Raises
    ------
    InputError
        y is not a rate, the input does not repeat and no offset is given, or no sample is valid.
    """
    if record.y_unit and not record.y_unit.endswith(RATE):
        hint = "a rate has a unit as deg/s"
        raise InputError("the output is not a rate", record.name, record.y_unit, hint)
    if not record.valid.any():
        raise InputError("no valid samples", record.name, None, "measure again")
    std = math.nan
    if offset is None:
        periods = split_periods(record, period=period, settle=settle)
        means = periods.y.mean(axis=1) + periods.turn * periods.number
        offset, std = float(means.mean()), float(means.std(ddof=1) / math.sqrt(len(means)))
    n = len(record)
    there = np.flatnonzero(record.valid)
    rate = np.interp(np.arange(n), there, record.y[there]) - offset
    angle = np.concatenate([[0.0], np.cumsum(rate[1:] + rate[:-1])]) / (2 * record.fs_hz)
    seen = angle[record.valid]
    return Position(
        angle,
        offset,
        std,
        float(seen.min()),
        float(seen.max()),
        record.fs_hz,
        record.y_unit.removesuffix(RATE),
        record.name,
    )
