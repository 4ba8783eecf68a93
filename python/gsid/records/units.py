"""Units of the columns of a record, and the factors that convert them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gsid.base.errors import InputError, choose
from gsid.records.record import Record


def in_units(
    record: Record, u: str, y: str, units: Mapping[str, str], factors: Mapping[str, float]
) -> Record:
    """The record with some columns multiplied by factors, and in the units that are stated.

    Parameters
    ----------
    record : Record
    u, y : str
        Names of the columns of input and output.
    units : mapping of str
        Unit after the conversion, by column. A record keeps the units of input and output only.
    factors : mapping of float
        By column.

    Raises
    ------
    InputError
        There is no such column, a factor is 0 or not finite, or the unit after the conversion is not stated.
    """
    names = [u, y, *record.columns]
    for name in (*units, *factors):
        if name not in names:
            hint = f"{choose(name, names)}; --unit and --factor take NAME=VALUE"
            raise InputError(f"no column named {name}", record.name, None, hint)
    for name, factor in factors.items():
        if not math.isfinite(factor) or factor == 0:
            raise InputError("a factor is not a number other than 0", f"{record.name}, {name}", factor)
        if name in (u, y) and name not in units:
            hint = f"state it: --unit '{name}=UNIT'"
            raise InputError("the unit after the factor is not known", f"{record.name}, {name}", factor, hint)
    for name in units:
        if name not in (u, y):
            hint = "leave it out; a factor is enough"
            raise InputError("units are kept of input and output only", record.name, name, hint)
    columns = {name: _times(column, factors.get(name)) for name, column in record.columns.items()}
    return replace(
        record,
        u=_times(record.u, factors.get(u)),
        y=_times(record.y, factors.get(y)),
        u_unit=units.get(u, record.u_unit),
        y_unit=units.get(y, record.y_unit),
        columns=columns,
    )


def _times(values: np.ndarray, factor: float | None) -> np.ndarray:
    return values if factor is None else values * factor
