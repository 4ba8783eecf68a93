"""A part of a record in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsid.base.arguments import real_number
from gsid.base.errors import InputError
from gsid.records.record import Record


def cut(record: Record, from_s: float = 0.0, to_s: float | None = None) -> Record:
    """Keep the samples of an interval of time.

    The stated period stays if the part has more than one. Settling is found from the part: that of the whole
    record may lie outside it.

    Parameters
    ----------
    record : Record
    from_s : float
        Time of the first sample that is kept, from the begin of the record [s].
    to_s : float, optional
        Time of the first sample that is not kept [s]; default: the end.

    Returns
    -------
    Record
        Its first sample is at time 0. Its name states the interval.

    Raises
    ------
    InputError
        The interval has no sample, or lies outside the record.
    """
    length = len(record) / record.fs_hz
    begin = real_number("from_s", from_s, "s")
    end = length if to_s is None else real_number("to_s", to_s, "s")
    where = record.name, f"{begin:g} to {end:g} s"
    if not (begin >= 0 and end <= length):
        raise InputError("the interval is not in the record", *where, f"the record has 0 to {length:.6g} s")
    # Six digits of a sample: a time such as 0.07 s at 100 Hz is not one sample late by its rounding.
    first, last = (int(np.ceil(round(time * record.fs_hz, 6))) for time in (begin, end))
    if first >= last:
        raise InputError("the interval has no sample", *where, f"the record has 0 to {length:.6g} s")
    kept = slice(first, last)
    period = record.period_samples
    return replace(
        record,
        u=record.u[kept],
        y=record.y[kept],
        valid=record.valid[kept],
        columns={name: column[kept] for name, column in record.columns.items()},
        period_samples=period if period is not None and period < last - first else None,
        settle_samples=None,
        name=f"{record.name} {first / record.fs_hz:.6g} to {last / record.fs_hz:.6g} s".strip(),
    )


def in_unit(record: Record, scale: float, u_unit: str) -> Record:
    """The record with its command in another unit.

    Parameters
    ----------
    record : Record
    scale : float
        Present number for a command of 1 `u_unit`: 17.9 for volts if 179 is 10 V.
    u_unit : str

    Returns
    -------
    Record

    Raises
    ------
    ValueError
        The scale is 0 or not finite.
    """
    if not (np.isfinite(scale) and scale):
        raise ValueError(f"the scale must be a finite number other than 0, not {scale}")
    return replace(record, u=record.u / scale, u_unit=u_unit)
