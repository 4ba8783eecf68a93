"""The emulated board, and a simulated axis at the other end of its serial line."""

from __future__ import annotations

import os
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gsid._lib import ffi, lib
from gsid.simulate import SimulatedAxis

ROOT = Path(__file__).resolve().parents[2]
BOARDS = {"m7": "mps2-an500", "m4": "mps2-an386"}
RESULTS = ("state", "g", "sigma", "fit", "num", "den", "trip")  # drive_result, in rate_loop/drive.h


def image(name: str) -> Path:
    return ROOT / f"build/firmware/{name}.elf"


def emulator(name: str, *options: str) -> list[str]:
    """Words that run the image of that name ("m7-full"), without a serial port."""
    board = BOARDS[name.split("-")[0]]
    semihosting = ["-semihosting-config", "enable=on,target=native"]
    return ["qemu-system-arm", "-M", board, "-display", "none", "-monitor", "none", *semihosting, *options,
            "-kernel", str(image(name))]  # fmt: skip


def pin(cpu: int) -> Callable[[], None]:
    """For a process to be started: emulator and axis on one processor answer each other five times as fast."""
    cpus = sorted(os.sched_getaffinity(0))
    return lambda: os.sched_setaffinity(0, {cpus[cpu % len(cpus)]})


class Axis:
    """The axis's end of the line in lock-step, as `gsid.simulate.Server` keeps it, but frame by frame and so much
    faster; what the drive reports is collected.

    Attributes
    ----------
    said, heard : bytearray
        All bytes to and from the drive.
    reports : list of (what, tick, a, b)
    ticks : int
        Advanced since HELLO.
    """

    def __init__(self, axis: SimulatedAxis) -> None:
        self.axis = axis
        self.said, self.heard = bytearray(), bytearray()
        self.reports: list[tuple[str, int, float, float]] = []
        self.n_stops = 0
        self.running, self.ticks, self.n_lost, self.held = False, 0, 0, 0.0
        self._link, self._frames, self._n = (
            ffi.new("gsid_link *"),
            ffi.new("gsid_frame[64]"),
            ffi.new("size_t *"),
        )
        self._frame, self._bytes = ffi.new("gsid_frame *"), ffi.new("uint8_t[]", lib.GSID_LINK_FRAME_MAX)
        self._u = np.zeros(1)

    def take(self, data: bytes) -> bytes:
        """Take bytes off the line and give the answer."""
        self.heard += data
        answer = b""
        while data:
            used = lib.gsid_link_decode(self._link, len(data), data, 64, self._frames, self._n)
            answer += b"".join(self._answer(self._frames[i]) for i in range(self._n[0]))
            data = data[used:]
        self.said += answer
        return answer

    def _answer(self, frame) -> bytes:
        if frame.kind == lib.GSID_FRAME_COMMAND:
            return self._advance(frame.tick, frame.a) if self.running else b""
        if frame.kind == lib.GSID_FRAME_HELLO:
            self.axis.reset()
            self.running, self.ticks, self.n_lost, self.held = True, 0, 0, 0.0
            return self._encode(lib.GSID_FRAME_HELLO, 0, 0, self.axis.fs_hz, 1)
        if frame.kind == lib.GSID_FRAME_STOP:
            self.running = False
            self.n_stops += 1
            return self._encode(lib.GSID_FRAME_STOP, 0, self.ticks, 0, 0)
        if frame.kind == lib.GSID_FRAME_RESULT:
            self.reports.append((RESULTS[frame.flags], frame.tick, frame.a, frame.b))
        return b""

    def _advance(self, tick: int, u: float) -> bytes:
        answer = b""
        while self.ticks <= tick:
            lost = self.ticks < tick
            self.n_lost += lost
            self.held = self.held if lost else u
            self._u[0] = self.held
            applied, y, _ = self.axis.step(self._u)
            flags = lost | (self.n_lost % 128) << 1
            answer += self._encode(lib.GSID_FRAME_SAMPLE, flags, self.ticks, applied[0], y[0])
            self.ticks += 1
        return answer

    def _encode(self, kind: int, flags: int, tick: int, a: float, b: float) -> bytes:
        f = self._frame
        f.kind, f.flags, f.tick, f.a, f.b = kind, flags, tick, a, b
        return bytes(ffi.buffer(self._bytes, lib.gsid_link_encode(f, self._bytes)))

    def finished(self) -> bool:
        """Whether the whole report of a run is in."""
        return bool(self.reports) and self.reports[-1][0] == "fit"


def serve(
    axis: Axis, line: socket.socket, until: Callable[[], bool], damage: Callable[[bytes], bytes] = bytes
) -> None:
    """Answer the drive until `until`; EOFError when it has gone, TimeoutError as the socket says."""
    while not until():
        data = line.recv(4096)
        if not data:
            raise EOFError("the emulator has gone")
        line.sendall(damage(axis.take(damage(data))))
