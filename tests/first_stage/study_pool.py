"""Trials of a study in processes of their own, with a time bound, and a file of results.

A trial is a sequence of parts. The results of a trial are one line of JSON, which is written at once when the
trial is done: a run that was broken off goes on with the trials that are not in the file. A part that exceeds
the bound is ended with its process; the rest of its trial goes on in a new one.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path

Row = dict
Task = tuple  # (seed, kind, index, ...), as JSON can keep it
# Parts of a task from a number on: first what is known before, then the whole row of each part.
Work = Callable[[Task, int], Iterator[tuple[str, Row]]]
OVER, CRASHED = "time_over", "crashed"  # verdicts of parts without one


def read_lines(path: Path) -> list[dict]:
    """Lines of a file of results; a last line that was not finished is removed from the file.

    Parameters
    ----------
    path : Path
    """
    if not path.exists():
        return []
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        os.truncate(path, len(whole))
    return [json.loads(line) for line in whole.splitlines()]


def add_line(path: Path, entry: dict) -> None:
    """Append one line in one write, and wait until it is on the disk.

    Parameters
    ----------
    path : Path
    entry : dict
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    out = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        os.write(out, (json.dumps(entry, default=float) + "\n").encode())
        os.fsync(out)
    finally:
        os.close(out)


@dataclass
class _Running:
    """A process with the trial that it works on."""

    work: Work
    core: int | None
    process: multiprocessing.Process | None = None
    pipe: Connection | None = None
    task: Task | None = None
    rows: list[Row] = field(default_factory=list)
    partial: Row = field(default_factory=dict)
    since: float = 0.0

    def begin(self, task: Task, rows: list[Row]) -> None:
        if self.process is None or not self.process.is_alive():
            self.pipe, theirs = multiprocessing.Pipe()
            self.process = multiprocessing.Process(
                target=_serve, args=(self.work, theirs, self.pipe, self.core)
            )
            self.process.daemon = True
            self.process.start()
            theirs.close()
        self.task, self.rows, self.partial, self.since = task, rows, {}, time.monotonic()
        self.pipe.send((task, len(rows)))

    def go_on_without(self, verdict: str) -> None:
        """A new process for the rest of the trial, with a row for the part that did not come to its end."""
        self.end()
        if not self.partial:
            raise RuntimeError(f"{verdict}: the process of {self.task} had begun no part of it")
        row = self.partial | {"verdict": verdict, "wall_s": time.monotonic() - self.since}
        self.begin(self.task, [*self.rows, row])

    def end(self) -> None:
        if self.process is not None and self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process = None


def _serve(work: Work, pipe: Connection, of_parent: Connection, core: int | None) -> None:
    """Work on trials until the pipe is closed, also because the parent was killed."""
    of_parent.close()  # a copy of its end, which would keep the pipe open
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if core is not None:
        os.sched_setaffinity(0, {core})
    while True:
        try:
            task, n_done = pipe.recv()
        except EOFError:
            return
        for message in work(task, n_done):
            pipe.send(message)
        pipe.send(("end", {}))


def run(
    work: Work,
    tasks: Sequence[Task],
    path: Path,
    *,
    bound_s: float,
    n_processes: int,
    on_done: Callable[[Task, list[Row], float], None],
) -> None:
    """Work on the tasks that are not in the file of results.

    Parameters
    ----------
    work : callable
        Generator of messages of a task: ("begin", what is known) before a part, ("row", row) after it.
    tasks : sequence of tuple
    path : Path
        File of results.
    bound_s : float
        Longest time of one part [s].
    n_processes : int
        Each has a core of its own, if there are as many cores as processes.
    on_done : callable
        Called with each task done, its rows, and the time that the others will take [s].

    Raises
    ------
    KeyboardInterrupt
        After its processes have ended; the file has all trials that were done.
    RuntimeError
        A process ended before the first part of its trial, or between two.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ended as by Ctrl-C, with its processes
    done = {tuple(entry["task"]) for entry in read_lines(path)}
    left = [task for task in tasks if task not in done]
    waiting = list(reversed(left))
    began, n_done = time.monotonic(), 0
    processes = [_Running(work, core) for core in _cores(n_processes)]
    try:
        while waiting or any(one.task for one in processes):
            for one in processes:
                if one.task is None and waiting:
                    one.begin(waiting.pop(), [])
            for one in _finished(processes, bound_s):
                add_line(path, {"task": one.task, "rows": one.rows})
                n_done += 1
                remaining_s = (time.monotonic() - began) / n_done * (len(left) - n_done)
                on_done(one.task, one.rows, remaining_s)
                one.task = None
    finally:
        for one in processes:
            one.end()


def _cores(n: int) -> list[int | None]:
    usable = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    return usable if len(usable) == n else [None] * n


def _finished(processes: list[_Running], bound_s: float) -> Iterator[_Running]:
    """Read the messages of a moment; those processes whose trial is done."""
    busy = {one.pipe: one for one in processes if one.task is not None}
    ready = set(wait(list(busy), timeout=1.0))
    for pipe, one in busy.items():
        if pipe in ready:
            try:
                what, row = pipe.recv()
            except EOFError:
                one.go_on_without(CRASHED)
                continue
            if what == "begin":
                one.partial, one.since = row, time.monotonic()
            elif what == "row":
                one.rows.append(row)
                one.partial = {}
            else:
                yield one
        elif time.monotonic() - one.since > bound_s:
            one.go_on_without(OVER)
