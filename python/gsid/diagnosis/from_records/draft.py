"""First stage, repeated until its best law is not a linear effect: linear structure before any law."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.hold import READINGS
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.catalogue import LINEAR_KINDS
from gsid.diagnosis.missing_torque.linear_fit import KnownFits, fit_null
from gsid.diagnosis.missing_torque.problem import Problem, linear_part
from gsid.diagnosis.missing_torque.stage import HOLD, FirstStage, first_stage, in_time
from gsid.effects.types import find
from gsid.greybox.fit import CANNOT_FIT
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra, is_open, read_as
from gsid.structure.start import start

LINEAR_PARTS = LINEAR_KINDS | {"hold"}


@dataclass(frozen=True, eq=False)
class Draft:
    """First draft of the diagnosis.

    Attributes
    ----------
    model : PlantModel
        Linear stack, with the values of its fit.
    stage : FirstStage
        Of this stack.
    added : list of tuple of str
        Linear effects that were added to the stack, in this order; several where the data do not distinguish
        them.
    """

    model: PlantModel
    stage: FirstStage
    added: list[tuple[str, ...]]


def draft(
    measured: list[Spectra],
    model: PlantModel,
    *,
    band: tuple[float, float] | None,
    without: Collection[str] = (),
    from_data: bool = False,
    along: list[Spectra] | None = None,
    known: KnownFits | None = None,
    settings: DecisionSettings,
    on_step: Callable[[str], None],
    deadline: Deadline,
    linear_rounds: int,
) -> Draft:
    """Rank the laws on a stack to which missing linear effects are added first.

    Parameters
    ----------
    measured : list of Spectra
    model : PlantModel
        Linear.
    band, without, along, known, on_step
        As `first_stage`.
    from_data : bool
        Whether the values of the model were found from these records. If not, and the first stage leaves more
        than noise, the linear structure is found from the records, and fits begin from its values as well.
    settings : DecisionSettings
    deadline : Deadline
        Time at which no further linear effect is added.
    linear_rounds : int
        Largest number of linear effects that are added.
    """
    added: list[tuple[str, ...]] = []
    how: dict[str, Any] = {"band": band, "without": without, "on_step": on_step, "deadline": deadline}
    how |= {"along": along, "known": {} if known is None else known, "settings": settings.search}
    stage = first_stage(measured, model, **how)
    by_effects = not model.has_controller and not any(e.type.linear_part == "dynamics" for e in model.effects)
    if not from_data and by_effects and _is_doubtful(stage, model, settings) and not deadline.is_over:
        how["values"] = _values_from_data(measured, model, band, on_step, deadline)
    if how.get("values") is not None:
        with in_time():
            stage = first_stage(measured, model, **how)
    if is_open(measured) and stage.hold is not None:
        measured = read_as(measured, stage.hold)
    while len(added) < linear_rounds and _adds_linear(stage, settings):
        best = stage.ranking[0]
        on_step(f"adding {best.effects[0]} to the linear part")
        named = stage.conclusion.effects
        larger = with_stack(model, best.linear)
        try:
            stage = first_stage(measured, larger, **how)
        except OutOfTime:
            break
        added.append(named if best.effects[0] in named else best.effects)
        model = larger
    labels = dict(model.labels())
    own = {label: params for label, params in stage.linear.items() if label in labels}
    return Draft(with_stack(model, own), stage, added)


def _is_doubtful(stage: FirstStage, model: PlantModel, settings: DecisionSettings) -> bool:
    """Whether the linear part may be in a wrong minimum: more than noise is left, or was left without a mode.

    Beside a linear part in a wrong minimum a law of the angle may explain most, but it leaves much. A mode
    may take the place of one that has moved to where another linear effect is missing; so may each linear
    effect beside values far from the given ones, and a mode that is damped like a body. Where no law is
    named, values far from the given ones may themselves hide a missing linear effect.
    """
    best = stage.ranking[0]
    if stage.conclusion.kind == "none":
        return False
    is_mode = find(best.effects[0]).linear_part == "mode"
    if is_mode and (stage.cost_per_dof > settings.much_left or best.params["zeta"] >= settings.zeta_of_mode):
        return True
    is_law = stage.conclusion.kind == "named" and not is_linear(best.effects[0])
    may_have_strayed = [] if is_law else [stage.linear]
    may_have_strayed += [best.linear] if is_linear(best.effects[0]) else []
    if any(_has_strayed(linear, model, settings.strayed) for linear in may_have_strayed):
        return True
    return best.cost_per_dof > (settings.much_left if is_law else settings.adequate)


def _has_strayed(stack: dict[str, dict[str, float]], model: PlantModel, most: float) -> bool:
    """Whether a fit is more than a factor away from a given value of the model, or has another sign."""
    given = [(label, name, param.value) for label, e in model.labels() for name, param in e.params.items()]
    ratios = [stack[label][name] / value for label, name, value in given if value and label in stack]
    return any(not 1 / most < ratio < most for ratio in ratios)


def _values_from_data(
    measured: list[Spectra],
    model: PlantModel,
    band: tuple[float, float] | None,
    on_step: Callable[[str], None],
    deadline: Deadline,
) -> dict[str, dict[str, float]] | None:
    """Values of the linear stack that the data show; None where there is none."""
    on_step("finding the linear structure")
    try:
        found = start(measured, output=model.output, band=band, deadline=deadline)
    except (*CANNOT_FIT, OutOfTime):
        return None
    return found.effects if found.has_model else None


def null_cost(
    measured: list[Spectra],
    model: PlantModel,
    band: tuple[float, float] | None,
    deadline: Deadline,
    known: KnownFits,
    settings: DecisionSettings,
) -> float:
    """Cost per degree of freedom of a linear stack alone, under the likelier hold.

    Parameters
    ----------
    measured : list of Spectra
    model : PlantModel
    band : (lo, hi) or None
        Hz.
    deadline : Deadline
    known : dict
        Fits that were made before with these records and this band; in place.
    settings : DecisionSettings
    """
    readings = READINGS if is_open(measured) else READINGS[:1]
    how = band, settings.search, deadline
    problems = [Problem(model, read_as(measured, reading), *how) for reading in readings]
    return min(fit_null(problem, linear_part(model), known=known).cost_per_dof for problem in problems)


def _adds_linear(stage: FirstStage, settings: DecisionSettings) -> bool:
    """Whether the best of the ranking is a linear effect that explains enough."""
    best = stage.ranking[0]
    if stage.conclusion.kind == "none" or not is_linear(best.effects[0]):
        return False
    return best.effects[0] == HOLD or best.share_kept_out >= settings.linear_fall


def is_linear(effect: str) -> bool:
    """Whether an effect is a part of the linear structure.

    Parameters
    ----------
    effect : str
    """
    return find(effect).linear_part in LINEAR_PARTS


def with_stack(model: PlantModel, stack: dict[str, dict[str, float]]) -> PlantModel:
    """A model with other effects and values.

    Parameters
    ----------
    model : PlantModel
    stack : dict of dict of float
        {effect: {parameter: value}}. Parameters that the model holds fixed stay fixed; the rate of a held
        sensor, which comes from its images, is fixed as well.
    """
    given = dict(model.labels())

    def param(label: str, name: str, value: float) -> Param:
        known = given[label].params[name] if label in given else None
        is_free = known.free if known else label != HOLD  # a fit would move the rate off its images
        return Param(value, is_free, limits=known.limits if known else None)

    effects = [
        Effect(label.partition("#")[0], {name: param(label, name, v) for name, v in params.items()})
        for label, params in stack.items()
    ]
    return replace(model, effects=effects, cov=None, cov_names=None, fit=None)
