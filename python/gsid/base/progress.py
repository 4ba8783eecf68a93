"""The text of a step of a long computation, with its parts."""

from __future__ import annotations


class ProgressText(str):
    """Text of a step: "[3/8] scanning the laws, 52 s left". A program that shows its parts apart takes these.

    Parameters
    ----------
    words : str
        What is done.
    part : str
        Number of the step and of all, as in "3/8"; empty if the number of all is not known.
    seconds_left : float or None
        Time until the end, or until the limit of the time [s]; None if it is not known.
    """

    __slots__ = ("part", "seconds_left", "words")
    words: str
    part: str
    seconds_left: float | None

    def __new__(cls, words: str, part: str = "", seconds_left: float | None = None) -> ProgressText:
        left = "" if seconds_left is None else f", {seconds_left:.0f} s left"
        text = super().__new__(cls, f"[{part}] {words}{left}" if part else f"{words}{left}")
        text.words, text.part, text.seconds_left = words, part, seconds_left
        return text
