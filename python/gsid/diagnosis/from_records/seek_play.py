"""Play between motor and load from the records alone.

The search for the linear structure knows no play. It imitates the joint: by a mode with a large damping; by a
mode above the band; by the body, beside which the sprung axis is a low mode. Play is therefore tried beside
structures without these elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import InputError
from gsid.diagnosis.from_records.confirm import Simulated, Simulations
from gsid.diagnosis.from_records.other_structure import add_rival, least_left, take
from gsid.diagnosis.from_records.play_structures import (
    is_same_structure,
    structures_for_play,
    with_values_of,
)
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import NEAREST, UNKNOWN
from gsid.greybox.fit import CANNOT_FIT, PlantFit, fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel
from gsid.structure.start import start

NULL_STEPS = 3  # iterations of the fit of a linear structure, which begins at its response


def seek_play(run: Run) -> None:
    """Try play beside simpler linear structures, where no law explains a clear misfit.

    A name needs a fit that leaves only noise: a structure with fewer elements is one more hypothesis.

    Parameters
    ----------
    run : Run
    """
    if run.start is None or not _is_worth_it(run):
        return
    _try(run, _structures(run, run.start.model()))
    run.tried.add(BACKLASH)


def seek_play_from_data(run: Run) -> None:
    """Try play beside a given linear model from values that the data show.

    Without play, a fit from values that are far off loses a mode, or takes it for the joint. The model alone
    is fitted from there as well.

    Parameters
    ----------
    run : Run
    """
    if run.given is None or run.known or not _is_worth_it(run):
        return
    try:
        found = start(run.measured, output=run.given.output, band=run.band, deadline=run.deadline)
    except (*CANNOT_FIT, OutOfTime):
        return
    if not found.has_model:
        return
    shown = _structures(run, found.model())
    _try(run, [with_values_of(run.stack, one) for one in shown if is_same_structure(run.stack, one)])


def _try(run: Run, structures: Sequence[PlantModel]) -> None:
    """Decide with the best fit of play beside some structures, and with its rival there."""
    with run.timed("simulation"):
        fits = run.simulations()
        best = _best(run, fits, structures)
        if best is not None:
            found, structure = best
            if run.given is not None:
                _fit_null_there(run, structure)
            take(run, found, BACKLASH)
            if run.evidence().is_adequate(found):
                add_rival(run, fits, structure, found)
    run.not_tried.update(fits.not_tried)


def _fit_null_there(run: Run, structure: PlantModel) -> None:
    """The linear part alone from the values beside which play was fitted: play has to be better than that."""
    fits = replace(run.simulations(), deadline=run.deadline.bounded(run.settings.moves_of_fit))
    again = fits.fit(structure, ())
    if again is not None and again.cost < run.null.cost:
        run.null = again


def _structures(run: Run, found: PlantModel) -> list[PlantModel]:
    """`structures_for_play`; none where a value would be beyond its bounds."""
    try:
        return structures_for_play(found, run.null.model, run.f_lo_hz, run.settings)
    except InputError:
        return []


def _best(
    run: Run, fits: Simulations, structures: Sequence[PlantModel]
) -> tuple[Simulated, PlantModel] | None:
    """The first fit with play that leaves only noise, or else the one that leaves the least."""
    best, work = None, run.deadline.bounded(run.settings.moves_of_play)
    for structure, null in _in_order(run, structures, work):
        found = None if run.deadline.is_over else _fitted(run, fits, structure, null, work)
        if found is None or (best is not None and found.cost >= best[0].cost):
            continue
        if run.given is None and not run.evidence().is_adequate(found):
            found, structure = _with_hidden_mode(run, fits, found, structure)
        best = found, structure
        if run.evidence().is_adequate(found):
            break
    return best


def _with_hidden_mode(
    run: Run, fits: Simulations, found: Simulated, structure: PlantModel
) -> tuple[Simulated, PlantModel]:
    """The fit with the mode that explains most of what it leaves, if that is better, and its structure.

    It has work of its own: the fit without the mode may have used up that of all structures.
    """
    work = run.deadline.bounded(run.settings.moves_of_play)
    more = fits.fit_hidden_mode(found, run.null.fit.cost, work)
    if more is None or more.fit.cost >= found.fit.cost:
        return found, structure
    return more, more.model.without_effect(BACKLASH)


def _in_order(
    run: Run, structures: Sequence[PlantModel], work: Deadline
) -> list[tuple[PlantModel, PlantFit]]:
    """Structures with the fits of their linear parts; those that fit far worse than another one come last."""
    run.on_step("fitting simpler linear structures by simulation")
    fitted = [(one, null) for one in structures if (null := _null_of(run, one, work)) is not None]
    least = min((null.cost for _, null in fitted), default=0.0)
    return sorted(fitted, key=lambda pair: pair[1].cost > run.settings.far_structure * least)


def _null_of(run: Run, structure: PlantModel, work: Deadline) -> PlantFit | None:
    """The fit of a structure without play, begun at its response; None if it cannot be simulated."""
    try:
        begin = linear_start(structure, run.measured)
        how = {"band": run.band, "max_iter": NULL_STEPS, "deadline": work, "quiet": True}
        return fit_plant(begin, run.measured, **how)
    except (*CANNOT_FIT, OutOfTime):
        return None


def _is_worth_it(run: Run) -> bool:
    """Whether the best law leaves a clear misfit, and play can be added."""
    if run.null is None or run.in_closed_loop or BACKLASH in run.without:
        return False
    if run.decision.verdict not in (UNKNOWN, NEAREST) or run.deadline.is_over:
        return False
    return least_left(run) > run.settings.much_left


def _fitted(
    run: Run, fits: Simulations, structure: PlantModel, null: PlantFit, work: Deadline
) -> Simulated | None:
    """The fit with play beside a structure; None if it leaves more than half of what the best law leaves."""
    most = run.settings.less_left * min(one.fit.cost for one in [run.null, *run.laws])
    found = fits.fit_play(null, structure, most, run.pruned, work)
    return found if found is not None and found.fit.cost < most else None
