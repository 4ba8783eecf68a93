"""The result from the state of a diagnosis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsid.base.hold import DECLARE, MEANING
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.result import RankedLaw, RecordsDiagnosis
from gsid.diagnosis.from_records.short_list import started
from gsid.diagnosis.from_records.verdict import MISSING, Evidence
from gsid.diagnosis.missing_torque.stage import HOLD, Ranked
from gsid.plant.model import PlantModel

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.run import Run

NAN = float("nan")


def summarised(run: Run) -> RecordsDiagnosis:
    """The result of a diagnosis in its present state.

    Parameters
    ----------
    run : Run
    """
    decision, draft = run.decision, run.draft
    stage = draft.stage if draft else None
    null = run.null.fit.cost_per_dof if run.null else stage.cost_per_dof if stage else NAN
    model = _model(run)
    return RecordsDiagnosis(
        verdict=decision.verdict,
        effects=decision.effects,
        unexplained_share=decision.unexplained_share,
        confirmed=run.is_confirmed,
        reasons=decision.reasons,
        ranking=_ranking(run),
        found=_found(run),
        model=model,
        cost_per_dof=null,
        cost_per_dof_after=_after(run, null),
        p_value=run.null.fit.noise_p_value if run.null else None,
        assumed=_assumed(run),
        not_tried=(dict(stage.not_tried) if stage else {}) | run.not_tried,
        seconds=run.seconds,
        hold=stage.hold if stage else None,
        hold_assumed=run.hold_assumed,
        names=[one.name for one in run.measured],
        measured=run.measured,
        band=run.band,
        linear=run.null.model if run.null else draft.model if draft else None,
        law_model=_law_model(run),
        interrupted=run.interrupted,
        ripple=run.ripple,
    )


def _law_model(run: Run) -> PlantModel | None:
    """The stack with the law that is named or nearest."""
    if not run.decision.effects or run.draft is None:
        return None
    if run.final is not None:
        return run.final.model
    winner = run.draft.stage.ranking[0]
    return None if winner.effects[0] == HOLD else started(run.draft, winner, run.f_lo_hz, run.settings)


def _model(run: Run) -> PlantModel | None:
    """The stack with the law if it is named, else the linear one."""
    if run.decision.verdict == MISSING:
        return _law_model(run) or run.draft.model
    if run.null is not None:
        return run.null.model
    return run.draft.model if run.draft else run.stack


def _after(run: Run, before: float) -> float:
    if run.decision.effects:
        return run.final.fit.cost_per_dof if run.final else run.draft.stage.ranking[0].cost_per_dof
    return before


def _found(run: Run) -> list[tuple[str, ...]]:
    """Effects that the first stack lacked, a sensor that is sampled and held, and the law."""
    if run.draft is None:
        return []
    in_start = [(HOLD,)] if run.start is not None and HOLD in run.start.effects else []
    found = in_start + [one for one in run.draft.added if run.start is None or one == (HOLD,)]
    named = [run.decision.effects] if run.decision.verdict == MISSING else []
    return found + [effects for effects in named if effects not in found]


def _ranking(run: Run) -> list[RankedLaw]:
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
    if run.decision.verdict in ("adequate", "unknown_effect"):
        return [none, *sorted(simulated, key=_cost), *drafted]
    first = [one for one in simulated if one.effects[0] == run.decision.effects[0]]
    rest = sorted((one for one in simulated if one not in first), key=_cost)
    if not first:
        return [*drafted, none]
    return [*first, *rest, none, *drafted]


def _cost(one: RankedLaw) -> float:
    return one.cost_per_dof_after


def _simulated(one: Simulated, evidence: Evidence) -> RankedLaw:
    stack = one.model.stack()
    label = next(label for label in reversed(stack) if label.partition("#")[0] == one.effects[0])
    numbers = (one.fit.cost_per_dof, evidence.share(one), evidence.margin(one), one.scatter)
    confirmed = one.converged or (one.stalled and evidence.is_adequate(one))
    by = "simulation" if confirmed else "simulation, not converged"
    return RankedLaw(one.effects, dict(stack[label]), *numbers, confirmed, by)


def _drafted(one: Ranked) -> RankedLaw:
    numbers = (one.cost_per_dof, one.share_kept_out, one.margin, one.scatter)
    return RankedLaw(one.effects, dict(one.params), *numbers, False)


def _assumed(run: Run) -> list[str]:
    """What the result relies on: of the linear structure, and of this diagnosis."""
    one = run.measured[0]
    if run.start is not None:
        texts = [text for text in run.start.assumed if not text.startswith("the input was")]
        structure = ", ".join(run.start.effects) or f"rational, order {run.start.order}"
        texts.append(f"linear structure: {structure}")
    else:
        texts = [f"period {one.period_samples} samples, {one.settle_samples} samples discarded at the start"]
    if run.hold_assumed and run.draft:
        texts.append(f"the input was {MEANING[run.draft.stage.hold or 'zoh']}; to decide, {DECLARE}")
    if run.in_closed_loop and run.loop is not None:
        gains = ", ".join(f"{name} {param.value:.4g}" for name, param in run.loop.params.items())
        texts.append(f"the controller, found from reference, output and command: {run.loop.id} ({gains})")
    if run.in_closed_loop:
        texts.append(
            "the input is known without noise, though the loop feeds the output's noise back into it"
        )
    added = [" or ".join(one) for one in run.draft.added] if run.draft else []
    return texts + ([f"added to the linear part: {', '.join(added)}"] if added else [])
