"""Jobs on several threads: results in order, and the first exception."""

import threading
import time

import pytest

from gsid.base.threads import in_parallel, n_threads


def test_results_come_in_the_order_of_the_jobs():
    def late(i):
        time.sleep(0.02 * (3 - i))
        return i, threading.get_ident()

    found = in_parallel(late, range(4))
    assert [i for i, _ in found] == [0, 1, 2, 3]
    assert len({thread for _, thread in found}) <= n_threads(4)


def test_no_jobs_have_no_results():
    assert in_parallel(abs, []) == []
    assert n_threads(0) == 1


def test_the_first_exception_is_raised():
    def fail(i):
        if i:
            raise ValueError(f"job {i}")

    with pytest.raises(ValueError, match="job 1"):
        in_parallel(fail, range(3))


def test_the_longest_jobs_start_first_and_results_keep_their_order(monkeypatch):
    monkeypatch.setenv("GSID_THREADS", "2")
    began = []

    def long(seconds):
        began.append(seconds)
        time.sleep(seconds)
        return seconds

    jobs = [0.01, 0.02, 0.2, 0.1]
    assert in_parallel(long, jobs, size=float) == jobs
    assert set(began[:2]) == {0.2, 0.1}
    assert began[2:] == [0.02, 0.01]


def test_after_an_exception_waiting_jobs_do_not_start(monkeypatch):
    monkeypatch.setenv("GSID_THREADS", "2")
    began = []

    def fail(i):
        began.append(i)
        time.sleep(0.05)
        if i == 0:
            raise ValueError("the first")

    with pytest.raises(ValueError, match="the first"):
        in_parallel(fail, range(20))
    assert len(began) < 20
