"""The emulated board, and a simulated axis at the other end of its serial line."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gsid._lib import ffi, lib
from gsid.rig.axis import SimulatedAxis
from gsid.rig.link import Transport

ROOT = Path(__file__).resolve().parents[2]
BOARDS = {"m7": "mps2-an500", "m4": "mps2-an386"}
SILENCE_S = 120  # silence of the emulator after which a test fails; no other time is checked
RESULTS = ("state", "g", "sigma", "fit", "num", "den", "trip")  # drive_result, in rate_loop/drive.h


def image(name: str) -> Path:
    return ROOT / f"build/firmware/{name}.elf"


def emulator(name: str, *options: str) -> list[str]:
    """Command line that runs an image ("m7-full"), without a serial port."""
    board = BOARDS[name.split("-")[0]]
    semihosting = ["-semihosting-config", "enable=on,target=native"]
    return ["qemu-system-arm", "-M", board, "-display", "none", "-monitor", "none", *semihosting, *options,
            "-kernel", str(image(name))]  # fmt: skip


class Axis:
    """The axis's end of the line in lock-step.

    It follows the same rules as `gsid.rig.server.Server`, but frame by frame, which is much faster here. The
    reports of the drive are collected.

    Attributes
    ----------
    sent, received : bytearray
        All bytes to and from the drive.
    reports : list of (what, tick, a, b)
    ticks : int
        Ticks since HELLO.
    n_hello, n_stop : int
        Number of received frames.
    bump : (int, float)
        A tick, and a value that is added to the output at this tick.
    """

    def __init__(self, axis: SimulatedAxis) -> None:
        self.axis = axis
        self.sent, self.received = bytearray(), bytearray()
        self.reports: list[tuple[str, int, float, float]] = []
        self.n_hello, self.n_stop = 0, 0
        self.bump = (-1, 0.0)
        self.running, self.ticks, self.n_lost, self.held = False, 0, 0, 0.0
        self._link, self._frames, self._n = (
            ffi.new("gsid_link *"),
            ffi.new("gsid_frame[64]"),
            ffi.new("size_t *"),
        )
        self._frame, self._bytes = ffi.new("gsid_frame *"), ffi.new("uint8_t[]", lib.GSID_LINK_FRAME_MAX)
        self._u = np.zeros(1)

    def take(self, data: bytes) -> bytes:
        """Process received bytes and return the reply."""
        self.received += data
        reply = b""
        while data:
            used = lib.gsid_link_decode(self._link, len(data), data, 64, self._frames, self._n)
            reply += b"".join(self._reply(self._frames[i]) for i in range(self._n[0]))
            data = data[used:]
        self.sent += reply
        return reply

    def _reply(self, frame) -> bytes:
        if frame.kind == lib.GSID_FRAME_COMMAND:
            return self._advance(frame.tick, frame.a) if self.running else b""
        if frame.kind == lib.GSID_FRAME_HELLO:
            self.axis.reset()
            self.n_hello += 1
            self.running, self.ticks, self.n_lost, self.held = True, 0, 0, 0.0
            self._link.session = frame.tick
            return self._encode(lib.GSID_FRAME_HELLO, lib.GSID_LINK_VERSION, frame.tick, self.axis.fs_hz, 1)
        if frame.kind == lib.GSID_FRAME_STOP:
            self.running = False
            self.n_stop += 1
            return self._encode(lib.GSID_FRAME_STOP, 0, self.ticks, 0, 0)
        if frame.kind == lib.GSID_FRAME_RESULT:
            self.reports.append((RESULTS[frame.flags], frame.tick, frame.a, frame.b))
        return b""

    def _advance(self, tick: int, u: float) -> bytes:
        samples = b""
        while self.ticks <= tick:
            lost = self.ticks < tick
            self.n_lost += lost
            self.held = self.held if lost else u
            self._u[0] = self.held
            applied, y, _ = self.axis.step(self._u)
            y = y + (self.bump[1] if self.ticks == self.bump[0] else 0.0)
            flags = lost | (self.n_lost % 128) << 1
            samples += self._encode(lib.GSID_FRAME_SAMPLE, flags, self.ticks, applied[0], y[0])
            self.ticks += 1
        return samples

    def _encode(self, kind: int, flags: int, tick: int, a: float, b: float) -> bytes:
        f = self._frame
        f.kind, f.flags, f.tick, f.a, f.b = kind, flags, tick, a, b
        return bytes(ffi.buffer(self._bytes, lib.gsid_link_encode(f, self._link.session, self._bytes)))

    def finished(self) -> bool:
        """Whether the whole report of a run was received."""
        return bool(self.reports) and self.reports[-1][0] == "fit"


class SocketLine:
    """A socket with the interface of `gsid.rig.link.Transport`."""

    def __init__(self, line: socket.socket) -> None:
        self.read = lambda: line.recv(4096)
        self.write = line.sendall
        self.close = line.close


def serve(
    axis: Axis, line: Transport, until: Callable[[], bool], damage: Callable[[bytes], bytes] = bytes
) -> None:
    """Reply to the drive until `until` is true, with `damage` applied to the bytes in both directions."""
    end = time.monotonic() + SILENCE_S
    while not until():
        if data := line.read():
            end = time.monotonic() + SILENCE_S
            line.write(damage(axis.take(damage(data))))
        assert time.monotonic() < end, "the drive is silent"
