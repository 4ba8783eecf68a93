"""A local cluster: workers that are killed lose nothing and compute nothing twice."""

import threading
import time

import pytest

from gsid.fleet.cluster import Cluster, _Dispatcher, run_on
from gsid.fleet.store import Store

pytestmark = pytest.mark.xdist_group("clock")


def test_a_killed_worker_loses_no_unit(setup, job_of, tmp_path, monkeypatch):
    log = tmp_path / "log"
    jobs = [job_of(log=str(log), seconds=0.1, value=i) for i in range(20)]
    jobs.append(job_of(signal=11))
    answers, clients = [], []
    give_out = _Dispatcher._give_out
    monkeypatch.setattr(_Dispatcher, "_give_out", lambda self: (clients.append(self.client), give_out(self)))

    def kill_one():
        while len(answers) < 5:
            time.sleep(0.02)
        next(iter(clients[0].cluster.workers.values())).process.process._process.kill()

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    run_on(Cluster(None, 2), setup, iter(jobs), answers.append, print)
    assert sorted(one["key"] for one in answers) == sorted(job.key for job in jobs)
    results = [Store(setup.folder).read(job.key) for job in jobs]
    assert [result["answer"]["value"] for result in results[:-1]] == list(range(20))
    assert results[-1]["failure"]["text"] == "SIGSEGV"
    # only the unit that ran when its worker was killed has begun twice
    assert len(log.read_text().split()) <= 21
