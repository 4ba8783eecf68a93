"""Drive an axis over a serial line and collect its samples; docs/reference/protocol.md defines the frames."""

from __future__ import annotations

import contextlib
import datetime
import os
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gsid._lib import ffi, lib
from gsid.base.errors import InputError
from gsid.records.record import Record
from gsid.rig.journal import Journal, JournalError, RunDescription
from gsid.rig.watch import ROUNDING, RunLimits, Watch

if TYPE_CHECKING:
    from gsid.excitation.multisine import Multisine
    from gsid.response.streaming import StreamingFrf

BAUD = 921600
COMMAND = lib.GSID_FRAME_COMMAND
SAMPLE = lib.GSID_FRAME_SAMPLE
HELLO = lib.GSID_FRAME_HELLO
STOP = lib.GSID_FRAME_STOP
RESULT = lib.GSID_FRAME_RESULT
COMMAND_LOST = lib.GSID_FLAG_COMMAND_LOST
LOST_COUNT = lib.GSID_FLAG_LOST_COUNT
VERSION = lib.GSID_LINK_VERSION
SESSION_MAX = lib.GSID_LINK_SESSION_MAX

#: numpy's view of the C struct gsid_frame.
FRAME = np.dtype([("kind", "u1"), ("flags", "u1"), ("tick", "u4"), ("a", "f4"), ("b", "f4")], align=True)
assert FRAME.itemsize == ffi.sizeof("gsid_frame")

WINDOW = 512  # commands under way: 170 ms at 3 kHz, more than an operating system sleeps
QUIET_S = 2.0  # without a reply for so long, what is under way is sent again
SILENT_S = 10.0  # without a reply for so long, the axis is given up
SILENCE_STOP_S = 0.2  # an axis that gets no frame for so long sets its command to zero
STOP_WAIT_S = 0.5  # for the answer to STOP
KEEP_ALIVE_S = 0.05  # the host sends something at least so often
GAP_HELD = 64  # samples lost in a row that stand for a lost command: the count of those may have wrapped
REST_S = 0.5  # of command zero before a run with a limit on travel: what the gyro shows then is its offset
BAD_IN_A_ROW = 8  # periods
BAD_FACTOR = 4  # periods measured over periods asked for


class LinkError(InputError):
    """The line, or what is at its other end, does not let a measurement be finished.

    Attributes
    ----------
    record : Record or None
        What was measured until then; None when not one sample was.
    """

    record: Record | None = None


class LimitError(LinkError):
    """The planned command, or what the axis does, passes a limit of the run; the command is zero."""


class Stopped(KeyboardInterrupt):
    """A run was stopped by Ctrl-C, another signal or `should_stop`; the command is zero.

    Attributes
    ----------
    record : Record or None
        What was measured until then; None when not one sample was.
    """

    record: Record | None = None


def frames(kind: int, tick=0, a=0.0, b=0.0, flags=0) -> np.ndarray:
    """Make frames.

    Parameters
    ----------
    kind : int
        COMMAND, SAMPLE, HELLO, STOP or RESULT.
    tick : (n,) array_like of int, or int
        Tick that the frame is about, modulo 2^32; of HELLO the session's id.
    a, b : (n,) array_like, or float
        Values, unit of the command or of the output.
    flags : (n,) array_like of int, or int

    Returns
    -------
    (n,) ndarray of FRAME
    """
    made = np.zeros(np.broadcast(np.atleast_1d(tick), a, b, flags).shape, FRAME)
    made["kind"], made["tick"], made["a"], made["b"], made["flags"] = kind, tick, a, b, flags
    return made


def hello_frame(session: int, a: float = 0.0, b: float = 0.0) -> np.ndarray:
    """Make a HELLO of this version of the protocol.

    Parameters
    ----------
    session : int
        1 .. SESSION_MAX.
    a, b : float
        In an axis's answer: ticks per second [Hz], and commands it can queue.

    Returns
    -------
    (1,) ndarray of FRAME
    """
    return frames(HELLO, session, a, b, VERSION)


def encode(block: np.ndarray, session: int) -> bytes:
    """Write frames as bytes.

    Parameters
    ----------
    block : (n,) ndarray of FRAME
    session : int
        Id of the session, from which the check starts.

    Returns
    -------
    bytes
        The frames one after the other.

    Raises
    ------
    ValueError
        A frame is of no known kind.
    """
    out = bytearray(len(block) * lib.GSID_LINK_FRAME_MAX)
    source, target, size = ffi.from_buffer("gsid_frame[]", block), ffi.from_buffer("uint8_t[]", out), 0
    for i in range(len(block)):
        written = lib.gsid_link_encode(source + i, session, target + size)
        if written == 0:
            raise ValueError(f"frame {i} is of unknown kind {block['kind'][i]}")
        size += written
    return bytes(out[:size])


class Receiver:
    """Find the frames in a stream of bytes: HELLO always, others of one session.

    Parameters
    ----------
    session : int
        Id of the session; 0 before there is one.
    follows_hello : bool
        At an axis: each HELLO of this version of the protocol sets the session.

    Attributes
    ----------
    n_frames, n_damaged, n_garbage : int
        Good frames, frames whose check failed (those of other sessions too), bytes thrown away.
    """

    def __init__(self, session: int = 0, follows_hello: bool = False) -> None:
        self._link = ffi.new("gsid_link *")
        self._follows_hello = follows_hello
        self.session = session

    n_frames = property(lambda self: self._link.n_frames)
    n_damaged = property(lambda self: self._link.n_damaged)
    n_garbage = property(lambda self: self._link.n_garbage)

    @property
    def session(self) -> int:
        """Id of the session whose frames are accepted."""
        return self._link.session

    @session.setter
    def session(self, session: int) -> None:
        self._link.session = session

    def __repr__(self) -> str:
        return (
            f"Receiver({self.n_frames} frames, {self.n_damaged} damaged, {self.n_garbage} bytes of garbage)"
        )

    def decode(self, data: bytes) -> np.ndarray:
        """Take bytes off the line.

        Parameters
        ----------
        data : bytes
            Any piece of the stream.

        Returns
        -------
        (n,) ndarray of FRAME
            The good frames that ended in this piece.
        """
        found = np.zeros((self._link.n_held + len(data)) // FRAME_BYTES + 1, FRAME)
        source, target = ffi.from_buffer("uint8_t[]", data), ffi.from_buffer("gsid_frame[]", found)
        used, n_found, n_new = 0, 0, ffi.new("size_t *")
        while used < len(data):  # more than once when there is a HELLO in it
            used += lib.gsid_link_decode(
                self._link, len(data) - used, source + used, len(found) - n_found, target + n_found, n_new
            )
            n_found += n_new[0]
            if n_new[0] and self._follows_hello:
                self._follow(found[n_found - 1])
        return found[:n_found]

    def _follow(self, frame: np.void) -> None:
        if frame["kind"] == HELLO and frame["flags"] == VERSION and 1 <= frame["tick"] <= SESSION_MAX:
            self.session = int(frame["tick"])


FRAME_BYTES = len(encode(frames(STOP), 0))


class Transport(Protocol):
    """Anything that carries bytes both ways; what goes wrong is an OSError."""

    def read(self) -> bytes:
        """Return what has come, at once if anything has; b"" after a twentieth of a second without a byte."""

    def write(self, data: bytes) -> None:
        """Send all of `data`."""

    def close(self) -> None:
        """Let go of the line."""


class SerialTransport:
    """A serial port, or a pseudo-terminal, at 921600 baud 8N1.

    Parameters
    ----------
    port : str
        Such as /dev/ttyUSB0, COM3, or the path that `gsid simulate` prints.

    Raises
    ------
    LinkError
        The port cannot be opened.
    """

    def __init__(self, port: str) -> None:
        import serial

        try:
            self._serial = serial.Serial(port, BAUD, timeout=0.05, write_timeout=SILENT_S, exclusive=True)
        except (serial.SerialException, ValueError) as error:
            raise LinkError(
                "the port cannot be opened",
                port,
                str(error),
                "--port is the path of the axis; `gsid simulate` prints that of a simulated one",
            ) from error

    def read(self) -> bytes:
        return self._serial.read(1) + self._serial.read(min(self._serial.in_waiting, 65536))

    def write(self, data: bytes) -> None:
        self._serial.write(data)

    def close(self) -> None:
        self._serial.close()


def new_session(last: int) -> int:
    """Draw the id of a session, other than the last one."""
    return (last + 1 + secrets.randbelow(SESSION_MAX - 1)) % SESSION_MAX or SESSION_MAX


class Link:
    """The host's end of the line.

    Parameters
    ----------
    transport : Transport
    name : str
        Of the port, for messages.
    should_stop : callable, optional
        True: what waits for the axis ends with `Stopped`.
    """

    def __init__(
        self, transport: Transport, name: str = "", should_stop: Callable[[], bool] | None = None
    ) -> None:
        self._transport = transport
        self._should_stop = should_stop
        self.name = name
        self.receiver = Receiver()
        self.longest_silence_s = 0.0  # of this end, while the axis runs

    @classmethod
    def open(cls, port: str, should_stop: Callable[[], bool] | None = None) -> Link:
        """Open a serial port or a pseudo-terminal; LinkError when that fails."""
        return cls(SerialTransport(port), port, should_stop)

    def __repr__(self) -> str:
        return f"Link({self.name}: {self.receiver!r})"

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._transport.close()

    def send(self, block: np.ndarray) -> None:
        """Send frames, (n,) of FRAME; LinkError when the port is gone."""
        try:
            self._transport.write(encode(block, self.receiver.session))
        except OSError as error:
            raise self._gone(error) from error

    def receive(self) -> np.ndarray:
        """Return what has come, (n,) of FRAME, nothing after 50 ms; LinkError when the port is gone."""
        try:
            return self.receiver.decode(self._transport.read())
        except OSError as error:
            raise self._gone(error) from error

    def check_stop(self) -> None:
        """Raise `Stopped` when `should_stop` says so."""
        if self._should_stop is not None and self._should_stop():
            raise Stopped("stopped")

    def _gone(self, error: OSError) -> LinkError:
        return LinkError(
            "the port is gone", self.name, str(error), "check cable and power of the axis, and start again"
        )

    def hello(self) -> tuple[float, int]:
        """Open a session: the axis starts again at tick 0.

        Returns
        -------
        fs_hz : float
            Ticks per second of the axis [Hz].
        n_queue : int
            Commands that it can keep.

        Raises
        ------
        LinkError
            No answer in 10 s, an axis of another version of the protocol, one whose rate or queue is not a
            positive number, or the port is gone.
        """
        self.receiver.session = new_session(self.receiver.session)
        for _ in range(round(SILENT_S / QUIET_S)):
            self.send(hello_frame(self.receiver.session))
            answer = self._wait_for(HELLO, QUIET_S, self._is_answer, self.check_stop)
            if answer is not None:
                return self._read_hello(answer)
        raise LinkError(
            f"the axis does not answer within {SILENT_S:g} s",
            self.name,
            f"{self.receiver!r}",
            "is it powered, at 921600 baud, and is nobody else using the port?",
        )

    def _is_answer(self, hello: np.void) -> bool:
        """Whether a HELLO answers ours; an axis of another version does not know of sessions."""
        return hello["tick"] == self.receiver.session or hello["flags"] != VERSION

    def _read_hello(self, answer: np.void) -> tuple[float, int]:
        if answer["flags"] != VERSION:
            raise LinkError(
                "the axis uses another version of the protocol",
                self.name,
                f"version {max(1, answer['flags'])}, not {VERSION}",
                "update the link.h and link.c of its firmware, or gsid: docs/reference/protocol.md, Versions",
            )
        fs_hz, n_queue = float(answer["a"]), float(answer["b"])
        if not (0 < fs_hz < np.inf and 1 <= n_queue < np.inf):
            raise LinkError(
                "the axis states no usable rate or queue",
                self.name,
                f"{fs_hz:g} Hz, {n_queue:g} commands",
                "its HELLO carries ticks per second in a and commands it can queue in b: "
                "docs/reference/protocol.md",
            )
        return fs_hz, int(n_queue)

    def stop(self, take: Callable[[np.ndarray], None] = lambda got: None) -> bool:
        """Set the command to zero; True when the axis has confirmed it.

        Parameters
        ----------
        take : callable, optional
            Called with the frames that come until then, (n,) of FRAME: samples that were under way.
        """
        for _ in range(3):
            self.send(frames(STOP))
            if self._wait_for(STOP, STOP_WAIT_S, take=take) is not None:
                return True
        return False

    def _wait_for(
        self,
        kind: int,
        timeout_s: float,
        wanted: Callable[[np.void], bool] = lambda frame: True,
        check: Callable[[], None] = lambda: None,
        take: Callable[[np.ndarray], None] = lambda got: None,
    ) -> np.void | None:
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            check()
            got = self.receive()
            take(got)
            for frame in got[got["kind"] == kind]:
                if wanted(frame):
                    return frame
        return None


@dataclass
class Progress:
    """How far a run is: ticks measured, good and lost periods, good periods asked for."""

    ticks: int
    good: int
    lost: int
    asked: int


class _Echo:
    """The command as the axis reports it: the one sent, clipped and rounded, the same in every period."""

    def __init__(self, table: np.ndarray) -> None:
        self.sent = table.astype(np.float32)
        self.known = np.full(len(table), np.nan, np.float32)  # echo of each sample of the period
        self.other = np.full(len(table), np.nan, np.float32)  # another one, seen last: twice, and it is right
        self.n_wrong = 0
        self.is_judged = False  # whether a whole period was compared with what was sent

    def check(self, tick: np.ndarray, echo: np.ndarray) -> np.ndarray:
        """Whether each of these samples, of rising ticks, has the echo of its sample in other periods."""
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
        """Compare a whole period with what was sent; LinkError when they differ by more than single samples.

        Returns
        -------
        (m,) ndarray of int
            Samples of the period that cannot be right.
        """
        lo, hi = np.quantile(self.known, [0.005, 0.995])  # where it clips
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
    """The step to which values are rounded, with a few wrong ones among them; near 0 when they are not."""
    levels, n = np.unique(values, return_counts=True)
    if n[n > 1].sum() > len(values) / 2:
        levels = levels[n > 1]
        n_wrong = 0
    else:
        n_wrong = 1 + len(levels) // 100  # each makes two small differences
    steps = np.sort(np.diff(levels))
    return float(steps[min(2 * n_wrong, len(steps) - 1)]) if len(steps) else 0.0


class _Samples:
    """What has come back, by tick, and which periods of it are good."""

    def __init__(self, table: np.ndarray, settle: int, asked: int) -> None:
        capacity = settle + (BAD_FACTOR * asked + 1) * len(table)
        self.period, self.settle, self.asked = len(table), settle, asked
        self.u = np.zeros(capacity)
        self.y = np.zeros(capacity)
        self.valid = np.zeros(capacity, bool)
        self.came = np.zeros(capacity, bool)  # with numbers, valid or not
        self.echo = _Echo(table)
        self.end = 0
        self.kept = 0  # samples below are in the journal
        self.good: list[bool] = []
        self.n_held = 0
        self._lost_count = 0
        self._last_held = -capacity - 1

    def take(self, got: np.ndarray, limit: int) -> bool:
        """Enter frames as they came, of ticks below `limit`; True when there was a new sample among them."""
        limit = min(limit, len(self.u))
        got = got[(got["kind"] == SAMPLE) & (got["tick"] >= self.end) & (got["tick"] < limit)]
        got = got[np.diff(np.maximum.accumulate(got["tick"].astype(np.int64)), prepend=self.end - 1) > 0]
        if not len(got):
            return False
        tick = got["tick"].astype(np.int64)
        held_before = self._held_before(tick, got["flags"])
        finite = np.isfinite(got["a"]) & np.isfinite(got["b"])
        self.u[tick[finite]], self.y[tick[finite]] = got["a"][finite], got["b"][finite]
        self.came[tick] = finite
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
            except LinkError:  # nobody knows the input of what was measured
                self.valid[: self.end] = False
                raise
            for sample in wrong:
                self.valid[sample : self.end : self.period] = False
                self.kept = 0

    def _held_before(self, tick: np.ndarray, flags: np.ndarray) -> np.ndarray:
        """The last tick, up to each sample, at which a lost command is known to have disturbed the axis."""
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
        """Whether too many periods are lost to go on."""
        in_a_row = len(self.good) >= BAD_IN_A_ROW and not any(self.good[-BAD_IN_A_ROW:])
        return in_a_row or len(self.good) >= BAD_FACTOR * self.asked


def run(
    port: str | Transport,
    excitation: Multisine | np.ndarray,
    *,
    periods: int,
    settle: int | None = None,
    fs_hz: float = 3000.0,
    u_unit: str = "command",
    y_unit: str = "deg/s",
    meta: dict[str, str] | None = None,
    frf: StreamingFrf | None = None,
    on_progress: Callable[[Progress], None] | None = None,
    journal: str | os.PathLike | None = None,
    should_stop: Callable[[], bool] | None = None,
    limits: RunLimits | None = None,
) -> Record:
    """Drive an axis with a periodic excitation until so many good periods are measured.

    A lost or damaged sample spoils its period only; so does one whose echo of the command differs from that
    of other periods. A lost command (the axis holds the one before, and reports it) disturbs the axis: the
    `settle` samples that follow it are left out too, as at the start. The command is set to zero at the end,
    whatever happens.

    Parameters
    ----------
    port : str or Transport
        Serial port, or path of a pseudo-terminal.
    excitation : Multisine or (N,) array_like
        One period of the command, unit `u_unit`.
    periods : int
        Good periods to measure, >= 1.
    settle : int, optional
        Samples at the start that are recorded but not counted as periods. Default: two periods.
    fs_hz : float
        Sample rate [Hz]; a Multisine brings its own.
    u_unit, y_unit : str
    meta : dict of str, optional
        Put into the record's meta, beside the statistics of the line.
    frf : StreamingFrf, optional
        Given every sample as it comes, so that the response is measured while the axis runs.
    on_progress : callable, optional
        Given a `Progress` whenever samples have come.
    journal : path_like, optional
        New file for the samples as they come; `gsid.rig.journal.recover` makes a record of it. It is left for
        the caller to remove once the record is written, and removed here when it holds no sample.
    should_stop : callable, optional
        Called many times a second: True ends the run with `Stopped`. For handlers of signals that set a flag.
    limits : RunLimits, optional
        Of the planned command, checked before the start, and of the command in force, rate and travel as the
        samples come. The travel is the integral of the rate less its mean during half a second of command
        zero before the start, in which the axis has to stand still; the rate is taken to be in deg/s. With a
        limit on rate or travel, samples without a rate, lost or not numbers, end the run after 1 s.

    Returns
    -------
    Record
        u is the command as the axis reports it applied; hold "zoh"; lost samples are not valid.

    Raises
    ------
    ValueError
        `periods` < 1, `settle` < 0, or the excitation is not a row of at least 2 finite numbers.
    LinkError
        The port cannot be opened, the axis does not answer, runs at another rate, uses another version of the
        protocol or reports another command than the one sent, the port disappears, or too many periods are
        lost (8 in a row, or the asked number is not reached in 4 times as many). Its `record` is what was
        measured until then.
    LimitError
        The planned command or the axis passes a limit. Its `record` is what was measured until then.
    JournalError
        The journal cannot be written; its `record` is what was measured until then.
    Stopped
        Ctrl-C, or `should_stop`; its `record` is what was measured until then.
    """
    table, fs_hz = _one_period(excitation, fs_hz)
    settle = 2 * len(table) if settle is None else int(settle)
    if periods < 1 or settle < 0:
        raise ValueError(f"periods must be at least 1 and settle at least 0, not {periods} and {settle}")
    name = port if isinstance(port, str) else ""
    _check_plan(table, limits, name)
    samples = _Samples(table, settle, periods)
    description = RunDescription(
        fs_hz,
        len(table),
        settle,
        len(samples.u),
        u_unit,
        y_unit,
        name,
        (meta or {}) | {"date": _now(), "port": name},
    )
    kept = Journal(journal, description) if journal is not None else None
    failure, statistics = _drive(port, samples, table, fs_hz, limits, should_stop, kept, frf, on_progress)
    failure = _close(kept, samples) or failure
    n = samples.end
    record = description.record(samples.u[:n], samples.y[:n], samples.valid[:n], statistics) if n else None
    if failure is not None:
        failure.record = record  # type: ignore[attr-defined]
        raise failure
    assert record is not None
    return record


def _check_plan(table: np.ndarray, limits: RunLimits | None, name: str) -> None:
    """LimitError when the planned command passes its limit."""
    peak = np.abs(table).max()
    if limits and limits.command is not None and peak > limits.command * ROUNDING:
        raise LimitError(
            "the planned command passes its limit",
            name,
            f"peak {peak:.4g}, limit {limits.command:g}",
            "lower --amplitude, or `gsid design --limit-command` makes a command that stays within it",
        )


def _drive(
    port: str | Transport,
    samples: _Samples,
    table: np.ndarray,
    fs_hz: float,
    limits: RunLimits | None,
    should_stop: Callable[[], bool] | None,
    journal: Journal | None,
    frf: StreamingFrf | None,
    on_progress: Callable[[Progress], None] | None,
) -> tuple[BaseException | None, dict[str, str]]:
    """Fill `samples`, and set the command to zero: what went wrong, and how the line behaved."""
    n_ahead = int(SILENT_S * fs_hz)
    statistics: dict[str, str] = {}
    try:
        with Link.open(port, should_stop) if isinstance(port, str) else Link(port, "", should_stop) as link:
            try:
                watch = _watch(link, limits, fs_hz) if limits else None
                consumers = _Consumers(link.name, journal, watch, frf, on_progress)
                _exchange(link, samples, table, _start(link, fs_hz), n_ahead, consumers.take)
            except BaseException:
                statistics = _statistics(samples, link, _stop(link, samples, n_ahead))
                raise
            statistics = _statistics(samples, link, _stop(link))
    except KeyboardInterrupt as error:
        return error if isinstance(error, Stopped) else Stopped("stopped"), statistics
    except BaseException as error:
        return error, statistics
    return None, statistics


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def _close(journal: Journal | None, samples: _Samples) -> BaseException | None:
    """Finish the journal; why it is not whole."""
    if journal is None:
        return None
    try:
        try:
            _keep(journal, samples)
        finally:
            journal.close()
    except JournalError as error:
        return error
    finally:
        if not samples.end:
            journal.path.unlink(missing_ok=True)
    return None


def _keep(journal: Journal, samples: _Samples) -> None:
    """Append what the journal does not have yet."""
    new = slice(samples.kept, samples.end)
    if new.start < new.stop:
        journal.append(new.start, samples.u[new], samples.y[new], samples.valid[new])
        samples.kept = samples.end


@dataclass
class _Consumers:
    """Who takes the samples as they come."""

    name: str
    journal: Journal | None
    watch: Watch | None
    frf: StreamingFrf | None
    on_progress: Callable[[Progress], None] | None
    n_watched: int = 0
    n_fed: int = 0

    def take(self, samples: _Samples) -> None:
        """Pass on what is new; LimitError when a limit is passed."""
        if self.journal is not None:
            _keep(self.journal, samples)
        if self.watch is not None:
            self._check_limits(self.watch, samples)
        if self.frf is not None and samples.echo.is_judged:
            new = slice(self.n_fed, samples.end)
            self.frf.step(samples.u[new], samples.y[new], samples.valid[new])
            self.n_fed = samples.end
        if self.on_progress:
            self.on_progress(Progress(samples.end, samples.n_good, samples.n_lost, samples.asked))

    def _check_limits(self, watch: Watch, samples: _Samples) -> None:
        first, new = self.n_watched, slice(self.n_watched, samples.end)
        found = watch.check(samples.u[new], samples.y[new], samples.came[new])
        self.n_watched = samples.end
        if found is not None:
            raise LimitError(
                "the axis passes a limit: stopped",
                self.name,
                f"{found[1]}, at sample {first + found[0]}",
                "lower the amplitude, or raise the limit where the rig stands it",
            )


def _watch(link: Link, limits: RunLimits, fs_hz: float) -> Watch:
    """Limits, and for the travel the rate that the gyro shows at rest."""
    if limits.travel_deg is None:
        return Watch(limits, fs_hz)
    n_queue = _start(link, fs_hz)
    table = np.zeros(max(2, round(REST_S * fs_hz)))
    rest = _Samples(table, 0, 1)
    _exchange(link, rest, table, n_queue, int(SILENT_S * fs_hz), lambda samples: None)
    return Watch(limits, fs_hz, float(rest.y[rest.valid].mean()))


def _one_period(excitation: Multisine | np.ndarray, fs_hz: float) -> tuple[np.ndarray, float]:
    if hasattr(excitation, "table"):
        excitation, fs_hz = excitation.table(), excitation.fs_hz
    table = np.asarray(excitation, dtype=np.float64)
    if table.ndim != 1 or len(table) < 2 or not np.isfinite(table).all():
        raise ValueError(f"the excitation is not a row of at least 2 finite numbers: shape {table.shape}")
    return table, float(fs_hz)


def _start(link: Link, fs_hz: float) -> int:
    axis_hz, n_queue = link.hello()
    if not abs(axis_hz - fs_hz) <= 1e-6 * fs_hz:  # the line carries single precision
        raise LinkError(
            "the axis runs at another rate",
            link.name,
            f"{axis_hz:g} Hz, not {fs_hz:g} Hz",
            f"excite with --fs {axis_hz:g}",
        )
    return n_queue


def _stop(link: Link, samples: _Samples | None = None, n_ahead: int = 0) -> bool:
    """Set the command to zero, and take the samples under way; True when the axis has confirmed it."""

    def take(got: np.ndarray) -> None:
        if samples is not None and samples.end:  # else they are those of the rest before the run
            with contextlib.suppress(LinkError):  # the run ends already
                samples.take(got, samples.end + n_ahead)

    try:
        return link.stop(take)
    except LinkError:
        return False


def _exchange(
    link: Link,
    samples: _Samples,
    table: np.ndarray,
    n_queue: int,
    n_ahead: int,
    take: Callable[[_Samples], None],
) -> None:
    """Keep a window of commands under way, and `take` what comes back, until there are enough good periods.

    A paced axis may have gone on beyond the last command sent while the host was stalled: samples up to
    `n_ahead` ticks further are believed.
    """
    window = max(1, min(WINDOW, n_queue // 2))
    sent, heard = 0, time.monotonic()
    sent_at, resend = heard, heard + QUIET_S
    while samples.n_good < samples.asked:
        link.check_stop()
        if samples.hopeless():
            raise _too_many_lost(link, samples)
        room = samples.end + window - sent
        now = time.monotonic()
        if room > window // 4 or (room > 0 and now > sent_at + KEEP_ALIVE_S):  # not frame by frame
            sent = _send_commands(link, table, max(sent, samples.end), samples.end + window)
            link.longest_silence_s = max(link.longest_silence_s, now - sent_at)
            sent_at = now
        if samples.take(link.receive(), sent + n_ahead):
            heard = time.monotonic()
            resend = heard + QUIET_S
            take(samples)
        elif time.monotonic() > heard + SILENT_S:
            raise LinkError(
                f"no sample from the axis for {SILENT_S:g} s",
                link.name,
                f"after {samples.end} samples",
                "check the line and the axis, and start again",
            )
        elif time.monotonic() > resend:
            # Commands may be lost, or their samples: then the axis waits for commands that were never sent.
            sent = _send_commands(link, table, samples.end, min(sent + window, samples.end + n_queue))
            sent_at = time.monotonic()
            resend += QUIET_S


def _send_commands(link: Link, table: np.ndarray, first: int, end: int) -> int:
    tick = np.arange(first, end)
    link.send(frames(COMMAND, tick, table[tick % len(table)], table[(tick + 1) % len(table)]))
    return end


def _too_many_lost(link: Link, samples: _Samples) -> LinkError:
    return LinkError(
        "too many periods are lost on the line",
        link.name,
        f"{samples.n_good} good of {len(samples.good)}, {samples.asked} asked for; "
        f"{link.receiver.n_damaged} damaged frames, {samples.n_held} commands lost, "
        f"{samples.echo.n_wrong} wrong echoes",
        "mend the line (cable, grounding, baud rate), or shorten the period: one lost sample spoils it",
    )


def _statistics(samples: _Samples, link: Link, confirmed: bool) -> dict[str, str]:
    """How the line behaved."""
    values = {
        "lost_commands": samples.n_held,
        "wrong_echoes": samples.echo.n_wrong,
        "longest_host_silence_s": f"{link.longest_silence_s:.3f}",
        "link_frames": link.receiver.n_frames,
        "link_damaged": link.receiver.n_damaged,
        "link_garbage_bytes": link.receiver.n_garbage,
        "command_zero_confirmed": "yes" if confirmed else "no",
    }
    return {key: str(value) for key, value in values.items()}
