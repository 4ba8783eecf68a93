"""The ranking of a result: fits by simulation first, then those of the first stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from gsid.diagnosis.from_records.basis import Basis
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.evidence import Evidence
from gsid.diagnosis.from_records.fingerprints import LAWS
from gsid.diagnosis.from_records.law_part import label_of
from gsid.diagnosis.from_records.probability import Probabilities
from gsid.diagnosis.from_records.result import RankedLaw
from gsid.diagnosis.from_records.shown_models import drafted_model
from gsid.diagnosis.from_records.verdict import ADEQUATE, UNKNOWN
from gsid.diagnosis.missing_torque.stage import HOLD, Ranked
from gsid.plant.model import PlantModel

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.run import Run

NAN = float("nan")


def with_probabilities(
    ranking: list[RankedLaw], basis: Basis | None, known: Probabilities | None
) -> list[RankedLaw]:
    """Members of the first group share its probability evenly, the other laws theirs: they sum to 1.

    Parameters
    ----------
    ranking : list of RankedLaw
    basis : Basis or None
    known : Probabilities or None
        None: the laws have no probability.
    """
    if basis is None or known is None:
        return ranking
    first = [one for one in ranking if one.effects and one.effects[0] in basis.effects]
    others = [one for one in ranking if one.effects and one not in first]
    none = known.none if others else 1 - known.best

    def probability(one: RankedLaw) -> float:
        if not one.effects:
            return none
        return known.best / len(first) if one in first else known.other / len(others)

    return [replace(one, probability=probability(one)) for one in ranking]


def ranking_of(run: Run) -> list[RankedLaw]:
    """All laws in order; without shares if nothing is missing, since the excess over noise is zero then.

    Parameters
    ----------
    run : Run
    """
    ranking = _all_laws(run)
    if run.decision.verdict != ADEQUATE:
        return ranking
    return [replace(one, share_kept_out=NAN) for one in ranking]


def _all_laws(run: Run) -> list[RankedLaw]:
    """Fits by simulation first, then those of the first stage; "none of the catalogue" where it belongs."""
    if run.draft is None:
        return []
    evidence = run.evidence() if run.laws else None
    weighed = evidence.weighed() if evidence else None
    simulated = [_simulated(one, weighed) for one in weighed.laws] if weighed else []
    known = {one.effects for one in simulated}
    drafted = [_drafted(one) for one in run.draft.stage.ranking if one.effects not in known]
    null = run.null.fit.cost_per_dof if run.null else run.draft.stage.cost_per_dof
    by = "simulation" if run.null else "first stage"
    none = RankedLaw((), {}, null, 0.0, NAN, NAN, run.null is not None, by)
    if run.decision.verdict in (ADEQUATE, UNKNOWN):
        return [none, *sorted(simulated, key=_cost), *drafted]
    first = [one for one in simulated if one.effects[0] == run.decision.effects[0]]
    rest = sorted((one for one in simulated if one not in first), key=_cost)
    if not first:
        return [*drafted, none]
    return [*first, *rest, none, *drafted]


def law_models_of(run: Run, ranking: Sequence[RankedLaw]) -> dict[str, PlantModel]:
    """The stacks with the first laws of the ranking: as fitted by simulation, else as drafted.

    Parameters
    ----------
    run : Run
    ranking : sequence of RankedLaw
    """
    simulated = {one.effects: one.model for one in run.laws}
    drafted = {one.effects: one for one in run.draft.stage.ranking} if run.draft else {}
    models = {}
    for effects in [one.effects for one in ranking if one.effects][:LAWS]:
        if effects in simulated:
            models[effects[0]] = simulated[effects]
        elif effects in drafted and drafted[effects].linear and effects[0] != HOLD:
            models[effects[0]] = drafted_model(run, drafted[effects])
    return models


def _cost(one: RankedLaw) -> float:
    return one.cost_per_dof_after


def _simulated(one: Simulated, evidence: Evidence) -> RankedLaw:
    stack = one.model.stack()
    label = label_of(one.model, one.effects[0])
    numbers = (one.fit.cost_per_dof, evidence.share(one), evidence.margin(one), one.scatter)
    confirmed = one.converged or (one.stalled and evidence.is_adequate(one))
    by = "simulation" if confirmed else "simulation, not converged"
    return RankedLaw(one.effects, dict(stack[label]), *numbers, confirmed, by)


def _drafted(one: Ranked) -> RankedLaw:
    numbers = (one.cost_per_dof, one.share_kept_out, one.margin, one.scatter)
    return RankedLaw(one.effects, dict(one.params), *numbers, False)
