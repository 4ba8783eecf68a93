"""Fits under both assumptions about the hold of the input, for records that do not state it.

A command that is held over each sample is delayed by half a sample, its spectrum is multiplied by a sinc, and
it has images. A band-limited signal, without lines above half the sample rate, has none of these. Up to about
0.08 of the sample rate, an additional lag or high-frequency mode compensates the difference, and the data
cannot distinguish the two assumptions. Results that depend on the assumption are therefore fitted under both
(docs/explanation/decisions.md, "A record that does not state its hold").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from gsid.base.deadline import OutOfTime
from gsid.base.errors import GsidError

Fit = TypeVar("Fit")
READINGS = ("none", "zoh")  # the first is used if the data do not decide
ALIKE = 2.0  # of -2 log likelihood: a smaller difference does not decide
DECLARE = "state it in the records, `# hold: zoh` or `# hold: none`, or give --hold zoh|none"
MEANING = {"zoh": "held over each sample", "none": "not held between samples"}


def other_reading(hold: str) -> str:
    """Return the other assumption."""
    return READINGS[hold == READINGS[0]]


def likelier(deviance: Mapping[str, float]) -> str:
    """Assumption with the smallest -2 log likelihood; "none" if it is larger by at most `ALIKE`."""
    zoh_by = deviance.get("none", float("inf")) - deviance.get("zoh", float("inf"))
    return "zoh" if zoh_by > ALIKE else "none"


def fit_readings(under: Callable[[str], Fit]) -> dict[str, Fit]:
    """Fit under each assumption.

    Parameters
    ----------
    under : callable
        Maps an assumption to the fit under it.

    Returns
    -------
    dict of fits
        The successful fits by assumption, at least one.

    Raises
    ------
    ValueError, GsidError, OutOfTime
        Both fits failed; the error of the first is raised.
    """
    found: dict[str, Fit] = {}
    failures: list[Exception] = []
    for reading in READINGS:
        try:
            found[reading] = under(reading)
        # More zeros than a held input allows, no stable model, or no time.
        except (GsidError, ValueError, OutOfTime) as error:
            failures.append(error)
    if not found:
        raise failures[0]
    return found


def note_of_hold(hold: str, other_delay_s: float | None = None) -> str:
    """Note about the assumption: the delay under the other one, and how to state the hold."""
    taken, other = MEANING[hold], MEANING[other_reading(hold)]
    delay = "" if other_delay_s is None else f"; {other}, the delay would be {1e3 * other_delay_s:.5g} ms"
    return (
        f"the records do not state whether the input was held: assumed {taken}{delay}. To decide, {DECLARE}"
    )
