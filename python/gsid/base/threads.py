"""Independent jobs on the usable cores, and the threads of matrix algebra."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

Job = TypeVar("Job")
Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")


N_THREADS = "GSID_THREADS"  # environment variable: most threads, where processes share the cores


def n_cores() -> int:
    """Usable cores, at least one."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return max(1, usable or 1)


def n_threads(n_jobs: int) -> int:
    """Threads for some jobs: at most one for each usable core, at least one.

    Parameters
    ----------
    n_jobs : int
    """
    given = os.environ.get(N_THREADS, "")
    most = int(given) if given.isdecimal() else n_cores()
    return max(1, min(most, n_jobs))


def in_parallel(
    function: Callable[[Job], Result], jobs: Sequence[Job], size: Callable[[Job], float] | None = None
) -> list[Result]:
    """Results of a function for each job, in the order of the jobs.

    The jobs have to spend most of their time in C code that releases the interpreter's lock, and must not
    change what another one reads. If some raise, the first one's exception is raised.

    Parameters
    ----------
    function : callable
    jobs : sequence
    size : callable, optional
        How long a job takes beside the others: the longest start first, so that none is left over at the end.
    """
    n = n_threads(len(jobs))
    if n == 1:
        return [function(job) for job in jobs]
    started = range(len(jobs)) if size is None else sorted(range(len(jobs)), key=lambda i: -size(jobs[i]))
    with ThreadPoolExecutor(n) as pool:
        running = {i: pool.submit(function, jobs[i]) for i in started}
        try:
            return [running[i].result() for i in range(len(jobs))]
        finally:  # after an exception: those that wait do not start
            for one in running.values():
                one.cancel()


def with_one_thread_for_algebra(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Keep the algebra libraries of NumPy and SciPy to one thread while a function runs.

    The matrices of a fit are small: threads that wait for each other cost more than they calculate, and twice
    as much on busy cores.

    Parameters
    ----------
    function : callable
    """

    @functools.wraps(function)
    def limited(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with _algebra().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@functools.cache
def _algebra() -> ThreadpoolController:
    """The libraries that are loaded: NumPy and SciPy are imported before a fit."""
    return ThreadpoolController()
