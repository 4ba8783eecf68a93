"""The host's end of the line: frames, what is lost and what is not, and how a run ends."""

import binascii
import struct
import threading
import time

import numpy as np
import pytest
from line import SESSION, Altered, Loopback, frames_in, multisine, quiet_axis

from gsid.base.errors import InputError
from gsid.response.streaming import StreamingFrf
from gsid.rig import link
from gsid.rig import run as rig_run
from gsid.rig.frames import (
    COMMAND,
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
from gsid.rig.link import Link, LinkError, Stopped, new_session
from gsid.rig.run import WINDOW, run
from gsid.rig.server import Server

N = 600
SETTLE = 2 * N


def expected_run(n: int, u: np.ndarray, **parameters: float) -> tuple[np.ndarray, np.ndarray]:
    """What the axis does when every command arrives, in the line's single precision."""
    command = u[np.arange(n) % len(u)].astype(np.float32)
    u_applied, y, _ = quiet_axis(**parameters).step(command)
    return u_applied.astype(np.float32), y.astype(np.float32)


def test_frames_are_those_of_the_protocol():
    frame = frames(SAMPLE, [7, 2**32 - 1], [1.5, -3.0], [0.1, 1e-30], [3, 0])
    want = b""
    for tick, a, b, flags in ((7, 1.5, 0.1, 3), (2**32 - 1, -3.0, 1e-30, 0)):
        body = struct.pack("<BBIff", SAMPLE, flags, tick, a, b)
        want += b"\xa5\x5a" + body + struct.pack("<H", binascii.crc_hqx(body, SESSION))
    assert encode(frame, SESSION) == want
    hello = struct.pack("<BBIff", HELLO, VERSION, SESSION, 0.0, 0.0)
    assert encode(hello_frame(SESSION), 5) == b"\xa5\x5a" + hello + struct.pack(
        "<H", binascii.crc_hqx(hello, 0xFFFF)
    )
    receiver = Receiver(SESSION)
    np.testing.assert_array_equal(receiver.decode(b"garbage" + want), frame)
    assert (receiver.n_frames, receiver.n_damaged, receiver.n_garbage) == (2, 0, 7)
    assert "2 frames" in repr(receiver)


def test_a_frame_in_pieces_and_an_unknown_kind():
    data = encode(frames(COMMAND, np.arange(100), 1.0, 2.0), SESSION)
    receiver = Receiver(SESSION)
    got = np.concatenate([receiver.decode(data[at : at + 7]) for at in range(0, len(data), 7)])
    np.testing.assert_array_equal(got["tick"], np.arange(100))
    with pytest.raises(ValueError, match="frame 0 is of unknown kind 9"):
        encode(frames(9), SESSION)


def test_the_record_is_what_the_axis_did():
    u = multisine(N)
    line = Loopback(Server(quiet_axis()))
    frf = StreamingFrf(3000.0, N, np.arange(1, 41), settle_samples=SETTLE)
    seen = []
    record = run(line, u, periods=3, frf=frf, on_progress=seen.append, meta={"who": "test"})
    u_want, y_want = expected_run(5 * N, u)
    np.testing.assert_array_equal(record.u, u_want)
    np.testing.assert_array_equal(record.y, y_want)
    assert record.valid.all()
    assert (record.period_samples, record.settle_samples, record.hold) == (N, SETTLE, "zoh")
    assert (record.u_unit, record.y_unit, record.fs_hz) == ("command", "deg/s", 3000.0)
    assert record.meta["good_periods"] == "3"
    assert record.meta["command_zero_confirmed"] == "yes"
    assert record.meta["who"] == "test"
    assert (seen[-1].good, seen[-1].lost, seen[-1].requested) == (3, 0, 3)
    assert frf.n_periods == 3
    assert line.stopped


def test_a_lost_sample_spoils_its_period_only():
    u = multisine(N)
    lost = SETTLE + N + 17
    line = Loopback(Server(quiet_axis()), lambda kind, tick: kind == SAMPLE and tick == lost)
    frf = StreamingFrf(3000.0, N, np.arange(1, 41), settle_samples=SETTLE)
    record = run(line, u, periods=3, frf=frf)
    assert np.flatnonzero(~record.valid).tolist() == [lost]
    _, y_want = expected_run(6 * N, u)
    np.testing.assert_array_equal(record.y[record.valid], y_want[record.valid])
    assert (record.meta["good_periods"], record.meta["spoiled_periods"]) == ("3", "1")
    assert (frf.n_periods, frf.n_spoiled) == (3, 1)


def test_one_lost_command_frame_costs_nothing():
    u = multisine(N)
    line = Loopback(Server(quiet_axis()), lambda kind, tick: kind == COMMAND and tick % 100 == 50)
    record = run(line, u, periods=3)
    assert record.valid.all()
    np.testing.assert_array_equal(record.y, expected_run(5 * N, u)[1])


@pytest.mark.parametrize("its_sample_too", [False, True])
def test_a_lost_command_lets_the_axis_settle_again(its_sample_too):
    u = multisine(N)
    at = SETTLE + N + 100

    def lose(kind, tick):
        return (kind == COMMAND and tick in (at - 1, at)) or (
            its_sample_too and kind == SAMPLE and tick == at
        )

    record = run(Loopback(Server(quiet_axis()), lose), u, periods=3, settle=SETTLE)
    first = at + 1 if its_sample_too else at  # the count shows it with the next sample
    assert np.flatnonzero(~record.valid).tolist() == list(range(at, first + SETTLE + 1))
    assert record.meta["lost_commands"] == "1"
    # the periods of the lost command and of the settling are out: 1, 2 and 3 of 6
    assert (record.meta["good_periods"], record.meta["spoiled_periods"]) == ("3", "3")


def test_a_long_silence_counts_as_a_disturbance():
    """128 commands lost with their samples bring the count back to where it was."""
    at = SETTLE + 50
    lose = range(at, at + 129)
    line = Loopback(Server(quiet_axis()), lambda kind, tick: tick in lose)
    record = run(line, multisine(N), periods=2, settle=N)
    last = at + 129 if record.meta["lost_commands"] == "0" else at + 128
    assert not record.valid[at : last + N].any()
    assert record.meta["good_periods"] == "2"


def test_a_sample_that_is_no_number_is_lost():
    class Odd(Server):
        def take(self, data, now_s=0.0):
            out = frames_in(super().take(data, now_s), self.session).copy()
            out["b"][(out["kind"] == SAMPLE) & (out["tick"] == SETTLE + 3)] = np.nan
            return encode(out, self.session)

    record = run(Loopback(Odd(quiet_axis())), multisine(N), periods=2)
    assert np.flatnonzero(~record.valid).tolist() == [SETTLE + 3]
    assert np.isfinite(record.y).all()


def test_what_is_under_way_is_sent_again(monkeypatch):
    """All that is under way once is lost, commands or samples: the run goes on after a pause."""
    monkeypatch.setattr(rig_run, "QUIET_S", 0.05)
    for kind_lost in (COMMAND, SAMPLE):
        burst = set(range(SETTLE + 100, SETTLE + 100 + 2 * WINDOW))

        def lose(kind, tick, kind_lost=kind_lost, burst=burst):
            if kind == kind_lost and tick in burst:
                burst.remove(tick)
                return True
            return False

        record = run(Loopback(Server(quiet_axis()), lose), multisine(N), periods=3)
        assert record.meta["good_periods"] == "3"
        if kind_lost == COMMAND:
            assert record.valid.all()  # lock-step waits: nothing is lost


def test_a_dead_axis_is_given_up(monkeypatch):
    monkeypatch.setattr(rig_run, "QUIET_S", 0.05)
    monkeypatch.setattr(rig_run, "SILENT_S", 0.2)
    line = Loopback(Server(quiet_axis()), lambda kind, tick: tick >= SETTLE + 1000)
    with pytest.raises(LinkError, match="no sample from the axis") as caught:
        run(line, multisine(N), periods=3)
    assert len(caught.value.record) == SETTLE + N  # whole periods
    assert caught.value.hint
    assert line.stopped


def test_no_reply(monkeypatch):
    monkeypatch.setattr(link, "QUIET_S", 0.02)
    monkeypatch.setattr(link, "SILENT_S", 0.06)

    class Nobody(Loopback):
        def read(self):
            return b""

    with pytest.raises(LinkError, match="does not answer") as caught:
        run(Nobody(Server(quiet_axis())), multisine(N), periods=1)
    assert caught.value.record is None


def test_too_many_lost_periods_end_the_run():
    line = Loopback(Server(quiet_axis()), lambda kind, tick: kind == SAMPLE and tick % N == 5)
    with pytest.raises(LinkError, match="too many periods are lost") as caught:
        run(line, multisine(N), periods=12)
    record = caught.value.record
    assert (record.meta["good_periods"], record.meta["spoiled_periods"]) == ("0", "8")
    assert "0 good of 8, 12 requested" in str(caught.value)
    assert isinstance(caught.value, InputError)
    assert line.stopped

    every_other = Loopback(
        Server(quiet_axis()), lambda kind, tick: kind == SAMPLE and tick // N % 6 and not tick % N
    )
    with pytest.raises(LinkError, match="2 good of 12, 3 requested"):
        run(every_other, multisine(N), periods=3)


def test_an_unplugged_port_keeps_what_was_measured():
    class Unplugged(Loopback):
        def read(self):
            if self.server.served.ticks > SETTLE + 2 * N:
                raise OSError("device disconnected")
            return super().read()

    with pytest.raises(LinkError, match="the port is gone") as caught:
        run(Unplugged(Server(quiet_axis())), multisine(N), periods=20)
    record = caught.value.record
    assert len(record) > SETTLE
    assert record.meta["command_zero_confirmed"] == "no"


def test_ctrl_c_leaves_the_command_at_zero():
    class Impatient(Loopback):
        def read(self):
            if self.server.running and self.server.served.ticks > SETTLE + 3 * N:
                self.server.served.ticks = 0  # once
                raise KeyboardInterrupt
            return super().read()

    line = Impatient(Server(quiet_axis()))
    with pytest.raises(Stopped) as caught:
        run(line, multisine(N), periods=50)
    assert line.stopped
    assert caught.value.record.meta["command_zero_confirmed"] == "yes"
    assert len(caught.value.record) >= SETTLE


def test_bug_an_error_of_who_is_shown_the_run_must_leave_the_command_at_zero():
    """What JSON cannot store raised in the function that sends the figures."""
    line = Loopback(Server(quiet_axis()))

    def show(now):
        if now.ticks > 3000:
            raise ValueError("Out of range float values are not JSON compliant: inf")

    with pytest.raises(ValueError, match="Out of range") as caught:
        run(line, multisine(N), periods=20, settle=SETTLE, on_progress=show)
    assert line.stopped
    assert caught.value.record.meta["command_zero_confirmed"] == "yes"
    assert len(caught.value.record) >= 3000 - N  # whole periods


def test_bug_a_run_beyond_the_memory_was_an_internal_error():
    with pytest.raises(InputError, match="the run is too long"):
        run(Loopback(Server(quiet_axis())), multisine(N), periods=10**12, settle=0)


def test_samples_under_way_when_a_run_is_stopped_are_kept():
    """A busy computer had a tenth of a second of them unread, and threw them away with the answer to STOP."""

    class Unread(Loopback):
        n_read = 0

        def read(self):
            data, self.waiting = self.waiting[:1800], self.waiting[1800:]
            self.n_read += len(data)
            return data

    line = Unread(Server(quiet_axis()))
    with pytest.raises(Stopped) as caught:
        run(line, multisine(100), periods=50, settle=0, should_stop=lambda: line.n_read > 30_000)
    assert line.stopped
    assert not line.waiting
    assert len(caught.value.record) == line.server.served.ticks // 100 * 100


def test_another_rate_is_refused():
    with pytest.raises(LinkError, match=r"another rate .*2000 Hz, not 3000 Hz") as caught:
        run(Loopback(Server(quiet_axis(fs_hz=2000))), multisine(N), periods=1)
    assert "--fs 2000" in caught.value.hint


@pytest.mark.parametrize(
    ("excitation", "options"),
    [
        (np.zeros(1), {"periods": 1}),
        (np.zeros((2, 2)), {"periods": 1}),
        (np.array([0.0, np.nan]), {"periods": 1}),
        (np.zeros(4), {"periods": 0}),
        (np.zeros(4), {"periods": 1, "settle": -1}),
    ],
)
def test_misuse(excitation, options):
    with pytest.raises(ValueError, match="at least"):
        run(Loopback(Server(quiet_axis())), excitation, **options)


def test_a_paced_axis_that_went_on_without_the_host_is_caught_up_with():
    """The host stalls for longer than its window: commands are lost, the run is not."""

    class Stalling(Loopback):
        now_s = 0.0
        stalled = False

        def write(self, data):
            self.waiting += self.server.take(data, self.now_s)

        def read(self):
            self.now_s += 0.01
            if self.server.served.ticks > SETTLE + N and not self.stalled:
                self.stalled = True
                self.now_s += 0.5
            self.waiting += self.server.keep_time(self.now_s)
            return super().read()

    line = Stalling(Server(quiet_axis(), paced=True))
    record = run(line, multisine(N), periods=3, settle=N)
    assert record.meta["good_periods"] == "3"
    assert int(record.meta["lost_commands"]) > 0


def test_link_by_hand():
    line = Loopback(Server(quiet_axis()))
    line.waiting = b"\xa5\x5a\x02 old rubbish" + encode(frames(SAMPLE, 99), SESSION)
    with Link(line, "here") as host:
        fs_hz, n_queue = host.hello()
        assert fs_hz == 3000.0
        assert n_queue >= WINDOW
        host.send(frames(COMMAND, [0, 1], 1.0, 1.0))
        assert host.receive()["tick"].tolist() == [0, 1]
        assert host.stop()
        assert "here" in repr(host)
    assert HELLO != STOP


def test_a_frame_of_an_earlier_run_in_a_good_period_is_rejected():
    """A frame left in a buffer, of a tick inside the batch, put y off by 7.5 times its peak."""
    stale = encode(frames(SAMPLE, SETTLE + 100, 2.0, 1e3), SESSION)

    class Buffered(Loopback):
        def read(self):
            whole = self.waiting[: 4086 // FRAME_BYTES * FRAME_BYTES]
            self.waiting = self.waiting[len(whole) :]
            return whole[: len(whole) // 2 // 18 * 18] + stale + whole[len(whole) // 2 // 18 * 18 :]

    record = run(Buffered(Server(quiet_axis())), multisine(N), periods=3)
    np.testing.assert_array_equal(record.y, expected_run(5 * N, multisine(N))[1])
    assert record.valid.all()
    assert int(record.meta["link_damaged"]) > 0


def test_a_frame_of_this_run_that_comes_twice_changes_nothing():
    def repeat(out):
        odd = out[(out["kind"] == SAMPLE) & (out["tick"] % 100 == 7)].copy()
        odd["b"] = 1e3
        return np.concatenate([out, odd])

    record = run(Loopback(Altered(repeat)), multisine(N), periods=3)
    np.testing.assert_array_equal(record.y, expected_run(5 * N, multisine(N))[1])
    assert record.valid.all()


def test_sessions_differ_from_the_last_and_are_in_their_range():
    drawn = [new_session(last) for last in (0, 1, SESSION_MAX) for _ in range(20_000)]
    assert min(drawn) >= 1
    assert max(drawn) <= SESSION_MAX
    assert 1 not in drawn[20_000:40_000]
    assert SESSION_MAX not in drawn[40_000:]


@pytest.mark.parametrize("flags", [0, 1, VERSION + 1])
def test_an_axis_of_another_version_is_refused(flags):
    """Version 1 answered HELLO with flags and tick zero, and knew of no sessions."""

    class Old(Loopback):
        def write(self, data):
            for frame in Receiver().decode(data):
                self.waiting += encode(frames(HELLO, 0, 3000.0, 512.0, flags), 0)
                assert frame["kind"] == HELLO  # nothing else is sent

    with pytest.raises(
        LinkError, match=f"another version .*version {max(1, flags)}, not {VERSION}"
    ) as caught:
        Link(Old(Server(quiet_axis()))).hello()
    assert "protocol.md" in caught.value.hint


@pytest.mark.parametrize("rate", [np.nan, np.inf, 0.0, -3000.0])
def test_an_invalid_rate_is_refused(rate):
    """Compared with another number, NaN was the excitation's rate."""

    def alter(out):
        out["a"][out["kind"] == HELLO] = rate
        return out

    with pytest.raises(LinkError, match="no usable rate"):
        run(Loopback(Altered(alter)), multisine(N), periods=1)


@pytest.mark.parametrize("queue", [np.nan, np.inf, 0.0])
def test_an_invalid_queue_is_refused(queue):
    def alter(out):
        out["b"][out["kind"] == HELLO] = queue
        return out

    with pytest.raises(LinkError, match="no usable rate or queue"):
        run(Loopback(Altered(alter)), multisine(N), periods=1)


@pytest.mark.parametrize("at", [17, SETTLE + N + 17])
def test_a_wrong_echo_spoils_its_period_only(at):
    """In the first period too, before the echoes of others are known."""

    def alter(out):
        out["a"][(out["kind"] == SAMPLE) & (out["tick"] == at)] += 5.0
        return out

    frf = StreamingFrf(3000.0, N, np.arange(1, 41), settle_samples=0)
    record = run(Loopback(Altered(alter)), multisine(N), periods=5, settle=0, frf=frf)
    assert not record.valid[at]
    assert set(np.flatnonzero(~record.valid) // N) <= {at // N, at // N + 1}
    assert record.meta["wrong_echoes"] != "0"
    assert record.meta["good_periods"] == "5"
    assert frf.n_periods == 5


def shifted(out):
    """The firmware reports the command of the tick before."""
    samples = np.flatnonzero(out["kind"] == SAMPLE)
    out["a"][samples] = np.roll(out["a"][samples], 1)
    return out


def counts(out):
    """The firmware reports what its converter gets."""
    out["a"][out["kind"] == SAMPLE] *= 2047 / 127
    return out


def dead(out):
    """The drive is not enabled."""
    out["a"][out["kind"] == SAMPLE] = 0
    return out


@pytest.mark.parametrize("alter", [shifted, counts, dead])
def test_an_axis_that_applies_another_command_is_refused(alter):
    line = Loopback(Altered(alter))
    with pytest.raises(LinkError, match="another command than the one sent") as caught:
        run(line, multisine(N), periods=3)
    assert "in force" in caught.value.hint
    assert line.stopped


def test_no_period_of_a_wrong_command_is_called_good():
    """Without settling, the period that showed the wrong echo counted as good in the record that was kept."""
    with pytest.raises(LinkError, match="another command than the one sent") as caught:
        run(Loopback(Altered(counts)), multisine(N), periods=3, settle=0)
    kept = caught.value.record
    assert not kept.valid.any()
    assert kept.meta["good_periods"] == "0"
    assert int(kept.meta["wrong_echoes"]) > 0.9 * N


@pytest.mark.parametrize(
    "axis", [{"command_limit": 20.0}, {"command_limit": 4.0, "command_bits": 3}, {"command_limit": 0.0}]
)
def test_a_command_clipped_and_rounded_is_the_one_sent(axis):
    for u in (multisine(N), 5 * np.sign(multisine(N)), multisine(N) + 3):
        record = run(Loopback(Server(quiet_axis(**axis))), u, periods=2, settle=N)
        assert record.valid.all()
        assert record.meta["wrong_echoes"] == "0"


class Paced(Loopback):
    """A line to a paced axis on a clock of its own: each read takes 10 ms."""

    now_s = 0.0

    def write(self, data):
        self.waiting += self.server.take(data, self.now_s)

    def read(self):
        self.now_s += 0.01
        self.waiting += self.server.keep_time(self.now_s)
        return super().read()


@pytest.fixture
def paced_line(monkeypatch):
    def line():
        paced = Paced(Server(quiet_axis(fs_hz=100.0), paced=True))
        monkeypatch.setattr(time, "monotonic", lambda: paced.now_s)
        return paced

    return line


def test_a_slow_loop_is_never_silent_for_long(paced_line):
    """At 100 Hz the host waited for a quarter of its window, 1.3 s, before it sent again."""
    record = run(paced_line(), multisine(50, 10), periods=2, settle=50, fs_hz=100.0)
    assert record.meta["lost_commands"] == "0"
    assert 0.05 < float(record.meta["longest_host_silence_s"]) < 0.15


def test_the_silence_before_the_stop_counts(paced_line):
    """Only the waits between commands were counted, not the one between the last of them and the stop."""
    line = paced_line()
    sent_s = []
    read, write = line.read, line.write
    line.write = lambda data: (sent_s.append(line.now_s), write(data))

    def slower_at_the_end():
        line.now_s += 0.12 if line.now_s > 1.4 else 0.0
        return read()

    line.read = slower_at_the_end
    record = run(line, multisine(50, 10), periods=2, settle=50, fs_hz=100.0)
    silent_s = np.diff(sent_s)
    assert silent_s[-1] == silent_s.max()
    assert float(record.meta["longest_host_silence_s"]) == pytest.approx(silent_s[-1], abs=1e-3)


def test_two_lines_at_once():
    """No state is shared: two runs in two threads measure their own axes."""
    u = multisine(N)
    records = {}

    def measure(gain):
        records[gain] = run(Loopback(Server(quiet_axis(gain=gain))), u, periods=2)

    threads = [threading.Thread(target=measure, args=(gain,)) for gain in (5.0, 9.0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for gain, record in records.items():
        np.testing.assert_array_equal(record.y, expected_run(4 * N, u, gain=gain)[1])
