"""Drive an axis over a serial line and collect what it measures; docs/protocol.md has the bytes and rules."""

from __future__ import annotations

import datetime
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gsid._lib import ffi, lib
from gsid.errors import InputError
from gsid.record import Record

if TYPE_CHECKING:
    from gsid.excitation import Multisine
    from gsid.streaming import StreamingFrf

BAUD = 921600
COMMAND = lib.GSID_FRAME_COMMAND
SAMPLE = lib.GSID_FRAME_SAMPLE
HELLO = lib.GSID_FRAME_HELLO
STOP = lib.GSID_FRAME_STOP
RESULT = lib.GSID_FRAME_RESULT
COMMAND_LOST = lib.GSID_FLAG_COMMAND_LOST
LOST_COUNT = lib.GSID_FLAG_LOST_COUNT

#: numpy's view of the C struct gsid_frame.
FRAME = np.dtype([("kind", "u1"), ("flags", "u1"), ("tick", "u4"), ("a", "f4"), ("b", "f4")], align=True)
assert FRAME.itemsize == ffi.sizeof("gsid_frame")

WINDOW = 512  # commands under way: 170 ms at 3 kHz, more than an operating system sleeps
QUIET_S = 2.0  # without a reply for so long, what is under way is sent again
SILENT_S = 10.0  # without a reply for so long, the axis is given up
GAP_HELD = 64  # samples lost in a row that stand for a lost command: the count of those may have wrapped
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


class Stopped(KeyboardInterrupt):
    """The user stopped a run with Ctrl-C; the command is zero.

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
        Tick the frame speaks of, modulo 2^32.
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


def encode(block: np.ndarray) -> bytes:
    """Write frames as bytes.

    Parameters
    ----------
    block : (n,) ndarray of FRAME

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
        written = lib.gsid_link_encode(source + i, target + size)
        if written == 0:
            raise ValueError(f"frame {i} is of unknown kind {block['kind'][i]}")
        size += written
    return bytes(out[:size])


class Receiver:
    """Find the frames in a stream of bytes.

    Attributes
    ----------
    n_frames, n_damaged, n_garbage : int
        Good frames, frames whose check failed, bytes thrown away.
    """

    def __init__(self) -> None:
        self._link = ffi.new("gsid_link *")

    n_frames = property(lambda self: self._link.n_frames)
    n_damaged = property(lambda self: self._link.n_damaged)
    n_garbage = property(lambda self: self._link.n_garbage)

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
        n_found = ffi.new("size_t *")
        lib.gsid_link_decode(
            self._link,
            len(data),
            ffi.from_buffer(data),
            len(found),
            ffi.from_buffer("gsid_frame[]", found),
            n_found,
        )
        return found[: n_found[0]]


FRAME_BYTES = len(encode(frames(STOP)))


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


class Link:
    """The host's end of the line.

    Parameters
    ----------
    transport : Transport
    name : str
        Of the port, for messages.
    """

    def __init__(self, transport: Transport, name: str = "") -> None:
        self._transport = transport
        self.name = name
        self.receiver = Receiver()

    @classmethod
    def open(cls, port: str) -> Link:
        """Open a serial port or a pseudo-terminal; LinkError when that fails."""
        return cls(SerialTransport(port), port)

    def __repr__(self) -> str:
        return f"Link({self.name}: {self.receiver!r})"

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._transport.close()

    def send(self, block: np.ndarray) -> None:
        """Send frames, (n,) of FRAME; LinkError when the port is gone."""
        try:
            self._transport.write(encode(block))
        except OSError as error:
            raise self._gone(error) from error

    def receive(self) -> np.ndarray:
        """Return what has come, (n,) of FRAME, nothing after 50 ms; LinkError when the port is gone."""
        try:
            return self.receiver.decode(self._transport.read())
        except OSError as error:
            raise self._gone(error) from error

    def _gone(self, error: OSError) -> LinkError:
        return LinkError(
            "the port is gone", self.name, str(error), "check cable and power of the axis, and start again"
        )

    def hello(self) -> tuple[float, int]:
        """Ask the axis to start again at tick 0.

        Returns
        -------
        fs_hz : float
            Ticks per second of the axis [Hz].
        n_queue : int
            Commands that it can keep.

        Raises
        ------
        LinkError
            No answer in 10 s, or the port is gone.
        """
        for _ in range(round(SILENT_S / QUIET_S)):
            self.send(frames(HELLO))
            answer = self._wait_for(HELLO, QUIET_S)
            if answer is not None:
                return float(answer["a"]), int(answer["b"])
        raise LinkError(
            f"the axis does not answer within {SILENT_S:g} s",
            self.name,
            f"{self.receiver!r}",
            "is it powered, at 921600 baud, and is nobody else using the port?",
        )

    def stop(self) -> bool:
        """Set the command to zero; True when the axis has confirmed it."""
        for _ in range(3):
            self.send(frames(STOP))
            if self._wait_for(STOP, 0.5) is not None:
                return True
        return False

    def _wait_for(self, kind: int, timeout_s: float) -> np.void | None:
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            got = self.receive()
            if (got["kind"] == kind).any():
                return got[got["kind"] == kind][-1]
        return None


@dataclass
class Progress:
    """How far a run is: ticks measured, good and lost periods, good periods asked for."""

    ticks: int
    good: int
    lost: int
    asked: int


class _Samples:
    """What has come back, by tick, and which periods of it are good."""

    def __init__(self, period: int, settle: int, asked: int) -> None:
        capacity = settle + (BAD_FACTOR * asked + 1) * period
        self.period, self.settle, self.asked = period, settle, asked
        self.u = np.zeros(capacity)
        self.y = np.zeros(capacity)
        self.valid = np.zeros(capacity, bool)
        self.end = 0
        self.good: list[bool] = []
        self.n_held = 0
        self._lost_count = 0
        self._last_held = -capacity - 1

    def take(self, got: np.ndarray, limit: int) -> bool:
        """Enter frames as they came, of ticks below `limit`; True when there was a new sample among them."""
        limit = min(limit, len(self.u))
        got = got[(got["kind"] == SAMPLE) & (got["tick"] >= self.end) & (got["tick"] < limit)]
        if not len(got):
            return False
        tick = got["tick"].astype(np.int64)
        settled = tick - self._held_before(tick, got["flags"]) > self.settle
        good = settled & np.isfinite(got["a"]) & np.isfinite(got["b"])
        self.u[tick[good]], self.y[tick[good]], self.valid[tick[good]] = got["a"][good], got["b"][good], True
        self.end = int(tick[-1]) + 1
        while self.settle + (len(self.good) + 1) * self.period <= self.end:
            first = self.settle + len(self.good) * self.period
            self.good.append(bool(self.valid[first : first + self.period].all()))
        return True

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
) -> Record:
    """Drive an axis with a periodic excitation until so many good periods are measured.

    A lost or damaged sample spoils its period only. A lost command (the axis holds the one before, and says
    so) disturbs the axis: the `settle` samples that follow it are left out too, as at the start. The command
    is set to zero at the end, whatever happens.

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

    Returns
    -------
    Record
        u is the command as the axis reports it applied; hold "zoh"; lost samples are not valid.

    Raises
    ------
    ValueError
        `periods` < 1, `settle` < 0, or the excitation is not a row of at least 2 finite numbers.
    LinkError
        The port cannot be opened, the axis does not answer or runs at another rate, the port disappears, or
        too many periods are lost (8 in a row, or the asked number is not reached in 4 times as many). Its
        `record` is what was measured until then.
    Stopped
        Ctrl-C; its `record` is what was measured until then.
    """
    table, fs_hz = _one_period(excitation, fs_hz)
    settle = 2 * len(table) if settle is None else settle
    if periods < 1 or settle < 0:
        raise ValueError(f"periods must be at least 1 and settle at least 0, not {periods} and {settle}")
    samples = _Samples(len(table), settle, periods)
    failure: LinkError | Stopped | None = None
    with Link.open(port) if isinstance(port, str) else Link(port) as link:
        n_queue = _start(link, fs_hz)
        try:
            _exchange(link, samples, table, n_queue, int(SILENT_S * fs_hz), frf, on_progress)
        except LinkError as error:
            failure = error
        except KeyboardInterrupt:
            failure = Stopped("stopped")
        finally:
            confirmed = _stop(link)
    record = _record(samples, link, confirmed, fs_hz, u_unit, y_unit, meta or {}) if samples.end else None
    if failure is not None:
        failure.record = record
        raise failure
    return record


def _one_period(excitation: Multisine | np.ndarray, fs_hz: float) -> tuple[np.ndarray, float]:
    if hasattr(excitation, "table"):
        excitation, fs_hz = excitation.table(), excitation.fs_hz
    table = np.asarray(excitation, dtype=np.float64)
    if table.ndim != 1 or len(table) < 2 or not np.isfinite(table).all():
        raise ValueError(f"the excitation is not a row of at least 2 finite numbers: shape {table.shape}")
    return table, float(fs_hz)


def _start(link: Link, fs_hz: float) -> int:
    axis_hz, n_queue = link.hello()
    if abs(axis_hz - fs_hz) > 1e-6 * fs_hz:  # the line carries single precision
        raise LinkError(
            "the axis runs at another rate",
            link.name,
            f"{axis_hz:g} Hz, not {fs_hz:g} Hz",
            f"excite with --fs {axis_hz:g}",
        )
    return n_queue


def _stop(link: Link) -> bool:
    try:
        return link.stop()
    except LinkError:
        return False


def _exchange(
    link: Link,
    samples: _Samples,
    table: np.ndarray,
    n_queue: int,
    n_ahead: int,
    frf: StreamingFrf | None,
    on_progress: Callable[[Progress], None] | None,
) -> None:
    """Keep a window of commands under way, and take what comes back, until there are enough good periods.

    A paced axis may have gone on beyond the last command sent while the host was stalled: samples up to
    `n_ahead` ticks further are believed.
    """
    window = max(1, min(WINDOW, n_queue // 2))
    sent, heard = 0, time.monotonic()
    resend = heard + QUIET_S
    while samples.n_good < samples.asked:
        if samples.hopeless():
            raise _too_many_lost(link, samples)
        room = samples.end + window - sent
        if room > window // 4:  # not frame by frame
            sent = _send_commands(link, table, max(sent, samples.end), samples.end + window)
        first = samples.end
        if samples.take(link.receive(), sent + n_ahead):
            new = slice(first, samples.end)
            if frf is not None:
                frf.step(samples.u[new], samples.y[new], samples.valid[new])
            heard = time.monotonic()
            resend = heard + QUIET_S
            if on_progress:
                on_progress(Progress(samples.end, samples.n_good, samples.n_lost, samples.asked))
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
        f"{link.receiver.n_damaged} damaged frames, {samples.n_held} commands lost",
        "mend the line (cable, grounding, baud rate), or shorten the period: one lost sample spoils it",
    )


def _record(
    samples: _Samples,
    link: Link,
    confirmed: bool,
    fs_hz: float,
    u_unit: str,
    y_unit: str,
    meta: dict[str, str],
) -> Record:
    n = samples.end
    if samples.good:
        n = samples.settle + len(samples.good) * samples.period
    statistics = {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "port": link.name,
        "good_periods": samples.n_good,
        "spoiled_periods": samples.n_lost,
        "lost_samples": int(np.count_nonzero(~samples.valid[:n])),
        "lost_commands": samples.n_held,
        "link_frames": link.receiver.n_frames,
        "link_damaged": link.receiver.n_damaged,
        "link_garbage_bytes": link.receiver.n_garbage,
        "command_zero_confirmed": "yes" if confirmed else "no",
    }
    return Record(
        u=samples.u[:n].copy(),
        y=samples.y[:n].copy(),
        valid=samples.valid[:n].copy(),
        fs_hz=fs_hz,
        period_samples=samples.period,
        settle_samples=samples.settle,
        u_unit=u_unit,
        y_unit=y_unit,
        hold="zoh",
        name=link.name,
        meta=meta | {key: str(value) for key, value in statistics.items()},
    )
