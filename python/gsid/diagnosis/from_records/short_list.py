"""Laws that are fitted by simulation, with their starting values."""

from __future__ import annotations

from dataclasses import dataclass

from gsid.diagnosis.from_records.canonical import pruned
from gsid.diagnosis.from_records.draft import Draft, is_linear, with_stack
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.catalogue import family
from gsid.diagnosis.missing_torque.stage import Ranked
from gsid.effects.types import find
from gsid.plant.model import PlantModel


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law with the model that its fit starts from."""

    effect: str
    model: PlantModel


def short_list(draft: Draft, f_lo_hz: float, settings: DecisionSettings) -> list[Candidate]:
    """The winner of the first stage, the best of another family, and relatives of the winner.

    The law that the winner becomes at one end of its shapes is always among them. Laws that explain too
    little to catch up are left out.

    Parameters
    ----------
    draft : Draft
    f_lo_hz : float
        Lowest line [Hz].
    settings : DecisionSettings
    """
    fitted = [one for one in draft.stage.ranking if one.share_kept_out >= settings.rival_share]
    if not fitted:
        return []
    winner = fitted[0]
    own = _family(winner)
    rivals = [one for one in fitted if _family(one) != own][: settings.rivals]
    members = [one for one in fitted[1:] if _family(one) == own][: settings.members]
    chosen = [winner, *rivals, *members]
    listed = [Candidate(one.effects[0], started(draft, one, f_lo_hz, settings)) for one in chosen]
    simpler = find(winner.effects[0]).simpler
    if simpler and simpler not in [one.effect for one in listed]:
        base = pruned(with_stack(draft.model, winner.linear), f_lo_hz, settings)
        listed.append(Candidate(simpler, base.with_effect(simpler, winner.params)))
    return listed


def started(draft: Draft, one: Ranked, f_lo_hz: float, settings: DecisionSettings) -> PlantModel:
    """The linear stack with a law, at the values of the first stage.

    Parameters
    ----------
    draft : Draft
    one : Ranked
        With its joint fit.
    f_lo_hz, settings
        As `short_list`.
    """
    base = pruned(with_stack(draft.model, one.linear), f_lo_hz, settings)
    effect = one.effects[0]
    return base if is_linear(effect) else base.with_effect(effect, one.params)


def _family(one: Ranked) -> str:
    return family(find(one.effects[0]))
