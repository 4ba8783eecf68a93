"""What a reader of any format gives, before it is checked; what a writer of any format takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gsid.base.errors import InputError
from gsid.records.record import Record

KEYS = ("fs_hz", "period_samples", "settle_samples", "u_unit", "y_unit", "hold")
TIME_NAMES = ("t_s", "t")
RESERVED = (*TIME_NAMES, "u", "y", "valid", "meta")  # names that no other column or note may have
STEP_TOLERANCE = 0.01  # of a step, beyond the resolution the times were written with
JITTER_STATED = 0.5  # of a step, where the user states the rate: times are then those of writing
DAMAGED = "the file is damaged, cut short, or not of this kind"
DAMAGED_HINT = "write or copy it again"


@dataclass
class Raw:
    """What a file holds, before any of it is checked."""

    columns: dict[str, np.ndarray]
    keys: dict[str, object]
    where: Callable[[str, int], str]  # column, sample -> place in the file
    what: str = "array"  # what the file calls a column
    listed: list[str] = field(default_factory=list)  # names of the columns in the file, read or not


def keys_of(record: Record) -> dict[str, object]:
    """What is written beside the columns: the keys that the record has.

    Raises
    ------
    InputError
        A column or a note would be read as something else.
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
