"""Read foreign binary files in a separate process, with limits on memory and time.

One worker (`child.py`) serves all files of a command. If a file crashes the worker, the error names that
file, and the next file gets a new worker.
"""

from __future__ import annotations

import atexit
import json
import logging
import os
import signal
import struct
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

from gsid.base.errors import InputError, choose
from gsid.records.raw import DAMAGED, DAMAGED_HINT, KEYS, TIME_NAMES

_log = logging.getLogger(__name__)

MEMORY_BYTES = 10**9  # address space of the worker, including its start
MEMORY_PER_BYTE = 4  # additional address space for each byte of the file
SECONDS = 60.0  # time to read a file
BYTES_PER_SECOND = 20e6  # one additional second for each such number of bytes
MAX_HEADER = 2**24  # bytes: a longer header is not valid
_KEYS = (*KEYS, "meta")


def read_foreign(kind: str, path: Path, u: str, y: str) -> tuple[dict[str, Any], list[str]]:
    """Read the arrays and keys of a record out of a binary file, in the worker process.

    Parameters
    ----------
    kind : {"npz", "mat", "h5", "ulg"}
    path : Path
    u, y : str
        Names of the arrays. Times, `valid`, the keys of a record and other arrays as long as u are also read.

    Returns
    -------
    entries : dict of ndarrays and str
    names : list of str
        Names of the arrays in the file; a long list is cut.

    Raises
    ------
    InputError
        The file is damaged or refused, or its reader crashed, took too long or needed too much memory.
    """
    arrays = [u, y, *TIME_NAMES, "valid"]
    header, found = _ask(kind, path, arrays, [key for key in _KEYS if key not in (u, y)])
    return _contents(path, u, header, found)


def names_in(kind: str, path: Path) -> list[str]:
    """Names of the arrays in a binary file, which are not read; a long list is cut.

    Parameters
    ----------
    kind : {"npz", "mat", "h5"}
    path : Path

    Raises
    ------
    InputError
        As `read_foreign`.
    """
    header, found = _ask(kind, path, [], [])
    return _contents(path, "", header, found)[1]


def _ask(kind: str, path: Path, arrays: list[str], keys: list[str]) -> tuple[dict, list[np.ndarray]]:
    size = os.stat(path).st_size
    request = {
        "kind": kind,
        "path": os.path.abspath(path),
        "arrays": list(dict.fromkeys(arrays)),
        "keys": keys,
        "memory": MEMORY_BYTES + MEMORY_PER_BYTE * size,
        "seconds": SECONDS + size / BYTES_PER_SECOND,
    }
    with _lock:
        return _exchange(path, request)


def _contents(path: Path, u: str, header: dict, arrays: list) -> tuple[dict[str, Any], list[str]]:
    """Return the entries of an answer, or raise the error that it reports."""
    if "damaged" in header:
        raise InputError(DAMAGED, str(path), None, DAMAGED_HINT) from ValueError(header["damaged"])
    if "refused" in header:
        what, value, hint = header["refused"]
        raise InputError(what, str(path), value, hint)
    if "missing" in header:
        topic = u.partition(".")[0]
        raise InputError(f"no topic named {topic}", str(path), None, choose(topic, header["missing"]))
    if "import" in header:
        raise ImportError(header["import"])
    if header["notes"].strip():
        _log.warning("%s: %s", path.name, " ".join(header["notes"].split()))
    filled = iter(arrays)
    entries = {e["name"]: e["text"] if "text" in e else next(filled) for e in header["entries"]}
    return entries, header["names"]


# ---------------------------------------------------------------- the worker

_lock = threading.Lock()
_worker: subprocess.Popen | None = None


def _exchange(path: Path, request: dict) -> tuple[dict, list[np.ndarray]]:
    """Send a request and receive the header and the arrays. A worker that fails to answer is stopped."""
    worker = _running()
    timed_out = threading.Event()
    timer = threading.Timer(request["seconds"], lambda: (timed_out.set(), worker.kill()))
    timer.daemon = True
    timer.start()
    answered = False
    try:
        _write(worker.stdin, json.dumps(request).encode() + b"\n")
        header, arrays = _receive(worker.stdout, request["memory"])
        answered = True
    except (EOFError, OSError, ValueError, KeyError, TypeError) as error:
        _stop()
        raise _failure(path, worker.returncode, timed_out.is_set(), request) from error
    finally:
        timer.cancel()
        if not answered or timed_out.is_set():  # its remaining output would mix with the next answer
            _stop()
    if "memory" in header:
        _stop()  # the state of its memory is unknown
        raise _too_large(path, request)
    return header, arrays


def _write(stream: Any, data: bytes) -> None:
    view = memoryview(data)
    while len(view):
        view = view[stream.write(view) :]


def _receive(stream: Any, most: int) -> tuple[dict, list[np.ndarray]]:
    (length,) = struct.unpack("<Q", _exactly(stream, bytearray(8)))
    if length > MAX_HEADER:
        raise ValueError("length of the header")
    header = json.loads(_exactly(stream, bytearray(length)))
    arrays = []
    for entry in header.get("entries", []):
        if "text" in entry:
            continue
        dtype = np.dtype(entry["dtype"])
        n_bytes = dtype.itemsize * int(np.prod(entry["shape"], dtype=object))
        if dtype.kind not in "fiubcUS" or not 0 <= n_bytes <= most:
            raise ValueError("type or size of an array")
        array = np.empty(entry["shape"], dtype)
        if n_bytes:
            _exactly(stream, memoryview(array.reshape(-1).view("u1")))
        arrays.append(array)
    return header, arrays


def _exactly(stream: Any, into: Any) -> Any:
    view = memoryview(into)
    while len(view):
        n = stream.readinto(view)
        if not n:
            raise EOFError
        view = view[n:]
    return into


def _failure(path: Path, code: int | None, timed_out: bool, request: dict) -> InputError:
    if timed_out:
        what, value = "reading the file takes too long", f"stopped after {request['seconds']:.0f} s"
    elif code is not None and code < 0:
        what, value = "the file crashed its reader", _signal_name(-code)
    else:
        what, value = "the reader of the file ended without an answer", f"exit code {code}"
    return InputError(what, str(path), value, f"it is damaged: {DAMAGED_HINT}, or export the record as CSV")


def _too_large(path: Path, request: dict) -> InputError:
    most = f"more than {request['memory'] / 1e9:.2g} GB of memory needed"
    hint = "write the file again, or export a shorter record"
    return InputError("the file is too large to be read, or damaged", str(path), most, hint)


def _signal_name(number: int) -> str:
    try:
        return f"signal {signal.Signals(number).name}"
    except ValueError:
        return f"signal {number}"


def _running() -> subprocess.Popen:
    global _worker
    if _worker is None or _worker.poll() is not None:
        _stop()
        _worker = subprocess.Popen(
            # -P: the csv.py of this folder must not hide the standard library's
            [sys.executable, "-P", str(Path(__file__).with_name("child.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,  # a fork may leave the locks of buffered pipes locked
            # one BLAS thread saves address space; a separate process group ignores Ctrl-C of the terminal
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            process_group=0 if os.name == "posix" else None,
        )
    return _worker


def _stop() -> None:
    global _worker
    worker, _worker = _worker, None
    if worker is not None:
        worker.kill()
        worker.wait()
        _close(worker)


def _close(worker: subprocess.Popen) -> None:
    worker.stdin.close()
    worker.stdout.close()


def _forget_after_fork() -> None:
    """Drop the worker, which belongs to the parent process, and the lock, which a lost thread may hold."""
    global _worker, _lock
    worker, _worker, _lock = _worker, None, threading.Lock()
    if worker is not None:
        _close(worker)
        worker.returncode = 0  # the parent process waits for its exit


atexit.register(_stop)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_after_fork)
