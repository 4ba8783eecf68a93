"""First stage of the diagnosis: the missing torque, without any simulation."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import InputError
from gsid.base.threads import in_parallel
from gsid.diagnosis.missing_torque import catalogue
from gsid.diagnosis.missing_torque.conclusion import Conclusion, Misfit, choose, conclude, margin
from gsid.diagnosis.missing_torque.free_functions import FreeFunction, beside
from gsid.diagnosis.missing_torque.kept_out import keep_out
from gsid.diagnosis.missing_torque.law_columns import Law
from gsid.diagnosis.missing_torque.linear_fit import KnownFits, LinearFit, fit_linear_part, fit_nulls
from gsid.diagnosis.missing_torque.motion import Motion, motions
from gsid.diagnosis.missing_torque.other_start import Stack, lacks, with_values_of
from gsid.diagnosis.missing_torque.problem import LinearPart, Problem, linear_part
from gsid.diagnosis.missing_torque.ranking import (
    Candidate,
    Scan,
    linear_candidates,
    mode_start,
    scan_laws,
    with_linear,
)
from gsid.diagnosis.missing_torque.refit import has_strayed, is_at_an_end, refit
from gsid.diagnosis.missing_torque.settings import DEFAULTS, SearchSettings
from gsid.effects.types import EffectType
from gsid.effects.types import catalogue as effect_types
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel, check_plant
from gsid.records.record import Record
from gsid.response.sample_hold import held_rate
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, is_open, read_as


@dataclass(frozen=True, eq=False)
class Ranked:
    """One law of the ranking.

    Attributes
    ----------
    effects : tuple of str
    params : dict of float
        Values of its parameters: starts of a fit by simulation.
    linear : dict of dict of float
        {effect: {parameter: value}} of the linear part beside it, of the same fit.
    cost_per_dof : float
        Cost of the joint fit; NaN if the law was only scanned.
    share_kept_out : float
        Share of the misfit that it explains where it was not fitted; NaN if it was only scanned.
    margin : float
        Excess of the best other family's kept-out cost over its own; NaN if it was only scanned.
    scatter : float
        Of its coefficient over realisations, relative to it; NaN if it was only scanned.
    drop : float
        Drop of the cost by the joint fit; NaN if it was only scanned.
    gain : float
        Drop of the cost in the scan.
    """

    effects: tuple[str, ...]
    params: dict[str, float]
    linear: dict[str, dict[str, float]]
    cost_per_dof: float
    share_kept_out: float
    margin: float
    scatter: float
    drop: float
    gain: float


@dataclass(frozen=True, eq=False, repr=False)
class FirstStage:
    """Result of :func:`first_stage`.

    Attributes
    ----------
    conclusion : Conclusion
    ranking : list of Ranked
        The best law first.
    cost_per_dof : float
        Of the linear part alone; 1 where only noise is left.
    linear : dict of dict of float
        {effect: {parameter: value}} of the linear part alone.
    not_tried : dict of str
        Effects that the first stage cannot look at, with the reason.
    seconds : dict of float
        Time of each step.
    hold : {"zoh", "none"} or None
        Hold of the input that was assumed; None if the records state different ones.
    n_rows : int
        Real numbers that were fitted.
    """

    conclusion: Conclusion
    ranking: list[Ranked]
    cost_per_dof: float
    linear: dict[str, dict[str, float]]
    not_tried: dict[str, str]
    seconds: dict[str, float]
    hold: str | None
    n_rows: int

    @property
    def sentence(self) -> str:
        """The conclusion as a sentence."""
        kind, effects = self.conclusion.kind, " or ".join(self.conclusion.effects)
        if kind == "none":
            return "These data show no missing effect."
        if kind == "named":
            return f"First draft: {effects} is missing, to be confirmed by simulation."
        if kind == "nearest":
            share = self.ranking[0].share_kept_out
            return f"First draft: nearest is {effects}; not explained: {1 - share:.0%}."
        return "First draft: an effect is missing; these data confirm no law of the catalogue."

    def __repr__(self) -> str:
        lines = [self.sentence, *(f"  {reason}" for reason in self.conclusion.reasons)]
        for one in self.ranking:
            lines.append(
                f"  {' or '.join(one.effects):24} share {one.share_kept_out:7.2%}, margin {one.margin:.3g}, "
                f"scatter {one.scatter:.1%}, cost {self.cost_per_dof:.4g} -> {one.cost_per_dof:.4g}"
            )
        return "\n".join(lines)


UNDECIDED = Conclusion("unknown", (), ("The time was over before the decision.",))


@contextmanager
def in_time(is_optional: bool = True) -> Iterator[None]:
    """Leave a step without a result at the deadline, if there is a result without it.

    Parameters
    ----------
    is_optional : bool
    """
    try:
        yield
    except OutOfTime:
        if not is_optional:
            raise


class _Clock:
    """Time of each step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.last = time.perf_counter()

    def take(self, step: str) -> None:
        now = time.perf_counter()
        self.seconds[step] = self.seconds.get(step, 0.0) + now - self.last
        self.last = now


def first_stage(
    records: Record | Spectra | Sequence[Record | Spectra],
    model: PlantModel,
    *,
    band: tuple[float, float] | None = None,
    without: Collection[str] = (),
    values: Stack | None = None,
    along: Sequence[Spectra] | None = None,
    known: KnownFits | None = None,
    settings: SearchSettings = DEFAULTS,
    on_step: Callable[[str], None] = lambda text: None,
    deadline: Deadline | None = None,
) -> FirstStage:
    """Rank the laws of the catalogue by the missing torque that they explain, without simulation.

    Parameters
    ----------
    records : Record or Spectra, or a sequence of them
        Realisations. If they do not state their hold, both are tried, and the linear part decides.
    model : PlantModel
        Its linear part: rigid body, damping, spring, modes, lags and delay; their free values are fitted.
    band : (lo, hi), optional
        Hz; default from the first to the last excited line.
    without : collection of str
        Effects that are not tried.
    values : dict of dict of float, optional
        Another linear stack, {effect: {parameter: value}}: fits of the linear part begin from its values as
        well, and effects that only this stack has are fitted whatever the scan finds.
    along : sequence of Spectra, optional
        The same records as measured, where the part of known laws was subtracted from the output: the laws
        act along this motion.
    known : dict, optional
        Fits of the linear part that were made before with these records, band and settings; in place.
    settings : SearchSettings
    on_step : callable
        Called with a short description of each step before it starts.
    deadline : Deadline, optional
        Time at which the laws that were fitted until then are ranked; `not_tried` has the others.

    Returns
    -------
    FirstStage

    Raises
    ------
    InputError
        The model has a joint between motor and load; no effect is left to look for; a record that
        `gsid.spectra` refuses.
    ValueError
        The band contains no line.
    OutOfTime
        The deadline was reached before any law was fitted.
    """
    check_plant(model)
    if any(effect.id == BACKLASH for effect in model.effects):
        hint = "remove it from the model; a simulation is needed to judge laws beside it"
        raise InputError("the first stage has no model of play between motor and load", "", BACKLASH, hint)
    clock = _Clock()
    measured = spectra_of(records)
    clock.take("spectra")
    on_step("fitting the linear part")
    given = linear_part(model)
    readings = ["zoh", "none"] if is_open(measured) and not model.has_controller else ["zoh"]
    problems = [
        Problem(model, read_as(measured, reading), band, settings, deadline, along) for reading in readings
    ]
    other = None if values is None else with_values_of(given, values)
    nulls = list(zip(problems, fit_nulls(problems, given, other, known), strict=True))
    clock.take("linear part")
    found = []
    for each in _possible(nulls, settings, {*without, *(effect.id for effect in model.effects)}):
        with in_time(bool(found)):
            found.append(_fitted(*each, given, values, model, without, clock=clock, on_step=on_step))
    by_noise = one = min(found, key=lambda each: each.best.fit.cost_per_dof)
    conclusion = UNDECIDED
    with in_time():
        free = beside(one.problem, one.null, one.best)
        conclusion = _concluded(one, free)
        clock.take("enlarged laws")
        if conclusion.kind != "named" and one.best.kept > settings.model_error:
            on_step("fitting with the weights of what is left")
            weighted = _with_model_error(one, model, without)
            conclusion = _concluded(weighted, free)
            one = weighted
            clock.take("model error")
    rest = sorted((each for each in one.refitted if each is not one.best), key=lambda each: each.kept)
    ranking = [_ranked(each, one, by_noise) for each in [one.best, *rest]]
    ranking += [_scan_only(each) for each in one.candidates if each.fit is None]
    if one.before is not None:
        conclusion = _with_hold(conclusion)
        before = _misfit(by_noise.problem, one.before)
        ranking.insert(0, _ranked_hold(one.before, by_noise.null, before, by_noise.misfit.kept))
    return FirstStage(
        conclusion,
        ranking,
        by_noise.null.cost_per_dof,
        one.null.part.stack,
        _not_tried(one),
        clock.seconds,
        _hold(one.problem, measured),
        one.problem.n_rows,
    )


@dataclass(frozen=True, eq=False)
class _Fitted:
    """The laws with one reading of the hold.

    `before` is the linear part without the sensor that is sampled and held, None without such a sensor.
    `too_late` are the candidates for whose joint fit there was no time.
    """

    problem: Problem
    null: LinearFit
    given: LinearPart
    values: Stack | None
    before: LinearFit | None
    moved: list[Motion]
    candidates: list[Candidate]
    refitted: list[Candidate]
    misfit: Misfit
    best: Candidate
    too_late: list[Candidate]


def _possible(
    nulls: list[tuple[Problem, LinearFit]], settings: SearchSettings, left_out: Collection[str]
) -> list[tuple[Problem, LinearFit]]:
    """Readings of the hold that the linear part does not exclude.

    Half a sample of delay shifts the phase of a resonance by as much as a law does: where much is missing,
    the linear part alone cannot decide. A hold attenuates as a lag does: where a lag is missing, the wrong
    reading can be far better without it, and is not with it. A lag of half a sample attenuates as a hold
    does: the wrong reading then leaves little, and the other one counts if it and a lag explain that beyond
    chance.
    """
    likeliest = min(nulls, key=lambda each: each[1].cost)
    problem, null = likeliest
    is_good = null.cost_per_dof <= settings.good_cost
    found = [each for each in nulls if each[1].cost <= null.cost * (1.0 if is_good else settings.hold_ratio)]
    lags = [one for one in effect_types().values() if one.linear_part == "lag" and one.id not in left_out]
    if len(found) == len(nulls) or not lags:
        return found
    cost, best = min(((_with_lag(*each, lags[0]).cost, each) for each in nulls), key=lambda pair: pair[0])
    is_chance = is_good and null.cost - cost < math.log(problem.n_rows) + settings.null_gain
    return found if best in found or is_chance else [*found, best]


def _with_lag(problem: Problem, null: LinearFit, lag: EffectType) -> LinearFit:
    sample_s = 1 / problem.first[0].spectra.fs_hz
    return fit_linear_part(problem, with_linear(null.part, lag, problem.settings.hold_lag * sample_s))


def _fitted(
    problem: Problem,
    null: LinearFit,
    given: LinearPart,
    values: Stack | None,
    model: PlantModel,
    without: Collection[str],
    *,
    clock: _Clock,
    on_step: Callable[[str], None],
) -> _Fitted:
    """Scan all laws and refit the best, with one reading of the hold."""
    held, before = _held_sensor(problem, null, model, without), None
    if held is not None:
        before, given, null = null, held.part, held
    clock.take("sample and hold")
    on_step("scanning the laws")
    moved = motions(problem, null.part)
    candidates = _scanned(problem, null, given, moved, model, without)
    _add_starts(candidates, null, values)
    clock.take("scan")
    on_step("fitting the best laws")
    chosen = _chosen(problem, null, candidates)
    refitted = _refitted(problem, null, moved, chosen, given)
    misfit = _misfit(problem, null)
    best = choose(refitted, misfit, problem.settings)
    others = [one for one in candidates if one not in chosen and _is_linear_rival(one, best)]
    if others:
        chosen += others
        more = _refitted(problem, null, moved, others, given)
        refitted += [one for one in more if not is_at_an_end(one)]
        best = choose(refitted, misfit, problem.settings)
    clock.take("joint fits")
    too_late = [one for one in chosen if one.fit is None] if problem.deadline.is_over else []
    return _Fitted(problem, null, given, values, before, moved, candidates, refitted, misfit, best, too_late)


def _is_linear_rival(one: Candidate, best: Candidate) -> bool:
    """Whether a linear effect is fitted against the best law: any against another one, a spring against a law
    of the angle, which is one over small angles."""
    if one.law is not None:
        return False
    return best.law is None or bool(one.effect.linear_part == "spring" and best.effect.c.looks_at_angle)


def _concluded(one: _Fitted, free: Sequence[FreeFunction]) -> Conclusion:
    enlarged = _enlarged(one.problem, one.null, one.moved, one.best, one.given)
    return conclude(one.best, one.refitted, enlarged, one.misfit, one.problem.settings, free)


def _hold(problem: Problem, measured: Sequence[Spectra]) -> str | None:
    """The reading of the records that do not state their hold; else what all state, None if they differ."""
    read = [r.spectra.hold for r in problem.records]
    was_open = [one.hold is None for one in measured]
    holds = {hold for hold, is_read in zip(read, was_open, strict=True) if is_read or not any(was_open)}
    return holds.pop() if len(holds) == 1 else None


def _with_model_error(one: _Fitted, model: PlantModel, without: Collection[str]) -> _Fitted:
    """The same with weights of noise and of what the best law leaves, renewed with it.

    If no law can be fitted with new weights, the last ones stay.
    """
    settings, null, best, latest = one.problem.settings, one.null, one.best, one
    problem, refitted, candidates = one.problem, [], one.candidates
    for _ in range(1 + settings.passes):
        problem = one.problem.with_model_error(best.fit.part, problem.lines_of(best.fit.error))
        null = fit_linear_part(problem, null.part)
        moved = motions(problem, null.part)
        if not refitted:
            # Copies: if the time ends here, the result is that with the weights of noise.
            known = {each.name: copy.copy(each) for each in one.refitted}
            scanned = _scanned(problem, null, one.given, moved, model, without)
            _add_starts(scanned, null, one.values)
            candidates = [known.get(each.name, each) for each in scanned]
            try:
                refitted = _refitted(problem, null, moved, _chosen(problem, null, candidates), one.given)
            except InputError:
                return latest
        else:
            for each in refitted:
                refit(problem, null, each, moved, one.given)
            refitted = [each for each in refitted if each.fit is not None]
            if not refitted:
                return latest
        misfit = _misfit(problem, null)
        best = choose(refitted, misfit, settings)
        latest = replace(
            one,
            problem=problem,
            null=null,
            moved=moved,
            candidates=candidates,
            refitted=refitted,
            misfit=misfit,
            best=best,
        )
        if abs(best.fit.cost_per_dof - 1) < settings.renewed:
            break
    return latest


HOLD = next(effect.id for effect in effect_types().values() if effect.linear_part == "hold")


def _held_sensor(
    problem: Problem, null: LinearFit, model: PlantModel, without: Collection[str]
) -> LinearFit | None:
    """The linear part with a sensor that is sampled and held, where its images are detected."""
    if HOLD in without or any(effect.id == HOLD for effect in model.effects):
        return None
    settings = problem.settings
    rate_hz = held_rate(
        problem.mean_outputs, least_power=settings.images_least, largest_size=settings.images_size
    )
    if rate_hz is None:
        return None
    (parameter,) = effect_types()[HOLD].parameters
    stack = null.part.stack | {HOLD: {parameter.name: rate_hz}}
    return fit_linear_part(problem, replace(null.part, stack=stack))


def _with_hold(rest: Conclusion) -> Conclusion:
    """Sample and hold is named by its images; what is missing beside it is for the next round."""
    beside = " or ".join(rest.effects) or "an unknown effect"
    reasons = () if rest.kind == "none" else (f"Beside it: {beside} ({rest.kind}).",)
    return Conclusion("named", (HOLD,), reasons, rest.beaten_by, rest.taken_over_by)


def _ranked_hold(before: LinearFit, held: LinearFit, misfit: Misfit, kept: float) -> Ranked:
    params = held.part.stack[HOLD]
    drop = before.cost - held.cost
    share = misfit.share(kept)
    return Ranked((HOLD,), params, held.part.stack, held.cost_per_dof, share, math.inf, 0.0, drop, drop)


def _scanned(
    problem: Problem,
    null: LinearFit,
    given: LinearPart,
    moved: list[Motion],
    model: PlantModel,
    without: Collection[str],
) -> list[Candidate]:
    """All candidates with their gain in the scan, largest first.

    Where the fit has left the given values, the body may be at the place of a mode that is missing: that mode
    shows beside the given values only.
    """
    left_out = {effect.id for effect in model.effects} | set(without)
    is_angle = model.angle_unit != "m"
    scan, scales = Scan(problem, null, moved), catalogue.scales(problem, moved)
    several = len(problem.records) if len(problem.records) > 1 else 0
    own_phases = 0 if problem.has_mean_angle(null.part) else several
    laws = catalogue.laws(left_out, is_angle, not problem.closed_loop, own_phases)
    found = scan_laws(scan, laws, scales)
    present = {effect.id for effect in model.effects}
    linear = [e for e in catalogue.linear_effects(present, is_angle) if e.id not in without]
    found += linear_candidates(scan, linear, scales)
    if has_strayed(null.part, given, problem.settings.mode_spread):
        for one in [one for one in found if one.effect.linear_part == "mode"]:
            one.others = (mode_start(problem, given, one.effect, scales),)
    return sorted(found, key=lambda one: -one.gain)


def _add_starts(candidates: list[Candidate], null: LinearFit, values: Stack | None) -> None:
    """Give the linear effects that only another stack has the start of that stack; in place."""
    for one in candidates if values is not None else []:
        if one.law is None and lacks(null.part, values, one.name):
            one.others = (*one.others, with_values_of(one.start, values))


def _chosen(problem: Problem, null: LinearFit, candidates: list[Candidate]) -> list[Candidate]:
    """The best candidates, the best of each family that explains enough, and those of another stack."""
    settings = problem.settings
    chosen = candidates[: settings.n_refitted]
    for one in candidates[settings.n_refitted :]:
        first = all(one.family != other.family for other in chosen)
        if one.others or (first and one.gain > settings.family_share * null.cost):
            chosen.append(one)
    return chosen


def _refitted(
    problem: Problem, null: LinearFit, moved: list[Motion], chosen: list[Candidate], given: LinearPart
) -> list[Candidate]:
    """The candidates that were refitted before the deadline, and are the law that they are called."""
    fits_in_time = in_parallel(
        lambda one: _refitted_in_time(problem, null, one, moved, given), chosen, size=_n_shapes
    )
    refitted = [one for one in chosen if one.fit is not None]
    if not refitted and not all(fits_in_time):
        problem.deadline.check()
    if not refitted:
        hint = "look for more effects: --without leaves none that fits"
        raise InputError(
            "no effect of the catalogue can be fitted", problem.records[0].spectra.name, None, hint
        )
    stays = [one for one in refitted if not is_at_an_end(one)] or refitted
    for one in refitted:
        if one not in stays:
            one.fit, one.kept = None, math.inf
    return stays


def _n_shapes(one: Candidate) -> int:
    return len(one.shape) if one.law is not None else -1


def _refitted_in_time(
    problem: Problem, null: LinearFit, one: Candidate, moved: list[Motion], given: LinearPart
) -> bool:
    """Refit a candidate; False, and no fit, if the time was over before it was done."""
    try:
        refit(problem, null, one, moved, given)
    except OutOfTime:
        one.fit, one.kept = None, math.inf
        return False
    return True


def _enlarged(
    problem: Problem, null: LinearFit, moved: list[Motion], best: Candidate, given: LinearPart
) -> list[Candidate]:
    """Rivals of the best law from outside the catalogue, refitted."""
    scan = Scan(problem, null, moved)

    def fitted(law: Law) -> Candidate:
        (one,) = scan_laws(scan, [law], {})
        refit(problem, null, one, moved, given)
        return one

    return in_parallel(fitted, catalogue.enlarged_laws(best.family))


def _misfit(problem: Problem, null: LinearFit) -> Misfit:
    kept, _, _ = keep_out(problem, null, null.jacobian, 0, np.zeros(0))
    n_periods = problem.records[0].spectra.n_periods if len(problem.records) == 1 else 0
    return Misfit(null.cost, null.cost_per_dof, kept, problem.n_rows, n_periods, problem.has_model_error)


def _ranked(one: Candidate, among: _Fitted, by_noise: _Fitted) -> Ranked:
    """A law of the ranking; its costs are those with the weights of noise."""
    fit = one.fit
    if among is not by_noise:
        fit = replace(fit, error=by_noise.problem.whiten(among.problem.lines_of(fit.error)))
    return Ranked(
        (one.name,),
        one.params,
        fit.part.stack,
        fit.cost_per_dof,
        among.misfit.share(one.kept),
        margin(one, among.refitted, among.misfit),
        one.scatter,
        by_noise.null.cost - fit.cost,
        one.gain,
    )


def _scan_only(one: Candidate) -> Ranked:
    nan = float("nan")
    return Ranked((one.name,), {}, {}, nan, nan, nan, nan, nan, one.gain)


def _not_tried(one: _Fitted) -> dict[str, Any]:
    found = {BACKLASH: "the position of the motor is hidden; it needs a simulation"}
    found |= {each.name: "the time was over before its fit" for each in one.too_late}
    if one.problem.closed_loop:
        found |= {
            law.name: "the command inside the loop is not in the record"
            for law in catalogue.laws((), True, True)
            if law.is_command
        }
    return found
