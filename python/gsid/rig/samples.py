"""Samples of a run as they arrive: detection of lost samples, and check of the echoed command."""

from __future__ import annotations

import numpy as np

from gsid.base.errors import InputError
from gsid.rig.frames import LOST_COUNT, SAMPLE
from gsid.rig.link import LinkError

GAP_HELD = 64  # samples lost in a row that count as a lost command: the 7-bit count of those may have wrapped
BAD_IN_A_ROW = 8  # periods
BAD_FACTOR = 4  # periods measured over periods requested
SAMPLES_MOST = 100_000_000  # of one run: 9 h at 3 kHz, 1.8 GB


def check_length(n_period: int, settle: int, periods: int) -> None:
    """Refuse a run that the memory of a computer cannot hold.

    Parameters
    ----------
    n_period : int
        Samples in a period.
    settle : int
        Samples that are discarded at the start.
    periods : int
        Good periods requested.

    Raises
    ------
    InputError
        They are more than `SAMPLES_MOST` samples.
    """
    n = settle + periods * n_period
    if n > SAMPLES_MOST:
        raise InputError(
            "the run is too long",
            "",
            f"{n:.4g} samples with settling, limit {SAMPLES_MOST:.4g}",
            "lower the number of periods or the period; measure the rest in further runs",
        )


class Echo:
    """Echo of the command, as the axis reports it: clipped and rounded, and the same in every period."""

    def __init__(self, table: np.ndarray) -> None:
        self.sent = table.astype(np.float32)
        self.known = np.full(len(table), np.nan, np.float32)  # echo of each sample of the period
        self.other = np.full(len(table), np.nan, np.float32)  # last different echo; it is adopted if repeated
        self.n_wrong = 0
        self.is_judged = False  # whether a whole period was compared with the command sent

    def check(self, tick: np.ndarray, echo: np.ndarray) -> np.ndarray:
        """Whether the echo of each sample, in ascending ticks, equals that of other periods."""
        good = np.empty(len(tick), bool)
        first = 0
        while first < len(tick):
            end = int(np.searchsorted(tick, tick[first] + len(self.sent)))
            good[first:end] = self._check_period(tick[first:end] % len(self.sent), echo[first:end])
            first = end
        self.n_wrong += int(np.count_nonzero(~good))
        return good

    def _check_period(self, phase: np.ndarray, echo: np.ndarray) -> np.ndarray:
        known = self.known[phase]
        good = np.isnan(known) | (echo == known) | (echo == self.other[phase])
        self.known[phase[good]] = echo[good]
        self.other[phase] = np.where(good, np.nan, echo)
        return good

    def judge(self) -> np.ndarray:
        """Compare a whole period with the command sent; LinkError if they differ by more than single samples.

        Returns
        -------
        (m,) ndarray of int
            Samples of the period whose echo is wrong.
        """
        lo, hi = np.quantile(self.known, [0.005, 0.995])  # limits of the clipping
        step = _step_of(self.known)
        error = np.abs(np.clip(self.known, lo, hi) - np.clip(self.sent, lo, hi))
        wrong = np.flatnonzero(error > 0.999 * step + 1e-6 * np.abs(self.sent).max())
        if np.ptp(self.known) == 0 and np.ptp(self.sent) > 0:
            wrong = np.arange(len(self.sent))
        self.n_wrong += len(wrong)
        if len(wrong) > max(1, 0.01 * len(self.sent)):
            worst = wrong[np.argmax(np.abs(self.known - self.sent)[wrong])]
            example = f"{self.known[worst]:g} at tick {worst} for {self.sent[worst]:g}"
            raise LinkError(
                "the axis reports another command than the one sent",
                "",
                f"{len(wrong)} samples of a period, {example}",
                "is the drive enabled? SAMPLE carries the command in force at its tick, in the unit in which "
                "it was sent, clipped and rounded at most: docs/reference/protocol.md",
            )
        self.known[wrong] = np.nan
        self.is_judged = True
        return wrong


def _step_of(values: np.ndarray) -> float:
    """Rounding step of values, of which a few may be wrong; near 0 if the values are not rounded."""
    levels, n = np.unique(values, return_counts=True)
    if n[n > 1].sum() > len(values) / 2:
        levels = levels[n > 1]
        n_wrong = 0
    else:
        n_wrong = 1 + len(levels) // 100  # each causes two small differences
    steps = np.sort(np.diff(levels))
    return float(steps[min(2 * n_wrong, len(steps) - 1)]) if len(steps) else 0.0


class Samples:
    """Received samples by tick, and which of their periods are good."""

    def __init__(self, table: np.ndarray, settle: int, requested: int) -> None:
        capacity = settle + (BAD_FACTOR * requested + 1) * len(table)
        self.period, self.settle, self.requested = len(table), settle, requested
        self.u = np.zeros(capacity)
        self.y = np.zeros(capacity)
        self.valid = np.zeros(capacity, bool)
        self.received = np.zeros(capacity, bool)  # received with finite numbers, valid or not
        self.echo = Echo(table)
        self.end = 0
        self.kept = 0  # samples below are in the journal
        self.good: list[bool] = []
        self.n_held = 0
        self._lost_count = 0
        self._last_held = -capacity - 1

    def take(self, got: np.ndarray, limit: int) -> bool:
        """Store received samples of ticks below `limit`; True if one of them is new."""
        limit = min(limit, len(self.u))
        got = got[(got["kind"] == SAMPLE) & (got["tick"] >= self.end) & (got["tick"] < limit)]
        got = got[np.diff(np.maximum.accumulate(got["tick"].astype(np.int64)), prepend=self.end - 1) > 0]
        if not len(got):
            return False
        tick = got["tick"].astype(np.int64)
        held_before = self._held_before(tick, got["flags"])
        finite = np.isfinite(got["a"]) & np.isfinite(got["b"])
        self.u[tick[finite]], self.y[tick[finite]] = got["a"][finite], got["b"][finite]
        self.received[tick] = finite
        good = finite & (tick - held_before > self.settle)
        good[good] = self.echo.check(tick[good], got["a"][good])
        self.valid[tick] = good
        self.end = int(tick[-1]) + 1
        self._judge_echo()
        while self.settle + (len(self.good) + 1) * self.period <= self.end:
            first = self.settle + len(self.good) * self.period
            self.good.append(bool(self.valid[first : first + self.period].all()))
        return True

    def _judge_echo(self) -> None:
        if not self.echo.is_judged and not np.isnan(self.echo.known).any():
            try:
                wrong = self.echo.judge()
            except LinkError:  # the input of the measured samples is unknown
                self.valid[: self.end] = False
                raise
            for sample in wrong:
                self.valid[sample : self.end : self.period] = False
                self.kept = 0

    def _held_before(self, tick: np.ndarray, flags: np.ndarray) -> np.ndarray:
        """For each sample, the last tick at which a lost command is known to have disturbed the axis."""
        count = ((flags & LOST_COUNT) >> 1).astype(np.int64)
        lost = np.diff(count, prepend=self._lost_count) % 128
        gap = np.diff(tick, prepend=self.end - 1) > GAP_HELD
        held = np.maximum.accumulate(np.where((lost > 0) | gap, tick, self._last_held))
        self.n_held += int(lost.sum())
        self._lost_count, self._last_held = int(count[-1]), int(held[-1])
        return held

    @property
    def n_good(self) -> int:
        return sum(self.good)

    @property
    def n_lost(self) -> int:
        return len(self.good) - self.n_good

    def hopeless(self) -> bool:
        """Whether too many periods are lost to continue."""
        in_a_row = len(self.good) >= BAD_IN_A_ROW and not any(self.good[-BAD_IN_A_ROW:])
        return in_a_row or len(self.good) >= BAD_FACTOR * self.requested
