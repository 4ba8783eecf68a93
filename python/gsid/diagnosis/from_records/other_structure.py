"""A law that was fitted beside a linear structure of its own: its verdict and its rival."""

from __future__ import annotations

from gsid.base.deadline import OutOfTime
from gsid.diagnosis.from_records.confirm import Simulated, Simulations
from gsid.diagnosis.from_records.draft import draft, is_linear
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.short_list import short_list
from gsid.diagnosis.from_records.verdict import MISSING, NEAREST, Decision
from gsid.greybox.fit import CANNOT_FIT
from gsid.plant.model import PlantModel


def least_left(run: Run) -> float:
    """Cost per degree of freedom that the linear part and the laws so far leave.

    Parameters
    ----------
    run : Run
    """
    return min(one.fit.cost_per_dof for one in [run.null, *run.laws])


def take(run: Run, found: Simulated, law: str) -> None:
    """Decide with a further law. One that got a linear structure of its own needs a fit that leaves noise.

    Parameters
    ----------
    run : Run
    found : Simulated
        The law, or a rival of it.
    law : str
        Effect that the linear structure was chosen for.
    """
    run.laws = [one for one in run.laws if one.effects != found.effects or one.cost < found.cost]
    if not any(one.effects == found.effects for one in run.laws):
        run.laws.append(found)
    run.decide()
    decision = run.decision
    is_named = decision.effects[:1] == (law,) and run.final.effects == (law,)
    if is_named and decision.verdict == MISSING and not run.evidence().is_adequate(run.final):
        reason = f"More than noise is left beside a linear structure that was chosen for {law}."
        run.decision = Decision(NEAREST, decision.effects, (reason,), decision.unexplained_share)


def add_rival(run: Run, fits: Simulations, structure: PlantModel, found: Simulated) -> None:
    """Fit the best law of the first stage beside the same structure, as a rival.

    Parameters
    ----------
    run : Run
    fits : Simulations
    structure : PlantModel
    found : Simulated
        The law beside this structure.
    """
    how = {"band": run.band, "without": run.excluded, "from_data": True, "settings": run.settings}
    try:
        first = draft(
            run.judged, structure, **how, on_step=run.on_step, deadline=run.deadline, linear_rounds=0
        )
    except (*CANNOT_FIT, OutOfTime):
        return
    others = [
        one for one in short_list(first, run.pruned, run.settings, run.excluded) if not is_linear(one.effect)
    ]
    for one in [one for one in others if (one.effect,) != found.effects][:1]:
        rival = fits.fit(one.model, (one.effect,), found.cost)
        if rival is not None:
            take(run, rival, found.effects[0])
