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
