"""Laws that are fitted by simulation, with their starting values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from gsid.diagnosis.from_records.draft import Draft, is_linear, with_stack
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.catalogue import family
from gsid.diagnosis.missing_torque.stage import HOLD, Ranked
from gsid.effects.types import find
from gsid.plant.model import PlantModel


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law with the model that its fit starts from."""

    effect: str
    model: PlantModel


def short_list(
    draft: Draft,
    pruned: Callable[[PlantModel], PlantModel],
    settings: DecisionSettings,
    left_out: Collection[str] = (),
) -> list[Candidate]:
    """The winner of the first stage, the best of another family, and relatives of the winner.

    The law that the winner becomes at one end of its shapes is always among them, and so are linear effects
    that are nearly as good, and the law that leaves least. Laws that explain too little to catch up are left
    out.

    Parameters
    ----------
    draft : Draft
    pruned : callable
        Removes elements of a stack that became zero.
    settings : DecisionSettings
    left_out : collection of str
        Effects that are not tried.
    """
    if draft.stage.ranking[0].effects == (HOLD,):  # its images are its evidence
        return [Candidate(HOLD, started(draft, draft.stage.ranking[0], pruned))]
    fitted = _worth_a_fit(draft, settings)
    if not fitted:
        return []
    winner = fitted[0]
    own = _family(winner)
    others = [one for one in fitted if _family(one) != own]
    if is_linear(winner.effects[0]):  # its linear rivals follow
        others = [one for one in others if not is_linear(one.effects[0])]
    rivals = others[: settings.rivals]
    members = [one for one in fitted[1:] if _family(one) == own][: settings.members]
    chosen = [winner, *rivals, *members]
    chosen += [one for one in fitted if one not in chosen and _is_close(one, winner, settings)]
    chosen += _clearly_likelier(draft.stage.ranking, chosen, settings)
    chosen += _simplest_of_rivals(draft.stage.ranking, winner, chosen, settings)
    listed = [Candidate(one.effects[0], started(draft, one, pruned)) for one in chosen]
    simpler = find(winner.effects[0]).simpler
    if simpler and simpler not in [*left_out, *(one.effect for one in listed)]:
        base = pruned(with_stack(draft.model, winner.linear))
        listed.append(Candidate(simpler, base.with_effect(simpler, winner.params)))
    return listed


def _worth_a_fit(draft: Draft, settings: DecisionSettings) -> list[Ranked]:
    """Laws that explain enough of what was kept out; without one, or behind a held sensor, of the cost too.

    Several records may determine a law together and none of them alone: one that leaves nearly only noise is
    fitted all the same. What a sensor that is sampled and held folds into the band is an error of the first
    stage, and hides what a law explains.

    Parameters
    ----------
    draft : Draft
    settings : DecisionSettings
    """
    stage, least = draft.stage, settings.rival_share
    kept = [one for one in stage.ranking if one.share_kept_out >= least]
    is_near_noise = any(one.cost_per_dof < settings.much_left for one in stage.ranking)
    if HOLD not in stage.linear and (kept or not is_near_noise):
        return kept
    misfit = stage.cost_per_dof - 1
    most = 1 + (1 - least) * misfit  # cost of a law that explains as much of it
    return [one for one in stage.ranking if one in kept or (misfit > 0 and one.cost_per_dof <= most)]


def started(draft: Draft, one: Ranked, pruned: Callable[[PlantModel], PlantModel]) -> PlantModel:
    """The linear stack with a law, at the values of the first stage.

    Parameters
    ----------
    draft : Draft
    one : Ranked
        With its joint fit.
    pruned : callable
        As `short_list`.
    """
    base = pruned(with_stack(draft.model, one.linear))
    effect = one.effects[0]
    return base if is_linear(effect) else base.with_effect(effect, one.params)


def _is_close(one: Ranked, winner: Ranked, settings: DecisionSettings) -> bool:
    """Whether a linear effect, whose simulation takes little time, may be as good as the winner."""
    return is_linear(one.effects[0]) and one.drop > winner.drop - settings.named_lead


def _clearly_likelier(
    ranking: Sequence[Ranked], chosen: Sequence[Ranked], settings: DecisionSettings
) -> list[Ranked]:
    """The law that leaves least, if that is little more than noise and clearly less than the chosen ones do.

    A stop that is touched in one realisation explains nothing of the others, on which it was not fitted.
    """
    near = [one for one in ranking if one.cost_per_dof < settings.much_left]
    best = max(near, key=lambda one: one.drop, default=None)
    if best is None:
        return []
    lead = best.drop - max(one.drop for one in chosen)
    return [best] if lead > settings.worse * max(best.cost_per_dof, 1.0) else []


def _simplest_of_rivals(
    ranking: Sequence[Ranked], winner: Ranked, chosen: Sequence[Ranked], settings: DecisionSettings
) -> list[Ranked]:
    """What rivals of a linear effect become at the end of their shapes, if that may be as good as the winner.

    A damping and a dry friction of one parameter are a group; a hysteresis alone would keep it from its name.
    """
    if not is_linear(winner.effects[0]):
        return []
    ends = {_simplest(one.effects[0]) for one in chosen if not is_linear(one.effects[0])}
    near = [one for one in ranking if one.drop > winner.drop - settings.named_lead]
    return [one for one in near if one.effects[0] in ends and one not in chosen]


def _simplest(effect: str) -> str:
    simpler = find(effect).simpler
    return _simplest(simpler) if simpler else effect


def _family(one: Ranked) -> str:
    return family(find(one.effects[0]))
