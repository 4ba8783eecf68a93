"""A nearest law, from the records alone, that leaves more than noise and explains too little: unknown."""

from __future__ import annotations

from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import NEAREST, UNKNOWN, Decision


def doubt_nearest(run: Run) -> None:
    """Give up the nearest law of records alone if its share is too small for one that leaves more than noise.

    Beside a given model such a law may be one of several that are missing, and the search goes on beside it.

    Parameters
    ----------
    run : Run
        With its verdict.
    """
    left, settings = run.decision.unexplained_share, run.settings
    if run.decision.verdict != NEAREST or run.final is None or left is None:
        return
    if run.evidence().is_adequate(run.final) or 1 - left >= settings.nearest_error_share:
        return
    law, needed = " or ".join(run.decision.effects), f"{100 * settings.nearest_error_share:.0f} %"
    reason = f"More than noise is left, and {law} explains less than {needed} on held-out data."
    run.decision = Decision(UNKNOWN, (), (*run.decision.reasons, reason), left)
