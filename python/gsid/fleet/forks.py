"""Runs units through a fork server, which is started again if it ends."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from gsid.base.threads import N_THREADS
from gsid.fleet.store import Store
from gsid.fleet.unit import FAILED, Job, Limits, result_of

STARTS_MOST = 3  # of the server for one unit
ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", N_THREADS),
    "1",
)
"""Environment of the units: as many of them run as there are cores, with one thread each."""


@dataclass(frozen=True)
class Setup:
    """What all units of a fleet share.

    Attributes
    ----------
    folder : str
        Folder of the fleet.
    modules : tuple of str
        Imported once by each server.
    limits : Limits
    paths : tuple of str
        Folders from which modules are imported first, for works that are not installed.
    """

    folder: str
    modules: tuple[str, ...] = ()
    limits: Limits = field(default_factory=Limits)
    paths: tuple[str, ...] = ()


class Forks:
    """A fork server of this process, for one unit at a time.

    Parameters
    ----------
    setup : Setup
    """

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._process: subprocess.Popen | None = None

    def run(self, job: Job) -> dict[str, Any]:
        """Run a unit. Its result is in the store when this returns, unless its records were changed.

        It is not run again if there is a result: of a unit with the same content, or of a lost worker.

        Returns
        -------
        dict
            key, status and seconds of the result.
        """
        store = Store(self.setup.folder)
        known = store.read(job.key)
        if known is not None:
            return {"key": job.key, "status": known["status"], "seconds": None}
        for _ in range(STARTS_MOST):
            with contextlib.suppress(BrokenPipeError):
                if answer := self._ask(job):
                    return json.loads(answer)
            self.end()
        text = f"the process that runs the units ended {STARTS_MOST} times"
        result = result_of(job, FAILED, failure={"kind": "server", "text": text})
        store.write(result)
        return {"key": job.key, "status": FAILED, "seconds": None}

    def _ask(self, job: Job) -> bytes:
        if self._process is None:
            self._process = self._start()
        request = {"job": job.to_dict(), "limits": asdict(self.setup.limits)}
        self._process.stdin.write((json.dumps(request) + "\n").encode())
        self._process.stdin.flush()
        return self._process.stdout.readline()

    def _start(self) -> subprocess.Popen:
        environment = os.environ | ONE_THREAD
        paths = [*self.setup.paths, *filter(None, [environment.get("PYTHONPATH")])]
        if paths:
            environment["PYTHONPATH"] = os.pathsep.join(paths)
        words = [str(Path(self.setup.folder).absolute()), *self.setup.modules]
        return subprocess.Popen(
            [sys.executable, "-m", "gsid.fleet.fork_server", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            start_new_session=True,  # Ctrl-C is for the command
        )

    def end(self) -> None:
        """End the server, and the unit that it may be running."""
        process, self._process = self._process, None
        if process is not None:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
            process.wait()
            process.stdout.close()
