"""Play between motor and load from the records alone.

The search for the linear structure knows no play. It imitates the joint: by a mode with a large damping; by a
mode above the band; by the body, beside which the sprung axis is a low mode. Play is therefore tried beside
structures without these elements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.from_records.canonical import (
    BODY,
    LAGS,
    MODE,
    SPRING,
    beside_body,
    canonical_stack,
    with_mode_as_body,
)
from gsid.diagnosis.from_records.confirm import Simulated, Simulations
from gsid.diagnosis.from_records.other_structure import add_rival, least_left, take
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.verdict import NEAREST, UNKNOWN
from gsid.greybox.fit import fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.plant.effect import Effect
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel
from gsid.structure.start import start

OWN_MODE = 2.0  # times the resonance of a body: a mode of another structure below that is this body
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
    with run.timed("simulation"):
        fits = run.simulations()
        best = _best(run, fits, _structures(run, run.start.model()))
        if best is not None:
            found, structure = best
            take(run, found, BACKLASH)
            if run.evidence().is_adequate(found):
                add_rival(run, fits, structure, found)
    run.tried.add(BACKLASH)
    run.not_tried.update(fits.not_tried)


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
    except (GsidError, InputError, OutOfTime, np.linalg.LinAlgError):
        return
    if not found.has_model:
        return
    with run.timed("simulation"):
        fits = run.simulations()
        shown = _structures(run, found.model())
        tried = [with_values_of(run.stack, one) for one in shown if is_same_structure(run.stack, one)]
        best = _best(run, fits, tried)
        if best is not None:
            _fit_null_there(run, best[1])
            take(run, best[0], BACKLASH)
            if run.evidence().is_adequate(best[0]):
                add_rival(run, fits, best[1], best[0])
    run.not_tried.update(fits.not_tried)


def _fit_null_there(run: Run, structure: PlantModel) -> None:
    """The linear part alone from the values beside which play was fitted: play has to be better than that."""
    fits = replace(run.simulations(), deadline=run.deadline.bounded(run.settings.moves_of_fit))
    again = fits.fit(structure, ())
    if again is not None and again.cost < run.null.cost:
        run.null = again


def is_same_structure(one: PlantModel, other: PlantModel) -> bool:
    """Whether two models have the same elements.

    Parameters
    ----------
    one, other : PlantModel
    """
    return sorted(effect.id for effect in one.effects) == sorted(effect.id for effect in other.effects)


def with_values_of(given: PlantModel, other: PlantModel) -> PlantModel:
    """A model with the free values of another one of the same elements, modes in the order of frequency.

    Parameters
    ----------
    given, other : PlantModel
    """
    label_in_other = dict(zip(_ordered_labels(given), _ordered_labels(other), strict=True))
    values = []
    for name in given.free_names:
        label, _, parameter = name.rpartition(".")
        values.append(other[f"{label_in_other[label]}.{parameter}"].value)
    return given.with_values(values)


def _ordered_labels(model: PlantModel) -> list[str]:
    """Labels by the id of their effects, those of modes by frequency."""

    def place(pair: tuple[str, Effect]) -> tuple[str, float]:
        effect = pair[1]
        return effect.id, effect.params["f_hz"].value if effect.id == MODE else 0.0

    return [label for label, _ in sorted(model.labels(), key=place)]


def _structures(run: Run, found: PlantModel) -> list[PlantModel]:
    """`structures_for_play`; none where a mode that would become the body has no residue."""
    try:
        return structures_for_play(found, run.null.model, run.f_lo_hz, run.settings)
    except (InputError, ZeroDivisionError):
        return []


def _best(
    run: Run, fits: Simulations, structures: Sequence[PlantModel]
) -> tuple[Simulated, PlantModel] | None:
    """The first fit with play that leaves only noise, or else the one that leaves the least."""
    best, work = None, run.deadline.bounded(run.settings.moves_of_play)
    for structure in structures:
        found = None if run.deadline.is_over else _fitted(run, fits, structure, work)
        if found is None or (best is not None and found.cost >= best[0].cost):
            continue
        best = found, structure
        if run.evidence().is_adequate(found):
            break
    return best


def _is_worth_it(run: Run) -> bool:
    """Whether the best law leaves a clear misfit, and play can be added."""
    if run.null is None or run.in_closed_loop or BACKLASH in run.without:
        return False
    if run.decision.verdict not in (UNKNOWN, NEAREST) or run.deadline.is_over:
        return False
    return least_left(run) > run.settings.much_left


def structures_for_play(
    found: PlantModel, fitted: PlantModel, f_lo_hz: float, settings: DecisionSettings
) -> list[PlantModel]:
    """Canonical stacks without elements that may stand for a joint with play, the likelier first.

    Parameters
    ----------
    found : PlantModel
        Of `gsid.start`.
    fitted : PlantModel
        The canonical stack, fitted by simulation: its body is the sprung axis where that of `found` is not.
    f_lo_hz, settings
        As `canonical_stack`.

    Returns
    -------
    list of PlantModel
        Three at most, whose body is the element with the lowest resonance. The first is the fitted stack with
        the sharp modes of `found` beside its body; if there are none, with its own. In the others modes above
        the band are left out, and then the mode with the largest damping.
    """
    fitted, swapped = (_with_one_lag(_lowest_as_body(one)) for one in (fitted, found))
    sharp = _sharp_modes(swapped, settings)
    if SPRING not in found.stack():  # then its sprung body is one of its modes
        sharp = [mode for mode in sharp if mode.params["f_hz"].value > OWN_MODE * _resonance_hz(fitted)]
    first = _with_modes(fitted, _beside(sharp, swapped, fitted) or _sharp_modes(fitted, settings))
    modes = sorted(_free_modes(swapped), key=lambda mode: mode.params["zeta"].value)
    fewer = [modes[:-1]] if modes else []
    is_swapped = sum(e.id == MODE for e in swapped.effects) < sum(e.id == MODE for e in found.effects)
    kept = [modes, *fewer] if is_swapped or not modes else fewer
    tried = [first, *(_with_modes(swapped, some) for some in kept)]
    return [canonical_stack(one, f_lo_hz, settings, merged=False) for one in tried]


def _free_modes(model: PlantModel) -> list[Effect]:
    """Its modes that are not held fixed: those above the band are."""
    return [effect for effect in model.effects if effect.id == MODE and effect.params["f_hz"].free]


def _sharp_modes(model: PlantModel, settings: DecisionSettings) -> list[Effect]:
    return [one for one in _free_modes(model) if one.params["zeta"].value < settings.zeta_of_joint]


def _beside(modes: list[Effect], own: PlantModel, other: PlantModel) -> list[Effect]:
    """The modes of a model beside the body of another one: a residue is a share of the body's gain."""
    gain, of_other = (one.stack()[BODY]["gain"] for one in (own, other))
    return [beside_body(mode, of_other / gain) for mode in modes]


def _with_modes(model: PlantModel, modes: list[Effect]) -> PlantModel:
    return replace(model, effects=[*(e for e in model.effects if e.id != MODE), *modes])


def _lowest_as_body(model: PlantModel) -> PlantModel:
    """The model with the lowest mode as the sprung body, if it lies below the resonance of the body."""
    stack = model.stack()
    modes = [effect for effect in model.effects if effect.id == MODE]
    if SPRING not in stack or BODY not in stack or not modes:
        return model
    lowest = min(modes, key=lambda mode: mode.params["f_hz"].value)
    is_body = lowest.params["f_hz"].value < _resonance_hz(model)
    return with_mode_as_body(model, lowest) if is_body else model


def _resonance_hz(model: PlantModel) -> float:
    """Undamped resonance of the body with its spring [Hz]; 0 without a spring."""
    stiffness = model.stack().get(SPRING, {"stiffness": 0.0})["stiffness"]
    return math.sqrt(max(stiffness, 0.0)) / (2 * math.pi)


def _with_one_lag(model: PlantModel) -> PlantModel:
    """The model without its second lag, which may stand for the joint as well."""
    second = [effect for effect in model.effects if effect.id in LAGS][1:]
    return replace(
        model, effects=[effect for effect in model.effects if all(effect is not one for one in second)]
    )


def _fitted(run: Run, fits: Simulations, structure: PlantModel, work: Deadline) -> Simulated | None:
    """The fit with play beside a structure; None if it leaves more than half of what the best law leaves."""
    run.on_step("fitting a simpler linear structure by simulation")
    try:
        begin = linear_start(structure, run.measured)
        null = fit_plant(begin, run.measured, band=run.band, max_iter=NULL_STEPS, deadline=work)
    except (GsidError, InputError, OutOfTime, np.linalg.LinAlgError):
        return None
    most = run.settings.less_left * min(one.fit.cost for one in [run.null, *run.laws])
    found = fits.fit_play(null, structure, most, run.pruned, work)
    return found if found is not None and found.fit.cost < most else None
