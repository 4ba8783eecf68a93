"""A run that another program attends: figures for it as JSON lines, and a stop when it is gone."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import threading
import time
from collections.abc import Iterator
from typing import Any

from gsid.rig import ABSENT_S

STDIN, STDERR = 0, 2
PATIENCE_S = 1.0  # for the last figures, when the run has ended


class Attendance:
    """Whether the program that attends the run has gone: call it to find out.

    Each byte on standard input is a sign of life. The program has gone when the input is closed, or when no
    byte has arrived for `ABSENT_S`. A thread reads, so that the line to the axis never waits.

    Attributes
    ----------
    reason : str
        Why the run is stopped; empty while the program is there.
    """

    def __init__(self) -> None:
        self._sign_s = time.monotonic()
        self._is_closed = False
        self.reason = ""  # why the run is stopped
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while os.read(STDIN, 4096):
                self._sign_s = time.monotonic()
        self._is_closed = True

    def __call__(self) -> bool:
        if not self.reason and self._is_closed:
            self.reason = "the program that attended the run has ended"
        elif not self.reason and time.monotonic() > self._sign_s + ABSENT_S:
            self.reason = f"no sign of life for {ABSENT_S:g} s from the page that holds control"
        return bool(self.reason)


class LineWriter:
    """Write figures to stderr as JSON lines from a thread: what is not read in time is left out.

    A reader that hangs must never delay the commands to the axis.

    Attributes
    ----------
    waits : bool
        Whether to wait for the reader, `PATIENCE_S` at most: when the axis has stopped.
    """

    def __init__(self) -> None:
        self.waits = False
        self._lines: queue.Queue[bytes | None] = queue.Queue(maxsize=2)
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def send(self, values: dict[str, Any]) -> None:
        """Queue a line, unless earlier ones still wait."""
        with contextlib.suppress(queue.Full):
            line = json.dumps({"live": values}, allow_nan=False).encode() + b"\n"
            self._lines.put(line, block=self.waits, timeout=PATIENCE_S)

    def _write(self) -> None:
        with contextlib.suppress(OSError):
            while (line := self._lines.get()) is not None:
                while line:
                    line = line[os.write(STDERR, line) :]

    def close(self) -> None:
        """Write what waits, for `PATIENCE_S` at most: messages follow on stderr."""
        with contextlib.suppress(queue.Full):
            self._lines.put(None, timeout=PATIENCE_S)
            self._thread.join(PATIENCE_S)


def print_record(path: str, n_samples: int, good: int, spoiled: int) -> None:
    """Print the record that was written, as a JSON line on stderr.

    Parameters
    ----------
    path : str
    n_samples, good, spoiled : int
        Samples, and periods.
    """
    values = {"path": path, "samples": n_samples, "good": good, "spoiled": spoiled}
    with contextlib.suppress(OSError):  # the reader may have ended
        os.write(STDERR, json.dumps({"record": values}).encode() + b"\n")


@contextlib.contextmanager
def line_writer() -> Iterator[LineWriter]:
    """A writer that is closed at the end."""
    writer = LineWriter()
    try:
        yield writer
    finally:
        writer.close()
