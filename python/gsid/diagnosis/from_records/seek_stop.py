"""Stops that the axis runs into at its high level only.

A fit of the linear part to all records is then far from the truth, and so are all columns along it. The
records of the lower levels alone show the true linear part, beside which the edges are found (stop_edges.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from gsid.base.deadline import Deadline, OutOfTime
from gsid.diagnosis.from_records.canonical import canonical_stack
from gsid.diagnosis.from_records.confirm import judged
from gsid.diagnosis.from_records.other_structure import add_rival, least_left, take
from gsid.diagnosis.from_records.play_structures import is_same_structure, with_values_of
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.stop_edges import at_high_level, edges_along_motion, nearest_start
from gsid.diagnosis.from_records.verdict import NEAREST, UNKNOWN
from gsid.diagnosis.missing_torque.problem import Problem, linear_part
from gsid.effects.ids import BIAS, BODY, STOP
from gsid.effects.types import find
from gsid.greybox.fit import CANNOT_FIT, PlantFit, fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra
from gsid.structure.start import start

OF_BODY = ("gain", "damping", "spring")  # kinds of linear effects
STEPS = 25  # iterations of each fit
MISFIT = 1.3  # cost per degree of freedom from which on a law may be missing that the first stage cannot see


def seek_stop(run: Run) -> None:
    """Try stops where the lower levels alone leave only noise, and no law explains a clear misfit.

    A name needs a fit that leaves only noise: the linear structure is that of other records.

    Parameters
    ----------
    run : Run
    """
    if not _is_worth_it(run):
        return
    loud, quiet = at_high_level(run.measured)
    if not quiet:
        return
    with run.timed("simulation"):
        try:
            low = _linear_part_of(run, quiet)
            fitted = None if low is None else _fitted(run, low, loud, _own_work(run))
        except (*CANNOT_FIT, OutOfTime):
            return
        if fitted is None or fitted.cost_per_dof - 1 > run.settings.less_left * (least_left(run) - 1):
            return
        found = judged(fitted, (STOP,), run.settings)
        take(run, found, STOP)
        if run.evidence().is_adequate(found):
            add_rival(run, run.simulations(), low.model, found)


def _is_worth_it(run: Run) -> bool:
    """Whether the best law leaves a clear misfit, and a stop can be added."""
    if run.null is None or run.in_closed_loop or run.null.model.has_controller:
        return False
    effects = {effect.id for effect in run.null.model.effects}
    if {STOP, BIAS} & {*effects, *run.without} or BODY not in effects:
        return False
    if run.decision.verdict not in (UNKNOWN, NEAREST):
        return False
    return least_left(run) > MISFIT and not run.deadline.is_over


def _own_work(run: Run) -> Deadline:
    """The deadline with work of its own: the laws may have used up theirs."""
    return run.deadline.bounded(run.settings.moves_of_fit)


def _linear_part_of(run: Run, quiet: Sequence[Spectra]) -> PlantFit | None:
    """The linear part of some records, with a structure of their own unless one is given.

    Without a given one it is the simplest that leaves only noise: in the few lines of the quiet records one
    element may stand for another.
    """
    run.on_step("fitting the linear part to the records of the lower levels")
    if run.given is not None:
        return next(_adequate(run, _given_structures(run, quiet), quiet), None)
    own = _own_structure(run, quiet)
    structures = [run.stack] if own is None else [own, run.stack, _with_body_of(run.stack, own)]
    return min(_adequate(run, structures, quiet), key=lambda one: len(one.model.free_names), default=None)


def _with_body_of(stack: PlantModel, other: PlantModel) -> PlantModel:
    """A stack with the values of another one's body: a stop changes those that all records show.

    Lag, delay and modes are the same at all levels.
    """
    values = {name: stack[name].value for name in stack.free_names}
    labels = [label for label, effect in stack.labels() if find(effect.id).linear_part in OF_BODY]
    for name in set(stack.free_names) & set(other.free_names):
        if name.rpartition(".")[0] in labels:
            values[name] = other[name].value
    return stack.with_values(list(values.values()))


def _adequate(run: Run, structures: Iterable[PlantModel], quiet: Sequence[Spectra]) -> Iterator[PlantFit]:
    """Fits of the structures that leave only noise."""
    for structure in structures:
        try:
            begin = linear_start(structure, quiet)
            how = {"band": run.band, "max_iter": STEPS, "deadline": _own_work(run), "quiet": True}
            low = fit_plant(begin, quiet, **how)
        except (*CANNOT_FIT, OutOfTime):
            continue
        if low.cost_per_dof <= run.settings.adequate:
            yield low


def _given_structures(run: Run, quiet: Sequence[Spectra]) -> Iterator[PlantModel]:
    """Starts of the linear part of a given model: fitted values, given ones, and what the data show.

    The fit of a given model to all records may have left its values far behind.
    """
    yield run.null.model
    if run.known:
        return
    yield run.stack
    own = _own_structure(run, quiet)
    if own is not None and is_same_structure(run.stack, own):
        yield with_values_of(run.stack, own)


def _own_structure(run: Run, quiet: Sequence[Spectra]) -> PlantModel | None:
    """The canonical stack that some records show; None if they show none."""
    try:
        found = start(quiet, output=run.null.model.output, band=run.band, deadline=_own_work(run))
        return canonical_stack(found.model(), run.f_lo_hz, run.settings) if found.has_model else None
    except (*CANNOT_FIT, OutOfTime):
        return None


def _fitted(run: Run, low: PlantFit, loud: Sequence[Spectra], deadline: Deadline) -> PlantFit | None:
    """The fit with stops to one record of the high level, and from there to all records."""
    problem = Problem(low.model, list(loud), run.band, run.settings.search, deadline)
    edges = edges_along_motion(problem, linear_part(low.model))
    if edges is None:
        return None
    run.on_step(f"fitting {STOP} by simulation")
    with_stop = nearest_start(low.model, edges, loud, deadline)
    chosen = [one.spectra for one in low.records] + [loud[edges.record]]
    how = {"band": run.band, "max_iter": STEPS, "deadline": deadline, "quiet": True}
    one = fit_plant(with_stop, chosen, **how)
    return fit_plant(one.model, run.measured, **how)
