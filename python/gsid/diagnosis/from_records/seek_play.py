"""Play between motor and load from the records alone.

The search for the linear structure knows no play. It imitates the joint: by a mode with a large damping; by a
mode above the band; by the body, beside which the sprung axis is a low mode. Play is therefore tried beside
structures without these elements.
"""

from __future__ import annotations

import math
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

NULL_STEPS = 3  # iterations of the fit of a linear structure, which begins at its response


def seek_play(run: Run) -> None:
    """Try play beside simpler linear structures, where no law explains a clear misfit.

    A name needs a fit that leaves only noise: a structure with fewer elements is one more hypothesis.

    Parameters
    ----------
    run : Run
    """
    if not _is_worth_it(run):
        return
    with run.timed("simulation"):
        fits = run.simulations()
        best = _best(run, fits)
        if best is not None:
            found, structure = best
            take(run, found, BACKLASH)
            if run.evidence().is_adequate(found):
                add_rival(run, fits, structure, found)
    run.tried.add(BACKLASH)
    run.not_tried.update(fits.not_tried)


def _best(run: Run, fits: Simulations) -> tuple[Simulated, PlantModel] | None:
    """The first fit with play that leaves only noise, or else the one that leaves the least."""
    best, work = None, run.deadline.bounded(run.settings.moves_of_play)
    for structure in structures_for_play(run.start.model(), run.null.model, run.f_lo_hz, run.settings):
        found = None if run.deadline.is_over else _fitted(run, fits, structure, work)
        if found is None or (best is not None and found.cost >= best[0].cost):
            continue
        best = found, structure
        if run.evidence().is_adequate(found):
            break
    return best


def _is_worth_it(run: Run) -> bool:
    """Whether the best law leaves a clear misfit, and play can be added."""
    if run.start is None or run.null is None or run.in_closed_loop or BACKLASH in run.without:
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
        its sharp modes alone; if the fit left none sharp, with those of `found`. In the others modes above
        the band are left out, and then the mode with the largest damping.
    """
    fitted, swapped = (_with_one_lag(_lowest_as_body(one)) for one in (fitted, found))
    sharp = _sharp_modes(swapped, settings)
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
    own_hz = math.sqrt(max(stack[SPRING]["stiffness"], 0.0)) / (2 * math.pi)
    return with_mode_as_body(model, lowest) if lowest.params["f_hz"].value < own_hz else model


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
        start = linear_start(structure, run.measured)
        null = fit_plant(start, run.measured, band=run.band, max_iter=NULL_STEPS, deadline=work)
    except (GsidError, InputError, OutOfTime, np.linalg.LinAlgError):
        return None
    most = run.settings.less_left * min(one.fit.cost for one in [run.null, *run.laws])
    found = fits.fit_play(null, structure, most, run.pruned, work)
    return found if found is not None and found.fit.cost < most else None
