"""Unchecked contents of a file, common to the readers and writers of all formats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gsid.base.errors import InputError
from gsid.records.record import Record

KEYS = ("fs_hz", "period_samples", "settle_samples", "u_unit", "y_unit", "hold")
TIME_NAMES = ("t_s", "t")
RESERVED = (*TIME_NAMES, "u", "y", "valid", "meta")  # not allowed as names of other columns or notes
DAMAGED = "the file is damaged, cut short, or not of this kind"
DAMAGED_HINT = "write or copy it again"


@dataclass
class Raw:
    """Contents of a file before any check."""

    columns: dict[str, np.ndarray]
    keys: dict[str, object]
    where: Callable[[str, int], str]  # column, sample -> position in the file
    what: str = "array"  # term for a column in this format
    listed: list[str] = field(default_factory=list)  # names of all columns in the file, read or not


def keys_of(record: Record) -> dict[str, object]:
    """Return the keys of a record, which are written in addition to the columns.

    Raises
    ------
    InputError
        A column or a note has a reserved name.
    """
    for name in record.columns:
        if name in RESERVED:
            raise InputError("a column has the name of another value", record.name, name, "rename the column")
    for key in record.meta:
        if key in (*KEYS, *RESERVED):
            hint = f"set the record's own {key}, or rename the note"
            raise InputError("a note has the name of another value", record.name, key, hint)
    keys = {key: getattr(record, key) for key in KEYS}
    return {key: value for key, value in keys.items() if value not in (None, "")}
