"""Ends of the range at which samples accumulate: where a sensor is clipped, or the axis is at a stop."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from gsid.records.record import Record

LEAST = 10
"""Samples at an end: fewer are a reversal that was sampled often, or the same one of each period."""
RATIO = 5.0
"""Least ratio to the samples at any of the next values: at the reversal of a rounded motion it is 2.4."""
NEXT = 10
"""Values compared: with a held sensor some last for a sample only, as where its periods meet."""
SAME = 1e-9
"""Of the range: values that differ by less are one. Rounding joins some values near the top of a sine."""


@dataclass(frozen=True)
class End:
    """One end of the range of the output, at which samples accumulate.

    Attributes
    ----------
    value : float
        The largest or the smallest output [y_unit].
    share : float
        Share of the samples that are exactly there.
    """

    value: float
    share: float


def clipped_ends(record: Record) -> list[End]:
    """Ends of the range of the output with at least five times as many samples as any of the next values.

    A clipped sensor or amplifier gives such an end, and so does an axis at a stop or at rest if the record
    has no noise there. Noise that is added after the limit hides it.

    Parameters
    ----------
    record : Record

    Returns
    -------
    list of End
        The smallest output first.
    """
    y = record.y[record.valid]
    ends = ((sign, _upper_end(sign * y)) for sign in (-1, 1))
    return [End(sign * end.value + 0.0, end.share) for sign, end in ends if end is not None]  # not -0


def _upper_end(y: np.ndarray) -> End | None:
    """The largest value, if samples accumulate there."""
    counts: list[int] = []
    below, same = y, SAME * np.ptp(y)
    for _ in range(1 + NEXT):
        if not len(below):
            break
        inside = below < below.max() - same
        counts.append(int(np.sum(~inside)))
        below = below[inside]
    if len(counts) < 2 or counts[0] < max(LEAST, RATIO * max(counts[1:])):
        return None
    return End(float(y.max()), counts[0] / len(y))


def clipped_text(records: Iterable[Record]) -> str:
    """The ends of all records in words, as a clause; empty if there are none.

    Parameters
    ----------
    records : iterable of Record
    """
    where = [
        f"{one.name or 'one record'} at {end.value:.4g} {one.y_unit}".rstrip()
        + f" ({end.share:.2%} of its samples)"
        for one in records
        for end in clipped_ends(one)
    ]
    if not where:
        return ""
    return (
        "the output stays at an end of its range (a clipped sensor, or an axis at a stop or at rest): "
        + ", ".join(where)
    )
