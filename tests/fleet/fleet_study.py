"""Studies of `gsid fleet`: faults in the middle of a run, overhead, memory and scaling.

Faults: units are diagnosed by two workers on two addresses of this host, through a scheduler of its own. When
a quarter is done a worker is killed, when half is done the scheduler is ended and started again, and one
record crashes its process. The answers have to be those of one process that runs unit after unit.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import resource
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from fleet_works import write_records

from gsid.cli.fleet_verb import VerbOfRecipe
from gsid.fleet.cluster import Cluster, run_on
from gsid.fleet.forks import Setup
from gsid.fleet.plan import Shard, Unit, read_plan, units_of, write_plan
from gsid.fleet.recipe import read_recipe
from gsid.fleet.run import missing_jobs, run_here
from gsid.fleet.store import Store
from gsid.fleet.table import merge
from gsid.fleet.unit import Job

HERE = str(Path(__file__).parent)
RECIPE = """verb = "diagnose"
[options]
output = "rate"
fast = true
"""
OF_A_RUN = ("seconds", "host", "peak_memory_mb")  # what differs between two runs of the same unit


# ---- faults ---------------------------------------------------------------------------------------------


@dataclass
class Dask:
    """A scheduler, and workers on several addresses of this host, which can be ended and started again."""

    log: Path
    port: int = field(default_factory=lambda: _free_port())
    scheduler: subprocess.Popen | None = None
    workers: dict[str, subprocess.Popen] = field(default_factory=dict)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def start_scheduler(self) -> None:
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"
        )

    def start_worker(self, host: str) -> None:
        words = ("--host", host, "--nthreads", "1", "--no-dashboard", "--memory-limit", "0")
        self.workers[host] = self._start("worker", self.address, *words)

    def _start(self, *words: str) -> subprocess.Popen:
        with self.log.open("a") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *words], stdout=log, stderr=log, start_new_session=True
            )

    def end(self) -> None:
        for process in (*self.workers.values(), self.scheduler):
            if process is not None:
                process.terminate()
                process.wait()


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def faults_at(dask: Dask, answers: list, total: int) -> Iterator[tuple[int, Callable[[], None]]]:
    """Number of answers at which each fault happens."""

    def kill_worker() -> None:
        import psutil

        nanny = psutil.Process(dask.workers["127.0.0.2"].pid)
        for process in (*nanny.children(recursive=True), nanny):
            with contextlib.suppress(psutil.NoSuchProcess):
                process.send_signal(signal.SIGKILL)
        dask.workers["127.0.0.2"].wait()
        dask.start_worker("127.0.0.2")

    def restart_scheduler() -> None:
        dask.scheduler.terminate()
        dask.scheduler.wait()
        dask.start_scheduler()
        for host, worker in list(
            dask.workers.items()
        ):  # they end with their scheduler; a supervisor starts them
            worker.terminate()
            worker.wait()
            dask.start_worker(host)

    yield total // 4, kill_worker
    yield total // 2, restart_scheduler


def study_faults(folder: Path, n: int, seed: int) -> dict:
    """Run the units with faults and one by one; returns the figures."""
    records = write_records(folder / "records", n, seed, crash=n // 3)
    (folder / "recipe.toml").write_text(RECIPE)
    recipe = read_recipe(folder / "recipe.toml")
    verb = VerbOfRecipe(recipe)

    def job_of(unit: Unit) -> Job:
        return replace(verb.job(unit), work="fleet_works:diagnose_or_crash")

    def planned(name: str) -> tuple[Setup, Path]:
        setup = Setup(str(folder / name), (*verb.modules, "fleet_works"), recipe.limits, (HERE,))
        return setup, write_plan(
            folder / name, Shard(), verb.header(), units_of([str(records)], recipe), job_of
        )

    setup, plan = planned("faults")
    shutil.rmtree(Store(setup.folder).folder, ignore_errors=True)
    answers: list[dict] = []
    dask = Dask(folder / "dask.log")
    began = time.monotonic()
    try:
        dask.start_scheduler()
        for host in ("127.0.0.1", "127.0.0.2"):
            dask.start_worker(host)
        threading.Thread(target=_make_faults, args=(dask, answers, n), daemon=True).start()
        jobs = missing_jobs(plan, Store(setup.folder))
        run_on(Cluster(dask.address), setup, jobs, answers.append, _tell)
    finally:
        dask.end()
    took_s = time.monotonic() - began
    alone, plan_alone = planned("one_by_one")
    run_here(alone, missing_jobs(plan_alone, Store(alone.folder)), lambda result: None)
    return _compared(folder, answers, plan) | {"units": n, "seed": seed, "seconds": took_s}


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _make_faults(dask: Dask, answers: list, n: int) -> None:
    for at, fault in faults_at(dask, answers, n):
        while len(answers) < at:
            time.sleep(0.05)
        _tell(f"{len(answers)} done: {fault.__name__}")
        fault()


def _compared(folder: Path, answers: list[dict], plan: Path) -> dict:
    stores = [Store(folder / name) for name in ("faults", "one_by_one")]
    jobs = [planned.job for planned in read_plan(plan)]
    keys = [answer["key"] for answer in answers]
    differ = sum(_answer(stores[0].read(job.key)) != _answer(stores[1].read(job.key)) for job in jobs)
    merged = merge([folder / "faults"], folder / "faults")
    return {
        "lost": len({job.key for job in jobs} - set(keys)),
        "reported_twice": len(keys) - len(set(keys)),
        "answers_that_differ": differ,
        "status": merged.status,
        "failed": dict(merged.failed),
    }


def _answer(result: dict) -> str:
    """What two runs have in common."""
    kept = {key: value for key, value in result.items() if key not in OF_A_RUN}
    if "answer" in kept:
        kept["answer"] = {key: value for key, value in kept["answer"].items() if key != "seconds"}
    if "failure" in kept:
        kept["failure"] = {key: value for key, value in kept["failure"].items() if key != "output"}
    return json.dumps(kept, sort_keys=True)


# ---- overhead, memory, scaling ----------------------------------------------------------------------------


def _plan_of_works(folder: Path, n: int, **arguments: object) -> tuple[Setup, Path]:
    setup = Setup(str(folder), ("fleet_works",), paths=(HERE,))
    units = (Unit(f"unit{i}", ()) for i in range(n))

    def job_of(unit: Unit) -> Job:
        number = int(unit.name.removeprefix("unit"))
        return Job(f"{number:064x}"[::-1], "fleet_works:work", unit.name, arguments=dict(arguments))

    return setup, write_plan(folder, Shard(), {}, units, job_of)


def _timed(folder: Path, n_workers: int, n: int, **arguments: object) -> tuple[float, float]:
    """Seconds from the first to the last answer, and the growth of the memory of the command [MB]."""
    shutil.rmtree(folder, ignore_errors=True)
    setup, plan = _plan_of_works(folder, n, **arguments)
    at: list[float] = []
    before = _peak_mb()
    jobs = missing_jobs(plan, Store(folder))
    run_on(Cluster(None, n_workers), setup, jobs, lambda result: at.append(time.monotonic()), _tell)
    if len(at) != n:
        raise RuntimeError(f"{len(at)} answers of {n} units")
    return at[-1] - at[0], _peak_mb() - before


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10


def study_overhead(folder: Path, n: int) -> dict:
    """Units that wait for one second, so that other load on the machine does not count as overhead."""
    took_s, _ = _timed(folder / "overhead", 1, n, seconds=1.0)
    return {"units": n, "seconds": took_s, "overhead": took_s / (n - 1) - 1.0}


def study_scaling(folder: Path, n: int) -> dict:
    """Units that compute for one second, on one and on two processes."""
    one_s, two_s = (_timed(folder / "scaling", workers, n, busy_s=1.0)[0] for workers in (1, 2))
    return {"units": n, "one_s": one_s, "two_s": two_s, "scaling": one_s / two_s}


def study_memory(folder: Path, n: int) -> dict:
    """Plan, run and merge many units of a millisecond; the peak of the command over that of an empty one."""
    before = _peak_mb()
    took_s, growth = _timed(folder / "memory", 2, n, seconds=0.001)
    merged = merge([folder / "memory"], folder / "memory")
    figures = {"units": n, "seconds": took_s, "status": merged.status, "growth_running_mb": growth}
    return figures | {"growth_mb": _peak_mb() - before}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=["faults", "overhead", "scaling", "memory"])
    parser.add_argument("--units", type=int, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    folder = args.output.absolute() / args.study
    folder.mkdir(parents=True, exist_ok=True)
    if args.study == "faults":
        figures = study_faults(folder, args.units, args.seed)
    else:
        figures = {"overhead": study_overhead, "scaling": study_scaling, "memory": study_memory}[args.study](
            folder, args.units
        )
    print(json.dumps({"study": args.study, **figures}), flush=True)


if __name__ == "__main__":
    main()
