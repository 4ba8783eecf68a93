"""The result from the state of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gsid.base.hold import DECLARE, MEANING, other_reading
from gsid.diagnosis.from_records.basis import Basis, basis_of_draft
from gsid.diagnosis.from_records.canonical import unit_of_values
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.one_line import remark_on_one_line
from gsid.diagnosis.from_records.probability import probabilities
from gsid.diagnosis.from_records.result import Diagnosis
from gsid.diagnosis.from_records.shown_models import (
    as_given,
    fit_shown,
    law_model_of,
    linear_of,
    model_of,
    without_law,
)
from gsid.diagnosis.from_records.shown_ranking import NAN, law_models_of, ranking_of, with_probabilities
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, UNKNOWN, Decision
from gsid.diagnosis.missing_torque.stage import HOLD
from gsid.diagnosis.next_experiment import advice
from gsid.greybox.fit import unsettled_text
from gsid.plant.model import OUTPUTS

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.rounds import Rounds
    from gsid.diagnosis.from_records.run import Run
    from gsid.diagnosis.from_records.settings import DecisionSettings


def summarised(run: Run, rounds: Rounds | None = None) -> Diagnosis:
    """The result of a diagnosis in its present state.

    Parameters
    ----------
    run : Run
        Of the linear structure from the data, or of the given model.
    rounds : Rounds, optional
        With a given model: one round for each effect found.
    """
    kept, near, joint = (rounds.kept, rounds.near, rounds.joint) if rounds else ([], [], None)
    decision, draft = run.decision, run.draft
    stage = draft.stage if draft else None
    null = run.null.fit.cost_per_dof if run.null else stage.cost_per_dof if stage else NAN
    shown, final = [*kept, *near, run][0], kept[-1].final if kept else run.final
    if kept:
        decision = _of_all(run, kept, near)
    elif near:
        decision = _of_near(run, near, joint)
    found_model = final.model if kept and final else law_model_of(run, decision)
    law_model = joint.model if joint else found_model
    found = [one.decision.effects for one in kept] or _found(run, decision)
    is_one = len(kept) + len(near) < 2 and not (rounds and rounds.has_series)
    basis = _basis(shown) if is_one else None
    known = probabilities(basis) if basis and _is_like_trials(run, shown, decision) else None
    ranking = ranking_of(shown)
    return Diagnosis(
        verdict=decision.verdict,
        effects=decision.effects,
        unexplained_share=decision.unexplained_share,
        confirmed=run.is_confirmed,
        reasons=decision.reasons,
        ranking=with_probabilities(ranking, basis, known),
        law_models=law_models_of(shown, ranking),
        found=found,
        nearest=_nearest(decision, near),
        model=as_given(run, found_model if kept else model_of(run, decision)),
        cost_per_dof=null,
        cost_per_dof_after=_cost_per_dof(final if kept else joint) or _after(run, null),
        p_value=run.null.noise_p_value if run.null else None,
        assumed=_assumed(run),
        not_tried=_not_tried(run, [*kept, *near]),
        seconds=run.seconds,
        hold=run.hold,
        hold_assumed=run.hold_assumed,
        names=[one.name for one in run.measured],
        measured=run.measured,
        band=run.band,
        linear=as_given(run, linear_of(run)),
        law_model=as_given(run, law_model),
        without_law=as_given(run, without_law(run, [*kept, *near], law_model)),
        next_experiment="" if run.interrupted else _next_experiment(shown),
        other_delay_s=fit_shown(run, kept).other_delay_s if run.null else None,
        delay_hold_uncertainty_s=fit_shown(run, kept).delay_hold_uncertainty_s if run.null else None,
        remarks=[*run.notes, *_remarks_on_fit(final if kept else run.shown, run.settings)],
        basis=basis,
        probabilities=known,
        interrupted=run.interrupted,
        ripple=shown.ripple,
    )


def _remarks_on_fit(shown: Simulated | None, settings: DecisionSettings) -> list[str]:
    """Remarks on the fit that the result is of; those of the trials tell nothing of it."""
    if shown is None:
        return []
    text = unsettled_text(shown.fit) if shown.fit.unsettled else ""
    return [*([f"{text[0].upper()}{text[1:]}."] if text else []), *remark_on_one_line(shown.fit, settings)]


def _basis(run: Run) -> Basis | None:
    """What is known of the best law, by simulation or by the first stage."""
    if run.laws:
        return run.basis
    is_unknown = run.null is not None and run.draft is not None and run.decision.verdict == UNKNOWN
    return basis_of_draft(run.draft.stage) if is_unknown else None


def _is_like_trials(run: Run, shown: Run, decision: Decision) -> bool:
    """Whether the trials of the calibration tell how probable the best law is.

    That nothing is missing has a p-value instead: how often a weak effect is present no record tells.
    """
    is_whole = not (run.cut or shown.cut or run.interrupted)
    in_closed_loop = run.in_closed_loop or (run.given is not None and run.given.has_controller)
    return decision.verdict != ADEQUATE and is_whole and not (in_closed_loop or shown.known)


def _of_all(run: Run, kept: Sequence[Run], near: Sequence[Run]) -> Decision:
    """Verdict of several effects: each is missing."""
    final, evidence = kept[-1].final, run.evidence()
    if final is None or len(kept) + len(near) == 1:
        return kept[0].decision
    left = 1 - evidence.share(final) if evidence.excess(run.null) > 0 else None
    return Decision(MISSING, kept[0].decision.effects, _against(near), left)


def _of_near(run: Run, near: Sequence[Run], joint: Simulated) -> Decision:
    """Verdict of effects that are missing together, none of which is named."""
    evidence = run.evidence()
    left = 1 - evidence.share(joint) if evidence.excess(run.null) > 0 else None
    return Decision(NEAREST, near[0].decision.effects, _against(near), left)


def _against(near: Sequence[Run]) -> tuple[str, ...]:
    """What keeps effects from being named."""
    reasons = [(" or ".join(one.decision.effects), text) for one in near for text in one.decision.reasons]
    return tuple(f"{names}: {text}" for names, text in reasons)


def _nearest(decision: Decision, near: Sequence[Run]) -> list[tuple[str, ...]]:
    """Effects that are missing but only the nearest: beside those named, or alone."""
    if decision.verdict == NEAREST and not near:
        return [decision.effects]
    return [one.decision.effects for one in near]


def _not_tried(run: Run, found: Sequence[Run]) -> dict[str, str]:
    """Why effects were not tried, without those of which one fit of several succeeded."""
    of_stage = run.draft.stage.not_tried if run.draft else {}
    missing = {effect: why for effect, why in of_stage.items() if effect not in run.tried} | run.not_tried
    fitted = {one.name for each in (run, *found) for one in (each.null, *each.laws) if one is not None}
    return {name: why for name, why in missing.items() if name not in fitted}


def _next_experiment(run: Run) -> str:
    """An experiment that distinguishes the first two members of the group."""
    by_effect = {one.effects[0]: one.model for one in run.laws} | run.larger
    group = [effect for effect in run.decision.effects if effect in by_effect][:2]
    if len(group) < 2 or run.deadline.is_over:
        return ""
    largest = max(run.measured, key=lambda one: float(np.linalg.norm(one.u)))
    with run.timed("next experiment"):
        first, second = group
        return advice(by_effect[first], by_effect[second], largest, (first, second), run.deadline)


def _cost_per_dof(fit: Simulated | None) -> float | None:
    return fit.fit.cost_per_dof if fit else None


def _after(run: Run, before: float) -> float:
    if run.decision.effects:
        return run.final.fit.cost_per_dof if run.final else run.draft.stage.ranking[0].cost_per_dof
    return before


def _found(run: Run, decision: Decision) -> list[tuple[str, ...]]:
    """Effects that the first stack lacked, a sensor that is sampled and held, and the law."""
    if run.draft is None:
        return []
    in_start = [(HOLD,)] if run.start is not None and HOLD in run.start.effects else []
    found = in_start + [one for one in run.draft.added if run.start is None or one == (HOLD,)]
    named = [decision.effects] if decision.verdict == MISSING else []
    return found + [effects for effects in named if effects not in found]


def _other_delay(run: Run) -> str:
    """The delay under the other assumption about the hold, if it is known."""
    delay_s = None if run.given or run.hold is None or run.null is None else fit_shown(run, []).other_delay_s
    if delay_s is None:
        return ""
    return f" ({MEANING[other_reading(run.hold)]}, the delay would be {1e3 * delay_s:.5g} ms)"


def _assumed(run: Run) -> list[str]:
    """What the result relies on: of the linear structure, and of this diagnosis."""
    one = run.measured[0]
    if run.start is not None:
        texts = [text for text in run.start.assumed if not text.startswith("the input was")]
        others = {one["other"].partition(",")[0] for one in run.start.ambiguous}
        kinds = [kind for kind in OUTPUTS if kind in others and kind != run.start.output]
        texts += [f"y may also be the {kind}, the data do not decide; --output {kind}" for kind in kinds]
        structure = ", ".join(run.start.effects) or f"rational, order {run.start.order}"
        texts.append(f"linear structure: {structure}")
        unit = unit_of_values(run.start.measured.y_unit, run.stack) if run.stack is not None else None
        texts += [unit] if unit else []
    else:
        texts = [f"period {one.period_samples} samples, {one.settle_samples} samples discarded at the start"]
    if run.hold_assumed and run.draft:
        texts.append(f"the input was {MEANING[run.hold or 'zoh']}{_other_delay(run)}; to decide, {DECLARE}")
    if run.in_closed_loop and run.loop is not None:
        gains = ", ".join(f"{name} {param.value:.4g}" for name, param in run.loop.params.items())
        texts.append(f"the controller, found from reference, output and command: {run.loop.id} ({gains})")
    if run.in_closed_loop:
        texts.append(
            "the input is known without noise, though the loop feeds the output's noise back into it"
        )
    added = [" or ".join(one) for one in run.draft.added] if run.draft else []
    return texts + ([f"added to the linear part: {', '.join(added)}"] if added else [])
