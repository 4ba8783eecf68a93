"""Was the input held between the samples? Both assumptions on a record that does not state it.

A command that is held over each sample is half a sample late, falls as a sinc and has images; a signal
without lines above half the sample rate has none of that. Up to about 0.08 of the sample rate a lag or a far
mode more makes up for the difference, so that data cannot tell the two apart there. What depends on the
assumption is therefore fitted under both (docs/explanation/decisions.md, "A record that does not state its
hold").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from gsid.base.errors import GsidError

Fit = TypeVar("Fit")
READINGS = ("none", "zoh")  # the first where the data tell no difference
ALIKE = 2.0  # -2 log likelihood: a smaller difference tells none
DECLARE = "state it in the records, `# hold: zoh` or `# hold: none`, or give --hold zoh|none"
MEANING = {"zoh": "held over each sample", "none": "not held between samples"}


def other_reading(hold: str) -> str:
    """The assumption that was not taken."""
    return READINGS[hold == READINGS[0]]


def likelier(deviance: Mapping[str, float]) -> str:
    """Assumption of least -2 log likelihood; "none" where it is worse by no more than `ALIKE`."""
    zoh_by = deviance.get("none", float("inf")) - deviance.get("zoh", float("inf"))
    return "zoh" if zoh_by > ALIKE else "none"


def fit_readings(under: Callable[[str], Fit]) -> dict[str, Fit]:
    """What can be fitted under each assumption.

    Parameters
    ----------
    under : callable
        From an assumption to the fit under it.

    Returns
    -------
    dict of fits
        By assumption, one at least.

    Raises
    ------
    ValueError, GsidError
        Of the first fit, where neither can be made.
    """
    found: dict[str, Fit] = {}
    failures: list[Exception] = []
    for reading in READINGS:
        try:
            found[reading] = under(reading)
        except (GsidError, ValueError) as error:  # more zeros than a held input allows, no stable model
            failures.append(error)
    if not found:
        raise failures[0]
    return found


def words(hold: str, other_delay_s: float | None = None) -> str:
    """Message on the assumption that was made: the delay under the other one, and how to settle it."""
    taken, other = MEANING[hold], MEANING[other_reading(hold)]
    delay = "" if other_delay_s is None else f"; {other}, the delay would be {1e3 * other_delay_s:.5g} ms"
    return (
        f"the records do not say whether the input was held: taken as {taken}{delay}. To settle it, {DECLARE}"
    )
