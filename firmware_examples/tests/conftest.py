"""Runs of the emulated drive, executed once for all tests."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest
from emulator import SILENCE_S, Axis, SocketLine, emulator, serve

from gsid.rig.axis import SimulatedAxis


def three_pole_axis() -> SimulatedAxis:
    """The default axis with as many poles and zeros as the firmware fits."""
    mode = {"mode_f_hz": 60, "mode_zeta": 0.03, "mode_residue": 0.3}
    return SimulatedAxis(gyro_lag_s=0, spring_stiffness=0, **mode)


@contextlib.contextmanager
def emulated(name: str, serial: str) -> Iterator[subprocess.Popen]:
    """Run an image in the emulator with the given serial port."""
    process = subprocess.Popen(
        emulator(name, "-serial", serial), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        yield process
        assert process.poll() is None, (
            f"the emulator exited with {process.returncode}: 100 + the number of a fault"
        )
    finally:
        process.terminate()
        process.communicate(timeout=10)


def connect(path: Path) -> SocketLine:
    line = socket.socket(socket.AF_UNIX)
    line.settimeout(SILENCE_S)
    end = time.monotonic() + SILENCE_S
    while True:
        try:
            line.connect(str(path))
            return SocketLine(line)
        except OSError:
            assert time.monotonic() < end, "the emulator does not start"
            time.sleep(0.01)


@dataclass
class Run:
    """All bytes that the axis sent and received, and the report as `Axis.reports`."""

    sent: bytes
    received: bytes
    reports: list[tuple[str, int, float, float]]


def measure(name: str, path: Path, cpu: int) -> Run:
    """Execute one whole run. It is several times faster with emulator and axis on the same processor."""
    cpus = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cpus[cpu % len(cpus)]})  # inherited by the emulator
    axis = Axis(three_pole_axis())
    with emulated(name, f"unix:{path},server=on,wait=on"):
        serve(axis, connect(path), axis.finished)
    return Run(bytes(axis.sent), bytes(axis.received), axis.reports)


@pytest.fixture(scope="session")
def runs(tmp_path_factory) -> dict[str, Run]:
    """500 lines over 10 periods: twice on the M7, once on the M4F."""
    folder = tmp_path_factory.mktemp("line")
    names = {"first": "m7-full", "second": "m7-full", "m4": "m4-full"}
    with ProcessPoolExecutor(len(names)) as pool:
        made = {
            key: pool.submit(measure, name, folder / key, cpu)
            for cpu, (key, name) in enumerate(names.items())
        }
        return {key: run.result() for key, run in made.items()}
