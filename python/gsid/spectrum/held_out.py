"""Checks of the records that are held out for validation."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsid.base.errors import InputError
from gsid.records.mimo import MimoRecord
from gsid.records.periods import split_periods
from gsid.records.record import Record
from gsid.spectrum.spectra import Spectra

_log = logging.getLogger(__name__)

# Largest rms difference of two inputs that count as the same, relative to the larger: well above the noise of
# a measured input, and below the difference of another level (its ratio) or of other phases (1.4).
SAME_INPUT = 0.05


def check_held_out(
    fitted: Sequence[Record | MimoRecord | Spectra], held_out: Sequence[Record | MimoRecord | Spectra]
) -> None:
    """Refuse a held-out record that is also fitted, and warn of one with the input of a fitted one.

    With the same input the errors of a model are the same too: the fit has already made them small, and only
    the noise is new. A shift in time does not count, because a periodic input may be recorded from any
    moment on.

    Parameters
    ----------
    fitted, held_out : sequence of Record, MimoRecord or Spectra

    Raises
    ------
    InputError
        A held-out record has the same output as a fitted one. The names are not compared.
    """
    for one in held_out:
        if any(np.array_equal(one.y, other.y) for other in fitted):
            hint = "remove it from the records to fit, or validate on another record"
            raise InputError("a held-out record is also fitted", one.name, None, hint)
    inputs = [(_input_of(other), other.name) for other in fitted] if held_out else []
    for one in held_out:
        own = _input_of(one)
        same = [name for of_other, name in inputs if own and of_other and own.is_same(of_other)]
        if same:
            _log.warning(
                "%s has the same input as %s: it tests the noise only, not the model; hold out another "
                "realisation of the input (another --seed) or another level",
                one.name or "a held-out record",
                same[0] or "a fitted record",
            )


@dataclass(eq=False)
class _Input:
    """Mean period of the inputs of a record: (n_u, N/2) complex lines from 1 on."""

    lines: np.ndarray
    period_samples: int
    fs_hz: float

    def is_same(self, other: _Input) -> bool:
        """Whether the two are the same, but for a shift in time."""
        n = self.period_samples
        if (n, self.fs_hz, len(self.lines)) != (other.period_samples, other.fs_hz, len(other.lines)):
            return False
        cross = np.sum(self.lines * np.conj(other.lines), axis=0)
        shift = int(np.argmax(np.fft.irfft(np.concatenate([[0], cross]), n)))
        turn = np.exp(-2j * np.pi * shift / n * np.arange(1, n // 2 + 1))
        size = max(np.linalg.norm(self.lines), np.linalg.norm(other.lines))
        return bool(np.linalg.norm(self.lines - other.lines * turn) < SAME_INPUT * size)


def _input_of(record: Record | MimoRecord | Spectra) -> _Input | None:
    """None if the input is not periodic: then it is not compared."""
    if isinstance(record, Spectra):
        return _Input(record.u[None, 1:], record.period_samples, record.fs_hz)
    one_each = record.pairs()[: record.u.shape[1]] if isinstance(record, MimoRecord) else [record]
    try:
        periods = [split_periods(one).u.mean(axis=0) for one in one_each]
    except InputError:
        return None
    n = len(periods[0])
    if any(len(period) != n for period in periods):
        return None
    lines = np.array([np.fft.rfft(period)[1:] * 2 / n for period in periods])
    return _Input(lines, n, record.fs_hz)
