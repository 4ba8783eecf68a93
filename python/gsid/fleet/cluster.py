"""Runs jobs on a Dask cluster: a local one, or that of a scheduler.

Dask only decides which worker takes which unit. A worker runs it in a process of its own and writes the
result to the store, so that a lost worker or scheduler loses only the units that were running; they are given
out again.
"""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import logging
import queue
import signal
import threading
import time
from collections import Counter as Tally
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from typing import Any

from gsid.base.errors import InputError
from gsid.base.threads import n_cores
from gsid.fleet.extra import require
from gsid.fleet.forks import Forks, Setup
from gsid.fleet.run import OnDone
from gsid.fleet.store import Store
from gsid.fleet.unit import CHANGED, FAILED, Job, require_same_version, result_of, version

WINDOW = 16  # jobs given out for each core: the memory of client and scheduler does not grow with the fleet
LOST_MOST = 5  # workers that may be lost while they run a unit, before this is its result
PATIENCE_S = 600.0  # how long the scheduler may be away
VISIBLE_S = 30.0  # how long a network file system may take to show a file of another machine
POLL_S = 0.5
CONNECT_S = 10.0  # for one attempt to reach the scheduler
HAS_DASHBOARD = importlib.util.find_spec("bokeh") is not None
ASK_S = 5.0  # between two questions how many workers there are

_LOCAL = threading.local()  # a worker may have several threads, each with a fork server of its own


def dask_setup(worker: object) -> None:
    """Leave Ctrl-C to the command, which ends the workers. Dask calls this in each local worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_on_worker(setup: Setup, job: Job, expected: str) -> dict[str, Any]:
    """Run one job in a worker."""
    require_same_version(expected)
    servers = _LOCAL.__dict__.setdefault("servers", {})
    if setup not in servers:
        servers[setup] = Forks(setup)
    return servers[setup].run(job)


@dataclass(frozen=True)
class Cluster:
    """Where units run.

    Attributes
    ----------
    scheduler : str or None
        Address, for example tcp://host:8786. None: a local cluster, one process for each core, for this run.
    n_workers : int or None
        Processes of the local cluster; default: one for each usable core.
    """

    scheduler: str | None = None
    n_workers: int | None = None

    @contextlib.contextmanager
    def client(self, announce: Callable[[str], None], patience_s: float = 0.0) -> Iterator[Any]:
        """Client of the scheduler, or of a local cluster that ends with it.

        Parameters
        ----------
        announce : callable
            Receives the address of Dask's dashboard, if bokeh is installed.
        patience_s : float
            How long to wait for the scheduler [s], beside one attempt.

        Raises
        ------
        InputError
            Dask is not installed, or no scheduler answers.
        """
        require("dask", "distributed")
        from distributed import Client

        for name in (
            "distributed",
            "distributed.client",
            "distributed.worker",
        ):  # at length for each lost worker
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        with contextlib.ExitStack() as stack:
            target = self.scheduler or stack.enter_context(self._local())
            end_s = time.monotonic() + patience_s
            while True:
                try:
                    client = Client(target, timeout=CONNECT_S, set_as_default=False)
                    break
                except (OSError, TimeoutError, ValueError) as error:
                    if time.monotonic() > end_s:
                        hint = "start it with `dask scheduler`, then repeat the command: results are kept"
                        raise InputError("no scheduler answers", str(target), str(error), hint) from None
            stack.enter_context(client)
            if HAS_DASHBOARD:
                announce(client.dashboard_link)
            yield client

    def _local(self) -> Any:
        from distributed import LocalCluster

        return LocalCluster(
            n_workers=self.n_workers or n_cores(),
            threads_per_worker=1,
            memory_limit=0,  # limits are those of the recipe, for each unit
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
            preload=__name__,
        )


def run_on(
    cluster: Cluster, setup: Setup, jobs: Iterable[Job], on_done: OnDone, announce: Callable[[str], None]
) -> None:
    """Run jobs on a cluster. If its scheduler ends, wait until it is there again.

    Parameters
    ----------
    cluster : Cluster
    setup : Setup
    jobs : iterable of Job
        Read as places become free.
    on_done : callable
        Receives key, status and seconds of each result.
    announce : callable
        Receives messages for the user.

    Raises
    ------
    InputError
        A worker has another version of gsid, its results are not visible here, or the scheduler stays away.
    """
    left = _Jobs(setup, iter(jobs), on_done)
    patience_s = 0.0
    while True:
        with cluster.client(lambda address: announce(f"dashboard: {address}"), patience_s) as client:
            if _Dispatcher(client, left).run():
                return
        announce("the scheduler has ended: waiting until it is there again")
        patience_s = PATIENCE_S


@dataclass
class _Jobs:
    """Jobs that are not done. They outlive the connection to a scheduler."""

    setup: Setup
    jobs: Iterator[Job]
    on_done: OnDone
    again: list[Job] = field(default_factory=list)
    lost: Tally[str] = field(default_factory=Tally)

    def __iter__(self) -> Iterator[Job]:
        while True:
            job = self.again.pop() if self.again else next(self.jobs, None)
            if job is None:
                return
            yield job


class _Dispatcher:
    """Gives out a limited number of jobs at a time, and those of lost workers again."""

    def __init__(self, client: Any, left: _Jobs) -> None:
        self.client, self.left = client, left
        self.store = Store(left.setup.folder)
        self.ready: queue.SimpleQueue = queue.SimpleQueue()
        self.running: dict[str, tuple[Job, Any]] = {}  # by address, with its future
        self._cores, self._asked_s = 0, 0.0

    def run(self) -> bool:
        """Run until all are done; False if the scheduler has ended before."""
        while self.client.status == "running":
            with contextlib.suppress(OSError, TimeoutError):  # the connection breaks: its status changes soon
                self._give_out()
                if not self.running:
                    return True
            with contextlib.suppress(queue.Empty):
                key = self.ready.get(timeout=POLL_S)
                job, future = self.running.pop(key)
                self._finished(job, future)
        self.left.again += [job for job, _ in self.running.values()]
        return False

    def _give_out(self) -> None:
        room = max(1, WINDOW * self._n_cores()) - len(self.running)
        for job in itertools.islice(self.left, max(0, room)):
            if job.key in self.running:  # a unit with the same content
                continue
            try:
                future = self.client.submit(run_on_worker, self.left.setup, job, version(), pure=False)
            except OSError:
                self.left.again.append(job)
                raise
            self.running[job.key] = job, future
            future.add_done_callback(lambda _, key=job.key: self.ready.put(key))

    def _n_cores(self) -> int:
        now_s = time.monotonic()
        if now_s > self._asked_s + ASK_S:
            self._asked_s = now_s
            workers = self.client.scheduler_info(n_workers=-1)["workers"].values()
            self._cores = sum(worker["nthreads"] for worker in workers)
        return self._cores

    def _finished(self, job: Job, future: Any) -> None:
        """Report a job that has ended, or keep it to be given out again."""
        from distributed.scheduler import KilledWorker

        if future.status == "finished":
            try:
                answer = future.result()
            except (CancelledError, OSError):  # the scheduler has ended before it sent the answer
                self.left.again.append(job)
                return
            self._require_visible(answer)
            self.left.on_done(answer)
        elif future.status != "error":  # cancelled or lost: the scheduler has ended
            self.left.again.append(job)
        elif not isinstance(error := future.exception(), KilledWorker):
            raise error
        else:
            self._worker_lost(job)

    def _worker_lost(self, job: Job) -> None:
        self.left.lost[job.key] += 1
        if self.left.lost[job.key] < LOST_MOST:
            self.left.again.append(job)
            return
        text = f"{LOST_MOST} times, workers were lost while they ran it"
        self.store.write(result_of(job, FAILED, failure={"kind": "worker", "text": text}))
        self.left.on_done({"key": job.key, "status": FAILED, "seconds": None})

    def _require_visible(self, answer: dict[str, Any]) -> None:
        end = time.monotonic() + VISIBLE_S
        while answer["status"] != CHANGED and not self.store.has(answer["key"]):
            if time.monotonic() > end:
                hint = (
                    "records and results have to be on a file system that all machines share, or use --shard"
                )
                raise InputError(
                    "a result of a worker is not visible here", str(self.store.folder), None, hint
                )
            time.sleep(POLL_S)
