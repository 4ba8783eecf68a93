"""Steps of a diagnosis, with their number and the time that is left."""

from __future__ import annotations

from collections.abc import Callable

from gsid.base.deadline import Deadline
from gsid.base.progress import ProgressText

BEFORE_FITS = 5  # records, linear structure, its fit, scan of the laws, joint fits
USUAL_FITS = 3  # by simulation: the linear part, the law, and one rival


class Steps:
    """Reports each step as "[3/8] scanning the laws, 52 s left".

    Parameters
    ----------
    on_step : callable
        Gets the text.
    deadline : Deadline

    Attributes
    ----------
    done, total : int
        Steps begun, and steps expected in all; more than expected make it grow.
    """

    def __init__(self, on_step: Callable[[str], None], deadline: Deadline) -> None:
        self._on_step, self._deadline = on_step, deadline
        self.done, self.total = 0, BEFORE_FITS + USUAL_FITS

    def __call__(self, text: str) -> None:
        """Report the next step.

        Parameters
        ----------
        text : str
        """
        self.done += 1
        self.total = max(self.total, self.done)
        left_s = self._deadline.left_s
        left = left_s if left_s < float("inf") else None
        self._on_step(ProgressText(text, f"{self.done}/{self.total}", left))

    def expect(self, more: int) -> None:
        """Set the number of steps that follow.

        Parameters
        ----------
        more : int
        """
        self.total = self.done + more
