"""The first draft of a round, and another linear stack where it leaves much."""

from __future__ import annotations

from gsid.base.deadline import OutOfTime
from gsid.base.errors import InputError
from gsid.diagnosis.from_records.canonical import resonant_stack
from gsid.diagnosis.from_records.draft import Draft, draft
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import UNKNOWN, Decision, by_first_stage
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import is_open, read_as


def draw_up(run: Run) -> None:
    """The first draft.

    Parameters
    ----------
    run : Run
    """
    with run.timed("first draft"):
        run.draft = _drafted(run, run.stack)
        _take(run)
        if _try_resonant_stack(run):
            _take(run)


def _take(run: Run) -> None:
    """The verdict of a draft, and the hold that it assumes."""
    if is_open(run.measured) and run.draft.stage.hold is not None:
        run.measured = read_as(run.measured, run.draft.stage.hold)
        run.judged = read_as(run.judged, run.draft.stage.hold)
    run.hold = run.draft.stage.hold
    run.decision = by_first_stage(run.draft.stage)


def give_up(run: Run) -> None:
    """The time was over before the first draft; one that exists stays, with its verdict.

    Parameters
    ----------
    run : Run
    """
    if run.draft is not None:
        run.cut = True
        run.not_tried["further steps"] = "the time was over"
        return
    what = "a linear structure was found" if run.stack is None else "the first draft"
    run.not_tried["laws of the catalogue"] = "the time was over before the first draft"
    run.decision = Decision(UNKNOWN, (), (f"The time was over before {what}.",))


def _drafted(run: Run, stack: PlantModel) -> Draft:
    """The first draft on a stack."""
    return draft(
        run.judged,
        stack,
        band=run.band,
        without=run.excluded,
        from_data=run.start is not None or run.is_further,
        along=run.measured if run.known else None,
        known=run.known_fits,
        settings=run.settings,
        on_step=run.on_step,
        deadline=run.deadline,
        linear_rounds=0 if run.given else run.settings.linear_rounds,
    )


def _try_resonant_stack(run: Run) -> bool:
    """The lowest mode as the sprung body, where the best law leaves much, and leaves less beside that.

    The linear cost cannot decide it: a law is missing from both.
    """
    left = run.draft.stage.ranking[0].cost_per_dof
    if run.start is None or run.draft.stage.conclusion.kind == "none" or left < run.settings.much_left:
        return False
    try:
        other = resonant_stack(run.start.model(), run.f_lo_hz, run.settings)
        if other is None:
            return False
        run.on_step("the same with the lowest mode as the sprung body")
        found = _drafted(run, other)
    except (InputError, OutOfTime):  # a stiffness beyond its bounds, or no time
        return False
    better = found.stage.ranking[0].cost_per_dof < run.settings.less_left * left
    if not better or found.stage.conclusion.kind != "named":
        return False
    run.stack, run.draft = other, found
    return True
