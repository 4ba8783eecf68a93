"""Ends of a serial line for tests: one inside the process, and `gsid simulate` in a process of its own."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np

from gsid.rig.axis import SimulatedAxis
from gsid.rig.frames import COMMAND, FRAME_BYTES, SAMPLE, Receiver, encode
from gsid.rig.server import Server

SESSION = 7  # of tests that speak the protocol by hand
GSID = [sys.executable, "-m", "gsid.cli.main"]


def quiet_axis(**parameters: float) -> SimulatedAxis:
    """The default axis without noise and fan."""
    return SimulatedAxis(**{"noise_rms": 0, "noise_low_rms": 0, "fan_amplitude": 0, **parameters})


class Loopback:
    """A line to a server in the same process; frames for which `lose(kind, tick)` is true never arrive."""

    def __init__(self, server: Server, lose: Callable[[int, int], bool] = lambda kind, tick: False) -> None:
        self.server = server
        self.lose = lose
        self.waiting = b""
        self.stopped = False

    def _passed(self, data: bytes) -> bytes:
        kept = []
        for at in range(0, len(data), FRAME_BYTES):
            frame = data[at : at + FRAME_BYTES]
            kind, tick = frame[2], int.from_bytes(frame[4:8], "little")
            if kind not in (COMMAND, SAMPLE) or not self.lose(kind, tick):
                kept.append(frame)
        return b"".join(kept)

    def write(self, data: bytes) -> None:
        self.waiting += self._passed(self.server.take(self._passed(data)))

    def read(self) -> bytes:
        data, self.waiting = self.waiting[:4095], self.waiting[4095:]
        return data

    def close(self) -> None:
        self.stopped = not self.server.running


class Altered(Server):
    """An axis whose frames are changed on their way out by `alter(frames)`."""

    def __init__(self, alter: Callable[[np.ndarray], np.ndarray]) -> None:
        super().__init__(quiet_axis())
        self.alter = alter

    def take(self, data: bytes, now_s: float = 0.0) -> bytes:
        out = frames_in(super().take(data, now_s), self.session).copy()
        return encode(self.alter(out), self.session)


@contextlib.contextmanager
def simulator(*options: str) -> Iterator[tuple[subprocess.Popen, str]]:
    """`gsid simulate` in a process of its own, and the path of its port."""
    process = subprocess.Popen(
        [*GSID, "simulate", *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        yield process, process.stdout.readline().strip()
    finally:
        process.terminate()
        process.communicate(timeout=10)


def multisine(n_period: int = 600, n_lines: int = 40, amplitude: float = 3.0) -> np.ndarray:
    """One period of a random-phase multisine, made without the library."""
    phase = np.random.default_rng(7).uniform(0, 2 * np.pi, n_lines)
    n, k = np.arange(n_period), np.arange(1, n_lines + 1)
    return amplitude * np.cos(2 * np.pi * np.outer(n, k) / n_period + phase).sum(axis=1)


def frames_in(data: bytes, session: int = SESSION) -> np.ndarray:
    """All frames of a session in a string of bytes."""
    return Receiver(session).decode(data)
