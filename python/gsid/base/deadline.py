"""The time at which a calculation ends, whatever it has reached."""

from __future__ import annotations

import copy
import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager


class OutOfTime(Exception):
    """The time was over before there was a result."""


class Deadline:
    """A budget of time that begins now.

    As a context manager it also stops a running simulation, in C, when the time is over.

    Parameters
    ----------
    seconds : float
        Default: without end.

    Attributes
    ----------
    flag : bytearray
        An int of C that becomes 1 at the deadline.
    moves_left : float
        Work that simulations may still do, in moves of one column (`gsid_plant_cfg.moves_left` of the C
        library): a bound that is the same on every computer.
    """

    def __init__(self, seconds: float = math.inf) -> None:
        self._end = time.perf_counter() + seconds
        self.flag = bytearray(4)
        self.moves_left = math.inf
        self._timer: threading.Timer | None = None

    @property
    def left_s(self) -> float:
        """Time that is left [s]; 0 when it is over."""
        return 0.0 if self.flag[0] else max(self._end - time.perf_counter(), 0.0)

    @property
    def is_over(self) -> bool:
        """Whether the time is over."""
        return self.left_s == 0

    @property
    def is_used_up(self) -> bool:
        """Whether the time is over, or the work that simulations may do."""
        return self.is_over or self.moves_left == 0

    def bounded(self, moves: float) -> Deadline:
        """The same deadline, for simulations with a bound of their own on their work.

        Parameters
        ----------
        moves : float
            Its `moves_left`.
        """
        other = copy.copy(self)
        other.moves_left = moves
        return other

    @contextmanager
    def portion(self, moves: float) -> Iterator[Deadline]:
        """The same deadline with a bound on the work of a part, which is taken from `moves_left`.

        Parameters
        ----------
        moves : float
        """
        most = min(moves, self.moves_left)
        part = self.bounded(most)
        try:
            yield part
        finally:
            if math.isfinite(most):
                self.spend(most - part.moves_left)

    def spend(self, moves: float) -> None:
        """Take work from `moves_left`.

        Parameters
        ----------
        moves : float
        """
        self.moves_left = max(self.moves_left - moves, 0.0)

    def check(self) -> None:
        """Raise OutOfTime when the time is over."""
        if self.is_over:
            raise OutOfTime("the time is over")

    def stop(self) -> None:
        """End the time now."""
        self.flag[0] = 1

    def __enter__(self) -> Deadline:
        if self.left_s < threading.TIMEOUT_MAX:
            self._timer = threading.Timer(self.left_s, self.stop)
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._timer is not None:
            self._timer.cancel()
