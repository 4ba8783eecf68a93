"""Models of a result, from the state of a diagnosis."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gsid.diagnosis.effect_starts import fixed_parameters
from gsid.diagnosis.from_records.law_part import linear_only, without
from gsid.diagnosis.from_records.mode_limits import with_limits_of
from gsid.diagnosis.from_records.short_list import started
from gsid.diagnosis.from_records.verdict import MISSING, Decision
from gsid.diagnosis.missing_torque.stage import HOLD, Ranked
from gsid.greybox.fit import PlantFit
from gsid.plant.model import PlantModel

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.run import Run


def as_given(run: Run, model: PlantModel | None) -> PlantModel | None:
    """A model of the result, without the limits that its modes had in the diagnosis.

    Parameters
    ----------
    run : Run
    model : PlantModel or None
    """
    return with_fixed(model) if run.given is None else with_fixed(with_limits_of(model, run.given))


def with_fixed(model: PlantModel | None) -> PlantModel | None:
    """A model whose parameters without a derivative are fixed: a search found them, no fit determines them.

    Parameters
    ----------
    model : PlantModel or None
    """
    if model is None:
        return None
    found, covariance = copy.deepcopy(model), model.covariance
    for effect in found.effects:
        for name in fixed_parameters(effect.type):
            effect.params[name].free, effect.params[name].std = False, None
    stays = [model.free_names.index(name) for name in found.free_names]
    if covariance is not None and len(stays) < len(model.free_names):
        found.cov, found.cov_names = covariance[np.ix_(stays, stays)], found.free_names
    return found


def fit_shown(run: Run, kept: Sequence[Run]) -> PlantFit:
    """Of the model with all effects found, else of the given one: what the hold was checked with.

    Parameters
    ----------
    run : Run
    kept : sequence of Run
        Of the effects found beside a given model.
    """
    if kept and kept[-1].final:
        return kept[-1].final.fit
    return run.shown.fit if not run.given else run.null.fit


def without_law(run: Run, kept: Sequence[Run], law_model: PlantModel | None) -> PlantModel | None:
    """The model of the laws without these laws.

    Parameters
    ----------
    run : Run
    kept : sequence of Run
        Of the effects that are named or nearest beside a given model.
    law_model : PlantModel or None
    """
    if law_model is None or run.given is None:
        return law_model and linear_only(law_model)
    effects = [one.final.effects[0] for one in kept if one.final] or run.decision.effects[:1]
    return without(law_model, effects)


def law_model_of(run: Run, decision: Decision) -> PlantModel | None:
    """The stack with the law that is named or nearest.

    Parameters
    ----------
    run : Run
    decision : Decision
    """
    if not decision.effects or run.draft is None:
        return None
    if run.final is not None:
        return run.final.model
    winner = run.draft.stage.ranking[0]
    return None if winner.effects[0] == HOLD else drafted_model(run, winner)


def model_of(run: Run, decision: Decision) -> PlantModel | None:
    """The stack with the law if it is named, else the linear one.

    Parameters
    ----------
    run, decision
        As `law_model_of`.
    """
    named = law_model_of(run, decision) if decision.verdict == MISSING else None
    return named or linear_of(run) or run.stack


def linear_of(run: Run) -> PlantModel | None:
    """The model without an effect that was found: as fitted by simulation, else as drafted.

    Parameters
    ----------
    run : Run
    """
    if run.null is not None:
        return run.null.model
    return run.simulations().completed(run.draft.model) if run.draft else None


def drafted_model(run: Run, one: Ranked) -> PlantModel:
    """The model with a law of the first stage, and with the laws of a given model.

    Parameters
    ----------
    run : Run
    one : Ranked
    """
    return run.simulations().completed(started(run.draft, one, run.pruned))
