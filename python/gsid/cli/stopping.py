"""Signals that end a run: the first starts a clean stop, later ones are ignored."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator

from gsid.cli.output import print_message

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK")  # those that the system has
# after this time another signal aborts a hanging stop, for example of a file system that does not answer
PATIENCE_S = 30.0


class Stopping:
    """Whether a signal has arrived: call it to find out.

    Attributes
    ----------
    number : int or None
        The first signal.
    """

    def __init__(self) -> None:
        self.number: int | None = None
        self._since_s = 0.0

    def __call__(self) -> bool:
        return self.number is not None

    @contextlib.contextmanager
    def caught(self) -> Iterator[Stopping]:
        """Catch the signals, except those that the process was started to ignore (nohup)."""
        numbers = [getattr(signal, name) for name in SIGNALS if hasattr(signal, name)]
        before = {number: signal.getsignal(number) for number in numbers}
        caught = [number for number in numbers if before[number] is not signal.SIG_IGN]
        for number in caught:
            signal.signal(number, self._handle)
        try:
            yield self
        finally:
            for number in caught:  # a late signal must not change how a stopped run ends
                signal.signal(number, signal.SIG_IGN if self() else before[number])

    def _handle(self, number: int, frame: object) -> None:
        now_s = time.monotonic()
        if self.number is None:
            self.number, self._since_s = number, now_s
        elif now_s > self._since_s + PATIENCE_S:
            raise KeyboardInterrupt

    def name(self) -> str:
        """Name of the signal that arrived."""
        return signal.Signals(self.number).name if self.number is not None else ""


def print_if_open(text: str) -> None:
    """Print a message if the terminal is still open: after SIGHUP it may be closed, and the run continues."""
    try:
        print_message(text)
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        with contextlib.suppress(OSError, ValueError):
            os.dup2(nowhere, sys.stderr.fileno())
        os.close(nowhere)
