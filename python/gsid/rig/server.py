"""Server of a simulated gimbal axis on a serial line; docs/reference/protocol.md defines the protocol."""

from __future__ import annotations

import contextlib
import os
import select
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.errors import InputError
from gsid.rig.frames import (
    COMMAND,
    COMMAND_LOST,
    FRAME_BYTES,
    HELLO,
    SAMPLE,
    SESSION_MAX,
    STOP,
    VERSION,
    Receiver,
    encode,
    frames,
    hello_frame,
)
from gsid.rig.link import SILENCE_STOP_S

if TYPE_CHECKING:
    from gsid.rig.axis import SimulatedAxis

QUEUE = 8192  # commands kept
LEAD_S = 0.02  # paced: delay from the first command to tick 0, in which the host sends further commands
WATCHDOG_S = SILENCE_STOP_S  # paced; 0.25 s with the delays of a desktop
WAKE_S = 0.002  # paced: ticks are served in bursts
OUTPUT_MAX = 1 << 18  # bytes waiting for a reader; above it lock-step mode waits, paced mode drops bytes


class Damage:
    """A disturbed line: a share `rate` of the frames is damaged by changed, dropped or inserted bytes.

    Parameters
    ----------
    rate : float
        Share of the frames that are damaged, 0 .. 1.
    seed : int
    """

    def __init__(self, rate: float, seed: int = 0) -> None:
        if not 0 <= rate <= 1:
            raise ValueError(f"the damage rate is a share of the frames, 0 to 1, not {rate}")
        self.rate = rate
        self.n_hits = 0
        self._random = np.random.default_rng(seed)
        self._next = self._frames_ahead()  # whole frames before the next damaged one
        self._at = 0  # bytes of the stream's current frame that have passed

    def _frames_ahead(self) -> int:
        return int(self._random.geometric(self.rate)) - 1 if self.rate > 0 else -1

    def apply(self, data: bytes) -> bytes:
        """Return the bytes of a stream of frames, with some of them damaged.

        Parameters
        ----------
        data : bytes
            Whole frames, or any piece of a stream of them.

        Returns
        -------
        bytes
        """
        if self._next < 0:
            return data
        out, start = [], 0
        while start + (ahead := (self._next + 1) * FRAME_BYTES - self._at) <= len(data):
            end = start + ahead
            first = max(start, end - FRAME_BYTES)
            out += [data[start:first], self._hit(data[first:end])]
            start, self._at, self._next = end, 0, self._frames_ahead()
        rest = self._at + len(data) - start
        self._next, self._at = self._next - rest // FRAME_BYTES, rest % FRAME_BYTES
        return b"".join([*out, data[start:]])

    def _hit(self, frame: bytes) -> bytes:
        self.n_hits += 1
        at = int(self._random.integers(len(frame)))
        n = int(self._random.integers(1, 9))
        noise = self._random.integers(1, 256, n, dtype=np.uint8)
        kind = self._random.integers(3)
        if kind == 0:
            part = np.frombuffer(frame[at : at + n], np.uint8)
            return frame[:at] + (part ^ noise[: len(part)]).tobytes() + frame[at + n :]
        if kind == 1:
            return frame[:at] + frame[at + n :]
        return frame[:at] + noise.tobytes() + frame[at:]


@dataclass
class Served:
    """Statistics of a server: ticks advanced, commands missing, and the largest delay of a tick [s]."""

    ticks: int = 0
    commands_lost: int = 0
    late_s: float = 0.0


class Server:
    """Axis side of the protocol, from received bytes to sent bytes.

    Parameters
    ----------
    axis : SimulatedAxis
    paced : bool
        False: lock-step, the axis advances when commands arrive. True: by the clock.
    on_applied : callable, optional
        Called whenever the axis advances, with the time [s], the first tick and the applied commands, (n,)
        float64. After HELLO and STOP the commands are one zero.
    """

    def __init__(
        self,
        axis: SimulatedAxis,
        paced: bool = False,
        on_applied: Callable[[float, int, np.ndarray], None] | None = None,
    ) -> None:
        self.axis = self._first_axis = axis
        self.paced = paced
        self.on_applied = on_applied
        self._now_s = 0.0
        self.served = Served()
        self.receiver = Receiver(follows_hello=True)
        self.session = 0
        self.running = False
        self._tick = self._n_runs = 0
        self._restart()

    def _restart(self) -> None:
        if self._tick > 0:  # a repeated HELLO does not start new noise
            self._n_runs += 1
            self.axis = self._first_axis.with_noise_of_run(self._n_runs)
        self.axis.reset()
        self._tick = 0
        self._held = 0.0
        self._n_lost = 0
        self._forget()
        self._start_s: float | None = None  # time at which tick 0 is due; None: no command received yet

    def _forget(self) -> None:
        self._queue = np.zeros(QUEUE)
        self._queue_tick = np.full(QUEUE, -1, np.int64)

    def take(self, data: bytes, now_s: float = 0.0) -> bytes:
        """Process received bytes and return the reply.

        Parameters
        ----------
        data : bytes
        now_s : float
            Monotonic clock [s]; in lock-step for `on_applied` only.

        Returns
        -------
        bytes
            Bytes to send. In lock-step they include the samples of all ticks up to the last command.
        """
        got = self.receiver.decode(data)
        self._now_s = now_s
        if len(got):
            self._received_s = now_s
        out, first = [], 0
        for last in [*np.flatnonzero((got["kind"] == HELLO) | (got["kind"] == STOP)), len(got)]:
            out.append(self._commands(got[first:last], now_s))
            if last < len(got):
                out.append(self._control(got[last]))
            first = last + 1
        return b"".join(out)

    def _control(self, frame: np.void) -> bytes:
        """Reply to HELLO or STOP. The reply shows a host of another version that it cannot start a run."""
        if self.on_applied:
            self.on_applied(self._now_s, self._tick, np.zeros(1))
        if frame["kind"] == HELLO:
            self._restart()
            self.session = int(frame["tick"])
            self.running = frame["flags"] == VERSION and 1 <= self.session <= SESSION_MAX
            return self._encode(hello_frame(self.session, self.axis.fs_hz, QUEUE))
        self.running = False
        return self._encode(frames(STOP, self._tick))

    def _encode(self, block: np.ndarray) -> bytes:
        return encode(block, self.session & 0xFFFF)  # without a session only HELLO is sent

    def _commands(self, got: np.ndarray, now_s: float) -> bytes:
        tick = got["tick"].astype(np.int64)
        usable = (got["kind"] == COMMAND) & (tick >= self._tick) & (tick < self._tick + QUEUE - 1)
        got, tick = got[usable], tick[usable]
        if not self.running or not len(got):
            return b""
        for value, at in ((got["b"], tick + 1), (got["a"], tick)):  # a tick's own command overrides the copy
            finite = np.isfinite(value)
            self._queue[at[finite] % QUEUE] = value[finite]
            self._queue_tick[at[finite] % QUEUE] = at[finite]
        if not self.paced:
            return self._advance(int(tick.max()) + 1)
        if self._start_s is None:
            self._start_s = now_s + LEAD_S
        return b""

    def keep_time(self, now_s: float) -> bytes:
        """Paced: advance to the clock, and return the samples to send."""
        if not self.running or self._start_s is None or now_s < self._start_s:
            return b""
        self._now_s = now_s
        if now_s - self._received_s > WATCHDOG_S:
            self._forget()
            self._held = 0.0
        due_s = self._start_s + self._tick / self.axis.fs_hz
        end = int((now_s - self._start_s) * self.axis.fs_hz) + 1
        if end <= self._tick:
            return b""
        self.served.late_s = max(self.served.late_s, now_s - due_s)
        return self._advance(end)

    def _advance(self, end: int) -> bytes:
        out = []
        while self._tick < end:
            n = min(end - self._tick, QUEUE)
            out.append(self._advance_block(np.arange(self._tick, self._tick + n)))
        return b"".join(out)

    def _advance_block(self, tick: np.ndarray) -> bytes:
        there = self._queue_tick[tick % QUEUE] == tick
        index = np.maximum.accumulate(np.where(there, np.arange(len(tick)), -1))
        u = np.where(index >= 0, self._queue[tick[np.maximum(index, 0)] % QUEUE], self._held)
        u_applied, y, _ = self.axis.step(u)
        if self.on_applied:
            self.on_applied(self._now_s, self._tick, u_applied)
        n_lost = self._n_lost + np.cumsum(~there)
        flags = np.where(there, 0, COMMAND_LOST) | (n_lost % 128) << 1
        self._held, self._n_lost, self._tick = u[-1], int(n_lost[-1]), int(tick[-1]) + 1
        self.served.ticks += len(tick)
        self.served.commands_lost += int(np.count_nonzero(~there))
        return self._encode(frames(SAMPLE, tick, u_applied, y, flags))


@contextlib.contextmanager
def pseudo_terminal() -> Iterator[tuple[int, int, str]]:
    """Open a pseudo-terminal in raw mode: (the axis's file descriptor, the host's, the host's path)."""
    axis_fd, host_fd = os.openpty()
    try:
        tty.setraw(host_fd)
        os.set_blocking(axis_fd, False)
        yield axis_fd, host_fd, os.ttyname(host_fd)
    finally:
        os.close(axis_fd)
        with contextlib.suppress(OSError):  # serve_line may have closed it
            os.close(host_fd)


@contextlib.contextmanager
def symlink(link: str | None, target: str) -> Iterator[None]:
    """Create a temporary symlink to `target`; raises InputError if the name exists."""
    if link is None:
        yield
        return
    try:
        os.symlink(target, link)
    except FileExistsError:
        raise _occupied(link) from None
    try:
        yield
    finally:
        if os.path.islink(link) and os.readlink(link) == target:
            os.unlink(link)


def _occupied(link: str) -> InputError:
    if not os.path.islink(link):
        return InputError("a file of that name exists", link, None, "give --link another path")
    to = os.readlink(link)
    hint = "give --link another path"
    if to.startswith("/dev/pts/") and not os.path.exists(to):
        hint += ", or remove the link: its pseudo-terminal no longer exists"
    return InputError(
        "a link of that name exists, which this simulation did not create", link, f"points to {to}", hint
    )


def serve_line(
    server: Server, axis_fd: int, host_fd: int, damage_in: Damage, damage_out: Damage, once: bool
) -> None:
    """Serve the axis on a pseudo-terminal until interrupted, or until the port is closed.

    Parameters
    ----------
    server : Server
    axis_fd, host_fd : int
        From `pseudo_terminal`. `host_fd` keeps the line open while no host is connected. With `once` it is
        closed at the first byte, so that the end of the host's connection is detected.
    damage_in, damage_out : Damage
    once : bool
        Return when the host closes the port.
    """
    output = b""
    while True:
        reading = [axis_fd] if len(output) < OUTPUT_MAX or server.paced else []
        writing = [axis_fd] if output else []
        ready, writable, _ = select.select(reading, writing, [], WAKE_S if server.paced else None)
        if ready:
            try:
                data = os.read(axis_fd, 65536)
            except OSError:  # EIO: the other side is closed
                return
            if once and host_fd >= 0:
                os.close(host_fd)
                host_fd = -1
            output += damage_out.apply(server.take(damage_in.apply(data), time.monotonic()))
        if server.paced:
            output += damage_out.apply(server.keep_time(time.monotonic()))
        if len(output) > OUTPUT_MAX and server.paced:
            output = b""
        if output and writable:
            output = output[os.write(axis_fd, output) :]
