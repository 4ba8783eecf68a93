"""Runs what is missing of a plan, in this process or on a cluster."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gsid.base.progress import ProgressText
from gsid.fleet.forks import Forks, Setup
from gsid.fleet.plan import read_plan
from gsid.fleet.store import Store
from gsid.fleet.unit import CHANGED, DONE, FAILED, Job

OnDone = Callable[[dict[str, Any]], None]
STEP_S = 1.0  # least time between two lines of progress


def missing_jobs(plan: Path, store: Store) -> Iterator[Job]:
    """Jobs of a plan without a result; also those whose result was damaged by a disk error."""
    for planned in read_plan(plan):
        if store.read(planned.job.key) is None:
            yield planned.job


def forget_failures(plan: Path, store: Store) -> None:
    """Remove the results of failed units of a plan."""
    for planned in read_plan(plan):
        result = store.read(planned.job.key)
        if result is not None and result["status"] == FAILED:
            store.remove(planned.job.key)


def run_here(setup: Setup, jobs: Iterable[Job], on_done: OnDone) -> None:
    """Run jobs one after the other, each in a process of its own."""
    forks = Forks(setup)
    try:
        for job in jobs:
            on_done(forks.run(job))
    finally:
        forks.end()


@dataclass
class Counter:
    """Counts the units that are done, and tells how long the others will take.

    Attributes
    ----------
    total : int
        Jobs to run.
    show : callable
        Receives the text of the progress.
    """

    total: int
    show: Callable[[str], None]
    status: dict[str, int] = field(default_factory=lambda: {DONE: 0, FAILED: 0, CHANGED: 0})
    _began_s: float = field(default_factory=time.monotonic)
    _shown_s: float = 0.0

    def __call__(self, result: dict[str, Any]) -> None:
        """Count one."""
        self.status[result["status"]] += 1
        now_s, done = time.monotonic(), sum(self.status.values())
        if now_s - self._shown_s < STEP_S and done < self.total:
            return
        self._shown_s = now_s
        left_s = (now_s - self._began_s) / done * (self.total - done)
        failed = f", {self.status[FAILED]} failed" if self.status[FAILED] else ""
        self.show(ProgressText(f"units{failed}", f"{done}/{self.total}", left_s))
