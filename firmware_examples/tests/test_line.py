"""After a fault on the line the drive is safe, the fault is reported, and the next run is good."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal

import numpy as np
import pytest
from emulator import Axis, serve

from conftest import Run, connect, emulated, measure, three_pole_axis
from gsid.rig.frames import COMMAND, HELLO, STOP, Receiver
from gsid.rig.link import SerialTransport

IMAGE = "m7-short"
MIDDLE = 900  # a tick in the middle of the run
TRIPPED, LOSSES = 2, 3  # drive_why
TRIP_MISSING, TRIP_RATE, TRIP_COMMAND = 2, 3, 5  # gsid_trip


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Run:
    """A run on an undisturbed line."""
    return measure(IMAGE, tmp_path_factory.mktemp("line") / "good", 0)


def assert_next_run_is_good(line, undisturbed) -> tuple[int, int]:
    """The drive, without a reset, reports the run before; its next run equals that of a new drive to the bit.

    Returns
    -------
    trip, why : int
        The reasons reported for the run before.
    """
    axis = Axis(three_pole_axis())
    serve(axis, line, axis.finished)
    assert axis.reports[-len(undisturbed.reports) :] == undisturbed.reports
    (trip, state) = axis.reports[:2]
    assert (trip[0], state[0]) == ("trip", "state")
    return trip[1], state[2]


def until_the_middle(path) -> None:
    """An axis whose process is killed in the middle of a run."""
    axis = Axis(three_pole_axis())
    serve(axis, connect(path), lambda: axis.ticks >= MIDDLE)
    os.kill(os.getpid(), signal.SIGKILL)


def test_the_host_is_killed(tmp_path, undisturbed):
    path = tmp_path / "line"
    with emulated(IMAGE, f"unix:{path},server=on,wait=on"):
        host = multiprocessing.get_context("fork").Process(target=until_the_middle, args=(path,))
        host.start()
        host.join()
        assert host.exitcode == -signal.SIGKILL
        assert assert_next_run_is_good(connect(path), undisturbed) == (TRIP_MISSING, TRIPPED)


def test_the_pseudo_terminal_is_unplugged(undisturbed):
    with emulated(IMAGE, "pty") as process:
        port = re.search(r"/dev/\S+", process.stdout.readline())[0]
        axis, line = Axis(three_pole_axis()), SerialTransport(port)
        serve(axis, line, lambda: axis.ticks >= MIDDLE)
        line.close()
        line = SerialTransport(port)
        assert assert_next_run_is_good(line, undisturbed) == (TRIP_MISSING, TRIPPED)
        line.close()


def test_one_byte_in_a_hundred_is_wrong(tmp_path, undisturbed):
    random = np.random.default_rng(1)

    def damage(data: bytes) -> bytes:
        block = np.frombuffer(data, np.uint8)
        wrong = random.random(len(block)) < 0.01
        return (
            (block ^ (wrong * random.integers(1, 256, len(block), dtype=np.uint8))).astype(np.uint8).tobytes()
        )

    path = tmp_path / "line"
    with emulated(IMAGE, f"unix:{path},server=on,wait=on"):
        line, axis = connect(path), Axis(three_pole_axis())
        serve(axis, line, lambda: axis.ticks > 0 and not axis.running, damage)  # STOP received
        trip, why = assert_next_run_is_good(line, undisturbed)
        assert (trip, why) == (TRIP_MISSING, TRIPPED) or why == LOSSES


def test_a_lost_sample_spoils_its_period_only(tmp_path, undisturbed):
    """The drive detects the damaged frame and leaves this sample out."""
    lost = []

    def damage(data: bytes) -> bytes:
        if axis.ticks >= MIDDLE and not lost and len(data) == 18 and data[2] == 2:
            lost.append(axis.ticks)
            return data[:-1] + bytes([data[-1] ^ 1])
        return data

    path = tmp_path / "line"
    with emulated(IMAGE, f"unix:{path},server=on,wait=on"):
        axis = Axis(three_pole_axis())
        serve(axis, connect(path), axis.finished, damage)
    state = next(row for row in axis.reports if row[0] == "state")
    good = next(row for row in undisturbed.reports if row[0] == "state")
    assert (state[2], state[3]) == (good[2], good[3])  # measured, as many good periods
    assert state[1] == good[1] + 600  # ticks: one period more
    assert lost


# Limits: 20 deg/s, and a command of 10, which the controller alone reaches at 12 deg/s.
@pytest.mark.parametrize(("bump_deg_s", "trip"), [(30.0, TRIP_RATE), (12.0, TRIP_COMMAND)])
def test_the_guard_stops_the_excitation_within_a_tick(tmp_path, undisturbed, bump_deg_s, trip):
    path = tmp_path / "line"
    with emulated(IMAGE, f"unix:{path},server=on,wait=on"):
        line, axis = connect(path), Axis(three_pole_axis())
        axis.bump = (MIDDLE, bump_deg_s)
        serve(axis, line, lambda: axis.n_stop > 0)
        received = Receiver(follows_hello=True).decode(bytes(axis.received))
        last = np.flatnonzero(received["kind"] == COMMAND)[-1]
        assert received["tick"][last] == MIDDLE  # the sample of this tick has the bump
        assert received["kind"][last + 1] == STOP
        assert received["kind"][0] == HELLO
        assert assert_next_run_is_good(line, undisturbed) == (trip, TRIPPED)
