"""Process that runs each unit in a process of its own: a crash of one ends that process only.

`gsid.fleet.forks` starts it as `python -m gsid.fleet.fork_server FOLDER MODULE...`. It imports the modules
once and forks for each unit, since the imports take as long as many units. It has one thread: a fork of a
process with threads may leave locks locked. A request is one line of JSON on stdin: the job and its limits.
The result is written into the store of FOLDER before the answer, one line of JSON on stdout. If stdin is
closed, the process that asked has ended: the unit is ended too and has no result.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import json
import os
import resource
import select
import signal
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass, field
from typing import IO, Any, NoReturn

from gsid.fleet.store import Store
from gsid.fleet.unit import CHANGED, DONE, FAILED, Job, Limits, result_of, work_of

OUTPUT_MOST = 4000  # characters of the output of a failed unit that are kept, its last ones
STDIN, STDOUT = 0, 1


@dataclass
class _Ended:
    """How the process of a unit ended, and what it sent."""

    sent: dict[str, Any] = field(default_factory=dict)  # "answer", or "kind" and "text" of an exception
    is_over_time: bool = False
    status: int = 0
    peak_memory_mb: float = 0.0
    output: str = ""

    def failure(self) -> dict[str, Any] | None:
        """What went wrong; None if there is an answer."""
        if self.is_over_time:
            what = {"kind": "time", "text": "the limit of time is over"}
        elif os.WIFSIGNALED(self.status):
            what = {"kind": "signal", "text": signal.Signals(os.WTERMSIG(self.status)).name}
        elif "answer" in self.sent:
            return None
        elif self.sent:
            what = self.sent
        else:
            what = {"kind": "exit", "text": f"exit status {os.waitstatus_to_exitcode(self.status)}"}
        return what | {"output": self.output}


def main(folder: str, *modules: str) -> None:
    """Serve until stdin is closed."""
    for name in modules:
        importlib.import_module(name)
    store = Store(folder)
    with open(STDIN, "rb", buffering=0, closefd=False) as requests:
        while line := requests.readline():
            request = json.loads(line)
            result = run(Job(**request["job"]), Limits(**request["limits"]))
            if result["status"] != CHANGED:
                store.write(result)
            brief = {key: result.get(key) for key in ("key", "status", "seconds")}
            os.write(STDOUT, (json.dumps(brief) + "\n").encode())


def run(job: Job, limits: Limits) -> dict[str, Any]:
    """Run one unit in a process of its own; returns its result, of a failure too."""
    began = time.monotonic()
    ended = _in_a_process(job, limits)
    used = {"seconds": time.monotonic() - began, "peak_memory_mb": ended.peak_memory_mb}
    if job.is_changed():
        return result_of(job, CHANGED)
    failure = ended.failure()
    if failure is not None:
        return result_of(job, FAILED, failure=failure, **used)
    return result_of(job, DONE, answer=ended.sent["answer"], **used)


def _in_a_process(job: Job, limits: Limits) -> _Ended:
    with tempfile.TemporaryFile() as output:
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            _child(job, limits, writing, output)
        os.close(writing)
        sent, is_over_time = _receive(reading, child, limits.seconds)
        os.close(reading)
        _, status, usage = os.wait4(child, 0)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what it may have started
        output.seek(max(0, output.seek(0, os.SEEK_END) - OUTPUT_MOST))
        text = output.read().decode(errors="replace")
    per_mb = 2**20 if sys.platform == "darwin" else 2**10
    try:
        message = json.loads(sent) if sent else {}
    except ValueError:  # ended while it was sending
        message = {}
    return _Ended(message, is_over_time, status, usage.ru_maxrss / per_mb, text)


def _receive(reading: int, child: int, seconds: float | None) -> tuple[bytes, bool]:
    """Read what the child sends until it closes the pipe; also whether it was over the limit of time."""
    end = None if seconds is None else time.monotonic() + seconds
    parts = []
    while True:
        left = None if end is None else max(0.0, end - time.monotonic())
        ready, _, _ = select.select([reading, STDIN], [], [], left)
        if reading in ready:
            part = os.read(reading, 1 << 16)
            if not part:
                return b"".join(parts), False
            parts.append(part)
        elif STDIN in ready:  # nothing is sent while a unit runs: stdin is closed
            _kill(child)
            sys.exit(1)
        else:
            _kill(child)
            return b"", True


def _kill(child: int) -> None:
    """End the child and what it started; it may not have its own group yet."""
    for end in (os.killpg, os.kill):
        with contextlib.suppress(ProcessLookupError):
            end(child, signal.SIGKILL)


def _child(job: Job, limits: Limits, writing: int, output: IO[bytes]) -> NoReturn:
    """Run the unit, send its answer and end without the cleaning up that belongs to the parent."""
    status = 1
    try:
        os.setsid()
        nowhere = os.open(os.devnull, os.O_RDONLY)
        for source, target in ((nowhere, STDIN), (output.fileno(), 1), (output.fileno(), 2)):
            os.dup2(source, target)
        faulthandler.enable(file=2)
        if limits.memory_mb is not None:
            most = int(limits.memory_mb * 2**20)
            resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        _send(writing, _answer(job))
        status = 0
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
        os._exit(status)


def _answer(job: Job) -> bytes:
    try:
        return json.dumps({"answer": work_of(job.work)(job)}, allow_nan=False).encode()
    except MemoryError:
        failure = {"kind": "memory", "text": "the memory was not enough"}
    except BaseException as error:  # an exit too
        failure = {"kind": "exception", "text": f"{type(error).__name__}: {error}"}
        failure["traceback"] = traceback.format_exc()
    return json.dumps(failure).encode()


def _send(writing: int, message: bytes) -> None:
    while message:
        message = message[os.write(writing, message) :]


if __name__ == "__main__":
    main(*sys.argv[1:])
