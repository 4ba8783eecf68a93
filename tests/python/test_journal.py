"""The journal of a run: what it holds when the run is cut off, and what becomes of damaged ones."""

import json
import os
import resource
import struct
import threading
import time
import zlib
from dataclasses import replace

import numpy as np
import pytest
from line import Altered, Loopback, multisine, quiet_axis

from gsid.base.errors import InputError
from gsid.rig.frames import SAMPLE
from gsid.rig.journal import Journal, JournalError, RunDescription, recover
from gsid.rig.link import LinkError
from gsid.rig.run import run
from gsid.rig.server import Server

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md
N = 600
SETTLE = 2 * N
RUN = RunDescription(1000.0, 10, 5, 1000, "A", "deg/s", "port", {"who": "test"})


def samples(n, seed=1):
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=(2, n)).astype(np.float32).astype(float)
    return u, y, rng.random(n) < 0.9


def written(path, n=47, piece=7):
    """A journal of n samples in pieces, and its samples."""
    u, y, valid = samples(n)
    journal = Journal(path, RUN)
    for first in range(0, n, piece):
        part = slice(first, min(n, first + piece))
        journal.append(first, u[part], y[part], valid[part])
    journal.close()
    return u, y, valid


def test_a_journal_gives_the_whole_periods_back(tmp_path):
    u, y, valid = written(tmp_path / "a.journal")
    got = recover(tmp_path / "a.journal")
    record = got.record
    np.testing.assert_array_equal(record.u, u[:45])
    np.testing.assert_array_equal(record.y, y[:45])
    np.testing.assert_array_equal(record.valid, valid[:45])
    assert (record.fs_hz, record.period_samples, record.settle_samples) == (1000.0, 10, 5)
    assert (record.u_unit, record.y_unit, record.hold) == ("A", "deg/s", "zoh")
    assert (record.meta["who"], record.meta["recovered_from"]) == ("test", "a.journal")
    good = valid[5:45].reshape(4, 10).all(axis=1).sum()
    assert (record.meta["good_periods"], record.meta["spoiled_periods"]) == (str(good), str(4 - good))
    assert (got.n_torn, got.n_damaged) == (0, 0)


def test_a_journal_cut_anywhere_gives_all_whole_blocks_before(tmp_path):
    path, cut = tmp_path / "a.journal", tmp_path / "cut.journal"
    u, y, _ = written(path)
    data = path.read_bytes()
    start = data.index(b"SMPL")
    for size in range(start, len(data)):
        cut.write_bytes(data[:size])
        n_blocks, n_torn = divmod(size - start, 16 + 7 * 9)
        if n_blocks == 0:
            with pytest.raises(InputError, match="contains no sample"):
                recover(cut)
            continue
        got = recover(cut)
        n = min(7 * n_blocks, 47)
        n -= (n - 5) % 10 if n >= 15 else 0
        np.testing.assert_array_equal(got.record.u, u[:n])
        np.testing.assert_array_equal(got.record.y, y[:n])
        assert (got.n_torn, got.n_damaged) == (n_torn, 0)


def test_a_journal_with_a_wrong_byte_never_gives_a_wrong_sample(tmp_path):
    path, bad = tmp_path / "a.journal", tmp_path / "bad.journal"
    u, y, valid = written(path)
    data = path.read_bytes()
    rng = np.random.default_rng(3)
    for at in range(len(data)):
        bad.write_bytes(data[:at] + bytes([data[at] ^ int(rng.integers(1, 256))]) + data[at + 1 :])
        if at < data.index(b"SMPL"):
            with pytest.raises(InputError):
                recover(bad)
            continue
        got = recover(bad)
        record = got.record
        np.testing.assert_array_equal(record.u[record.valid], u[: len(record)][record.valid])
        np.testing.assert_array_equal(record.y[record.valid], y[: len(record)][record.valid])
        assert np.count_nonzero(valid[: len(record)] & ~record.valid) <= 7
        assert got.n_torn + got.n_damaged > 0


@pytest.mark.parametrize(
    "description",
    [
        {"fs_hz": 0.0},
        {"fs_hz": float("nan")},
        {"fs_hz": "fast"},
        {"fs_hz": None},
        {"period_samples": 0},
        {"period_samples": 2.5},
        {"settle_samples": -1},
        {"capacity": 1 << 40},
        {"u_unit": 3},
        {"meta": ["a"]},
        {"meta": {"a": 1}},
        {"unknown": 1},
        {"name": None},
    ],
)
def test_a_description_that_no_run_has_is_refused(tmp_path, description):
    values = {**vars(RUN), **description}
    text = json.dumps(values).encode()
    path = tmp_path / "odd.journal"
    path.write_bytes(b"GSIDJRN1" + struct.pack("<II", len(text), zlib.crc32(text)) + text)
    with pytest.raises(InputError, match="description of the journal is damaged"):
        recover(path)


def test_a_tick_far_away_does_not_fill_the_memory(tmp_path):
    path = tmp_path / "far.journal"
    text = json.dumps({**vars(RUN), "capacity": 1 << 31}).encode()
    head = struct.pack("<II", (1 << 31) - 9, 1)
    sample = struct.pack("<ffB", 1.0, 2.0, 1)
    block = b"SMPL" + head + struct.pack("<I", zlib.crc32(head + sample)) + sample
    path.write_bytes(b"GSIDJRN1" + struct.pack("<II", len(text), zlib.crc32(text)) + text + block)
    with pytest.raises(InputError, match="contains no sample"):
        recover(path)


@pytest.mark.parametrize(
    "data", [b"", b"GSID", b"GSIDJRN1", b"GSIDJRN1\xff\xff\xff\xff\0\0\0\0", b"u,y\n1,2\n"]
)
def test_what_is_no_journal_is_refused(tmp_path, data):
    (tmp_path / "a.journal").write_bytes(data)
    with pytest.raises(InputError):
        recover(tmp_path / "a.journal")


def test_many_marks_of_blocks_that_are_none_cost_little(tmp_path):
    """Each of them claims all that follows: the checks of all would take hours."""
    path = tmp_path / "marks.journal"
    written(path)
    n = 200_000
    path.write_bytes(path.read_bytes() + n * (b"SMPL" + struct.pack("<III", 0, n, 0)))
    start = time.monotonic()
    got = recover(path)
    assert time.monotonic() - start < 10
    assert (len(got.record), got.n_torn) == (45, 16 * n)


def test_more_samples_than_a_block_holds(tmp_path):
    u, y, valid = samples(5000)
    journal = Journal(tmp_path / "a.journal", replace(RUN, capacity=5000))
    journal.append(0, u, y, valid)
    journal.close()
    np.testing.assert_array_equal(recover(tmp_path / "a.journal").record.y, y[:4995])


def test_a_journal_is_never_overwritten(tmp_path):
    written(tmp_path / "a.journal")
    before = (tmp_path / "a.journal").read_bytes()
    with pytest.raises(InputError, match="earlier run") as caught:
        Journal(tmp_path / "a.journal", RUN)
    assert "--recover" in caught.value.hint
    assert (tmp_path / "a.journal").read_bytes() == before
    with pytest.raises(JournalError, match="No such file"):
        Journal(tmp_path / "none" / "a.journal", RUN)


def test_the_journal_of_a_run_gives_its_record(tmp_path):
    def lose(kind, tick):
        return kind == SAMPLE and tick == SETTLE + N + 17

    record = run(
        Loopback(Server(quiet_axis()), lose), multisine(N), periods=3, journal=tmp_path / "a.journal"
    )
    again = recover(tmp_path / "a.journal").record
    for name in ("u", "y", "valid"):
        np.testing.assert_array_equal(getattr(again, name), getattr(record, name))
    for key in ("good_periods", "spoiled_periods", "lost_samples"):
        assert again.meta[key] == record.meta[key]


def test_a_wrong_echo_of_the_first_period_is_lost_in_the_journal_too(tmp_path):
    """It is found when the period is whole, and its samples are on the disk by then."""

    def alter(out):
        out["a"][(out["kind"] == SAMPLE) & (out["tick"] == 17)] += 5.0
        return out

    path = tmp_path / "a.journal"
    record = run(Loopback(Altered(alter)), multisine(N), periods=2, settle=0, journal=path)
    assert not record.valid[17]
    np.testing.assert_array_equal(recover(path).record.valid, record.valid)


def test_a_run_without_a_sample_leaves_no_journal(tmp_path):
    with pytest.raises(LinkError, match="another rate"):
        run(
            Loopback(Server(quiet_axis(fs_hz=2000.0))),
            multisine(N),
            periods=1,
            journal=tmp_path / "a.journal",
        )
    assert not list(tmp_path.iterdir())


def test_a_full_disk_ends_the_run_and_what_was_written_stays(tmp_path):
    """The limit on the size of files stands for the disk: a write beyond it fails as one on a full disk."""
    path = tmp_path / "a.journal"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, before[1]))
    try:
        line = Loopback(Server(quiet_axis()))
        with pytest.raises(JournalError, match="File too large") as caught:
            run(line, multisine(N), periods=1000, journal=path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert line.stopped
    assert len(caught.value.record) > 4000  # what is in memory is still offered
    kept = recover(path).record
    assert 3600 <= len(kept) <= 40_000 / 9
    np.testing.assert_array_equal(kept.y, caught.value.record.y[: len(kept)])


def test_a_disk_that_is_slow_does_not_delay_the_line(tmp_path, monkeypatch):
    """A write of 0.3 s, and a sync of 0.3 s: the samples wait, the run does not."""
    slow = os.write

    def write(file, data):
        time.sleep(0.3)
        return slow(file, data)

    journal = Journal(tmp_path / "a.journal", RUN)
    monkeypatch.setattr(os, "write", write)
    u, y, valid = samples(40)
    start = time.monotonic()
    for first in range(0, 40, 10):
        part = slice(first, first + 10)
        journal.append(first, u[part], y[part], valid[part])
    assert time.monotonic() - start < 0.1
    journal.close()
    np.testing.assert_array_equal(recover(tmp_path / "a.journal").record.u, u[:35])


def test_a_run_whose_settling_is_a_number_of_numpy_has_a_journal(tmp_path):
    path = tmp_path / "a.journal"
    run(Loopback(Server(quiet_axis())), multisine(N), periods=2, settle=np.int64(SETTLE), journal=path)
    assert recover(path).record.settle_samples == SETTLE


def test_a_description_that_cannot_be_written_leaves_no_journal(tmp_path):
    """An empty one would refuse the next run."""
    with pytest.raises(TypeError, match="serializable"):
        Journal(tmp_path / "a.journal", replace(RUN, meta={"who": object()}))
    assert not list(tmp_path.iterdir())


def test_a_journal_that_fails_leaves_no_threads(tmp_path, monkeypatch):
    def write(descriptor, data):
        if data.startswith(b"SMPL"):
            raise OSError(28, "No space left on device")
        return len(data)

    before = threading.active_count()
    monkeypatch.setattr(os, "write", write)
    with pytest.raises(JournalError, match="No space"):
        run(Loopback(Server(quiet_axis())), multisine(N), periods=20, journal=tmp_path / "a.journal")
    assert threading.active_count() == before
