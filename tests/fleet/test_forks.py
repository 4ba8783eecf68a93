"""Every unit in a process of its own: what goes wrong in one is its result, and nothing else."""

import signal
from dataclasses import replace

import pytest

from gsid.fleet.forks import Forks
from gsid.fleet.store import Store
from gsid.fleet.unit import CHANGED, DONE, FAILED, Limits


@pytest.mark.parametrize(
    ("arguments", "kind", "text"),
    [
        ({"signal": signal.SIGSEGV}, "signal", "SIGSEGV"),
        ({"signal": signal.SIGKILL}, "signal", "SIGKILL"),
        ({"bytes": 10**12}, "memory", "memory"),
        ({"exit": 7}, "exit", "exit status 7"),
        ({"text": "no such line"}, "exception", "ValueError: no such line"),
        ({"value": float("nan")}, "exception", "not JSON compliant"),
    ],
)
def test_a_failure_is_a_result(forks, job_of, setup, arguments, kind, text):
    bad, good = job_of(**arguments), job_of(value=5)
    assert [forks.run(one)["status"] for one in (bad, good)] == [FAILED, DONE]
    result = Store(setup.folder).read(bad.key)
    assert result["failure"]["kind"] == kind
    assert text in result["failure"]["text"]
    assert result["seed"] == bad.seed
    assert result["host"]
    assert result["peak_memory_mb"] > 1
    assert Store(setup.folder).read(good.key)["answer"] == {"value": 5, "threads": 1}


def test_a_crash_shows_where_it_was(forks, job_of, setup):
    job = job_of(signal=signal.SIGSEGV)
    forks.run(job)
    output = Store(setup.folder).read(job.key)["failure"]["output"]
    assert "Segmentation fault" in output
    assert "fleet_works.py" in output


def test_a_unit_that_does_not_end_is_ended(setup, job_of):
    forks = Forks(replace(setup, limits=Limits(seconds=0.2)))
    job = job_of(seconds=60)
    assert forks.run(job)["status"] == FAILED
    assert Store(setup.folder).read(job.key)["failure"]["kind"] == "time"
    forks.end()


def test_a_result_is_computed_once(forks, job_of, setup, tmp_path):
    log = tmp_path / "log"
    job = job_of(log=str(log))
    for _ in range(3):
        assert forks.run(job)["status"] == DONE
    assert log.read_text() == f"{job.unit}\n"


def test_a_damaged_result_is_computed_again(forks, job_of, setup):
    job, store = job_of(value=3), Store(setup.folder)
    forks.run(job)
    store.path(job.key).write_text('{"key": "')
    assert store.read(job.key) is None
    forks.run(job)
    assert store.read(job.key)["answer"]["value"] == 3


def test_a_server_that_was_killed_is_started_again(forks, job_of):
    forks.run(job_of())
    forks._process.kill()
    assert forks.run(job_of())["status"] == DONE


def test_records_that_changed_after_the_plan_have_no_result(forks, job_of, setup, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("1")
    job = replace(job_of(), records=[str(path)], digests=[".csv:0"])
    assert forks.run(job)["status"] == CHANGED
    assert not Store(setup.folder).has(job.key)
