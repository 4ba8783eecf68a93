"""Transform records: one record into its spectra, several into realisations of one excitation."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from gsid.base.bands import within
from gsid.base.errors import InputError
from gsid.base.hold import DECLARE
from gsid.records.periods import split_periods
from gsid.records.record import Record
from gsid.spectrum.excited import above_noise, large_lines, warn_of_slip
from gsid.spectrum.lines import period_lines
from gsid.spectrum.spectra import DIGEST_LENGTH, Spectra


def spectra(record: Record, *, period: int | None = None, settle: int | None = None) -> Spectra:
    """Transform each good period of a record.

    Parameters
    ----------
    record : Record
    period, settle : int, optional
        Period and settling [samples]. Default: the values of the record, else found from the data.

    Returns
    -------
    Spectra

    Raises
    ------
    InputError
        u does not repeat, there are fewer than two good periods, or no line of u exceeds its noise.
    """
    part = _realisation(record, period, settle)
    line = np.arange(part.period_samples // 2 + 1)
    Y = part.output(line)
    return Spectra(
        fs_hz=part.fs_hz,
        period_samples=part.period_samples,
        line=line,
        U=np.broadcast_to(part.input(line), Y.shape),
        Y=Y,
        n_spoiled=part.n_spoiled,
        settle_samples=part.settle_samples,
        excited=part.excited,
        hold=part.hold,
        u_unit=part.u_unit,
        y_unit=part.y_unit,
        name=part.name,
        turn=part.turn,
        digest=hashlib.sha256(record.y.tobytes()).hexdigest()[:DIGEST_LENGTH],
    )


def spectra_of(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
) -> list[Spectra]:
    """Transform one record or several. Spectra are returned as they are.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
    period, settle : int, optional
        As `spectra`. Not used for Spectra.

    Returns
    -------
    list of Spectra

    Raises
    ------
    ValueError
        The sequence is empty.
    InputError
        As `spectra`.
    """
    return [
        r if isinstance(r, Spectra) else spectra(r, period=period, settle=settle) for r in listed(records)
    ]


def listed(records: Record | Spectra | Sequence[Record | Spectra]) -> list[Record | Spectra]:
    """Convert one record or several to a list.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them

    Returns
    -------
    list of Record or Spectra

    Raises
    ------
    ValueError
        The sequence is empty.
    TypeError
        An item is not a record, for example the name of a file.
    """
    is_one = isinstance(records, str | Path) or not isinstance(records, Iterable)
    several = [records] if is_one else list(records)
    if not several:
        raise ValueError("no record was given")
    for one in several:
        if not isinstance(one, Record | Spectra):
            hint = "; read_record reads a file" if isinstance(one, str | Path) else ""
            hint = "; Record(u, y, fs_hz) makes one" if isinstance(one, np.ndarray | float) else hint
            raise TypeError(f"a record must be a Record or Spectra, got {type(one).__name__}{hint}")
    return several


def require_different(records: Sequence[Record | Spectra]) -> None:
    """Refuse a record that is given twice: it is no second realisation.

    Parameters
    ----------
    records : sequence of Record or Spectra
    """
    for one, other in itertools.combinations(records, 2):
        if _are_same(one, other):
            hint = "the same samples are no second realisation: leave one of them out"
            raise InputError("a record was given twice", other.name, one.name or None, hint)


def _are_same(one: Record | Spectra, other: Record | Spectra) -> bool:
    """Whether two records have the same samples, under whatever names."""
    if isinstance(one, Spectra) and isinstance(other, Spectra):
        return bool(one.digest) and one.digest == other.digest and np.array_equal(one.u, other.u)
    if not (isinstance(one, Record) and isinstance(other, Record)):
        return False
    return np.array_equal(one.y, other.y, equal_nan=True) and np.array_equal(one.u, other.u, equal_nan=True)


@dataclass(repr=False)
class Realisation:
    """One realisation divided into periods. Only the requested lines are transformed.

    Attributes
    ----------
    u_repeats : bool
        Whether all periods of the input are identical. The input is then known exactly, and has one row.
    large, excited : (K,) bool
        Lines 0 .. N/2 that are large enough to be excited, and those of them that exceed their noise.
    n_periods, n_spoiled, settle_samples, period_samples : int
    fs_hz : float
    turn : float
        As in Spectra.
    hold, u_unit, y_unit, name : str
    """

    _samples: tuple[np.ndarray, np.ndarray] | None  # of input (P or 1, N) and output (P, N)
    _lines: tuple[np.ndarray, np.ndarray | None]  # of both, from line 0 on, as far as already computed
    u_repeats: bool
    large: np.ndarray
    excited: np.ndarray
    n_periods: int
    n_spoiled: int
    settle_samples: int
    period_samples: int
    fs_hz: float
    turn: float
    hold: str | None
    u_unit: str
    y_unit: str
    name: str

    @property
    def f_hz(self) -> np.ndarray:
        """Frequencies of the lines, (K,) [Hz]."""
        return np.arange(len(self.excited)) * (self.fs_hz / self.period_samples)

    def input(self, line: np.ndarray) -> np.ndarray:
        """Lines of the input, (P, len(line)) complex, or (1, len(line)) when it repeats."""
        return self._at(0, line)

    def output(self, line: np.ndarray) -> np.ndarray:
        """Lines of the output, (P, len(line)) complex."""
        return self._at(1, line)

    def _at(self, channel: int, line: np.ndarray) -> np.ndarray:
        known = self._lines[channel]
        if known is not None and line.max() < known.shape[1]:
            return known[:, line]
        return period_lines(self._samples[channel], line.astype(np.uint32), self.settle_samples)


def realisations(
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
) -> list[Realisation]:
    """Divide records of one experiment into periods, and find their excited lines.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        One per realisation.
    period, settle : int, optional
        Period and settling [samples]. Default: the values of each record, else found from its data. Not used
        for Spectra.

    Returns
    -------
    list of Realisation

    Raises
    ------
    InputError
        As `spectra`; or the realisations differ in period, sample rate, hold or units, or are the same.
    ValueError
        The sequence is empty.
    """
    several = listed(records)
    require_different(several)
    parts = [_realisation(record, period, settle) for record in several]
    for part in parts[1:]:
        require_same(parts[0], part)
    return parts


def common_lines(parts: list[Realisation], band: tuple[float, float] | None) -> np.ndarray:
    """Lines within the band [Hz] that every realisation excites, (F,) int; InputError if there is none."""
    first = parts[0]
    chosen = np.logical_and.reduce([part.excited for part in parts]) & within(first.f_hz, band)
    if not chosen.any():
        where = "" if band is None else f" within {band[0]:g}:{band[1]:g} Hz"
        f_hz = first.f_hz[first.excited]
        raise InputError(
            f"no line{where} is excited in every record",
            first.name,
            None,
            f"{first.name or 'the first record'} has lines {f_hz[0]:g} .. {f_hz[-1]:g} Hz",
        )
    return np.flatnonzero(chosen)


def rejected_lines(
    parts: Sequence[Realisation], used: np.ndarray, band: tuple[float, float] | None
) -> np.ndarray:
    """Lines within the band that are large enough in at least one realisation, but not used, (R,) int."""
    rejected = np.logical_or.reduce([part.large for part in parts]) & within(parts[0].f_hz, band)
    rejected[used] = False
    return np.flatnonzero(rejected)


def _realisation(record: Record | Spectra, period: int | None, settle: int | None) -> Realisation:
    if isinstance(record, Spectra):
        samples, lines, u_repeats = None, (record.U, record.Y), False
        large, excited = large_lines(record.U, record.period_samples), record.excited
        n_period, n_settle, n_spoiled = record.period_samples, record.settle_samples, record.n_spoiled
        n_periods, turn = record.n_periods, record.turn
    else:
        periods = split_periods(record, period=period, settle=settle)
        n_period, n_settle, n_spoiled = periods.period_samples, periods.settle_samples, periods.n_spoiled
        n_periods, u_repeats, turn = len(periods.y), periods.u_repeats, periods.turn
        samples = (periods.u[:1] if u_repeats else periods.u, periods.y)
        large, excited, U = _input_lines(samples[0], n_settle)
        lines = (U, None)
        warn_of_slip(record.name, U, n_period)
        if not excited.any():
            what = "u has no line above its noise"
            raise InputError(what, record.name, hint="excite the axis more, or select the input with --u")
    return Realisation(
        samples,
        lines,
        u_repeats,
        large,
        excited,
        n_periods,
        n_spoiled,
        n_settle,
        n_period,
        record.fs_hz,
        turn,
        record.hold,
        record.u_unit,
        record.y_unit,
        record.name,
    )


def _input_lines(u: np.ndarray, n_settle: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find large and excited lines, and compute the lines of each period up to the last large one.

    As `excited_lines`, but it does not transform every period at every line: the mean period shows which
    lines are large.
    """
    n_period = u.shape[1]
    line = np.arange(n_period // 2 + 1, dtype=np.uint32)
    mean = period_lines(u.mean(axis=0)[None], line, n_settle)
    large = large_lines(mean, n_period)
    if len(u) == 1:
        return large, large, mean
    n_kept = int(np.flatnonzero(large)[-1]) + 1 if large.any() else 1
    U = period_lines(u, line[:n_kept], n_settle)
    return large, np.pad(above_noise(U, large[:n_kept]), (0, len(line) - n_kept)), U


class Measured(Protocol):
    """A measurement with one excitation: a realisation, spectra or a frequency response."""

    period_samples: int
    fs_hz: float
    hold: str | None
    u_unit: str
    y_unit: str
    name: str


def require_same(first: Measured, other: Measured) -> None:
    """Refuse to combine records that differ in period, rate, hold or units (InputError)."""
    for what in ("period_samples", "fs_hz", "hold", "u_unit", "y_unit"):
        ours, theirs = getattr(first, what), getattr(other, what)
        if ours != theirs:
            raise InputError(
                f"the records differ in {what}",
                other.name,
                f"{theirs!r}, not {ours!r} as in {first.name or 'the first'}",
                DECLARE if what == "hold" else "give records of one experiment only",
            )
