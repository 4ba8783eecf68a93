"""Fits by simulation of the short list, and the laws that the first stage has no column for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from gsid.base.deadline import OutOfTime
from gsid.diagnosis.from_records.confirm import LINEAR_PART, Simulated, Simulations
from gsid.diagnosis.from_records.delay_in_place import delay_or_lag_in_place_of
from gsid.diagnosis.from_records.drive_laws import drive_starts
from gsid.diagnosis.from_records.evidence import is_simpler_of_angle
from gsid.diagnosis.from_records.larger_laws import worth_a_fit
from gsid.diagnosis.from_records.law_part import without_added
from gsid.diagnosis.from_records.play import may_have_play
from gsid.diagnosis.from_records.result import FITS
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.short_list import Candidate, short_list
from gsid.diagnosis.from_records.spring_in_place import spring_in_place_of
from gsid.diagnosis.from_records.stop_edges import shifted_stop
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, UNKNOWN, Decision
from gsid.diagnosis.from_records.working_point import (
    cubic_in_place_of_cogging,
    cubic_in_place_of_unbalance,
    unbalance_in_place_of_cubic,
)
from gsid.effects.ids import BIAS, CUBIC, SPRING, STOP, UNBALANCE
from gsid.effects.types import find
from gsid.greybox.fit import CANNOT_FIT
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel

Starts = Mapping[str, PlantModel | None]  # of fits, by the effect that is added

NOTEWORTHY = 1.0
"""Fall of the cost that counts as another minimum: fits that converged in the same one differ by less."""


def confirm(run: Run) -> None:
    """Fit the short list by simulation, and decide again.

    Parameters
    ----------
    run : Run
    """
    if run.in_closed_loop and not _close_loop(run):
        run.accept_noise_of_draft()
        return
    with run.timed("simulation"):
        fits, missing = run.simulations(), run.draft.stage.conclusion.kind != "none"
        listed = short_list(run.draft, run.pruned, run.settings, run.excluded) if missing else []
        run.on_step.expect(len(listed) + (run.null is None))
        run.null = run.null or _fitted_null(run, fits)
        if run.null is not None and missing:
            _fit_laws(run, fits, listed)
        run.accept_noise()
        if run.null is not None and run.decision.verdict == ADEQUATE:
            run.check_adequate()
        if not run.laws and run.decision.verdict == NEAREST:
            reason = f"No law was fitted by simulation; {' or '.join(run.decision.effects)} is a first draft."
            run.decision = Decision(UNKNOWN, (), (*run.decision.reasons, reason))
    run.not_tried.update(fits.not_tried)


def _fitted_null(run: Run, fits: Simulations) -> Simulated | None:
    """The linear part by simulation; from the stack itself if the draft's values cannot be simulated."""
    found = fits.fit(run.pruned(_linear_start(run)), ())
    if found is not None or run.deadline.is_used_up:
        return found
    found = fits.fit(run.pruned(run.stack), ())
    if found is not None:
        fits.not_tried.pop(LINEAR_PART, None)
    return found


def _linear_start(run: Run) -> PlantModel:
    """The linear part with its starting values.

    A given model with laws was fitted by simulation: its values are nearer than those of the first stage.
    """
    return run.stack if run.known and not run.draft.added else run.draft.model


def _close_loop(run: Run) -> bool:
    """Simulate with the reference as the input, and the controller around the axis, if it is known.

    The measured command would let the simulated axis drift away from the measured motion. The lines are
    those of the command: a reference of slow moves excites few of them distinctly, the friction all.
    """
    if run.loop is None or run.stack.output != "angle":
        run.not_tried[FITS] = "the controller is not known (closed loop)"
        return False
    if run.band is None:
        f_hz = np.concatenate([one.f_hz[one.excited] for one in run.measured])
        run.band = float(f_hz.min()), float(f_hz.max())
    run.measured, run.known = run.by_reference, [*run.known, run.loop]
    return True


def _fit_laws(run: Run, fits: Simulations, listed: list[Candidate]) -> None:
    """The laws of the short list, and the verdict."""
    to_beat = None
    for one in listed:
        fitted = fits.fit(one.model, (one.effect,), to_beat)
        run.cut = run.cut or (fitted is None and run.deadline.is_used_up)
        if fitted is not None:
            run.laws.append(fitted)
            to_beat = min(fitted.cost, to_beat or fitted.cost)
            run.decide()
    if run.given and run.given.has_controller:
        _fit_drive(run, fits)
    if run.laws:
        _add_bias(run, fits)
        _finish_best(run, fits)
        _try_spring(run, fits)
        _try_delay_or_lag(run, fits)
        _try_larger(run, fits)
        _fit_null_again(run, fits)
    is_noise = run.null.noise_p_value >= run.alpha
    if run.given and run.laws and is_noise and not run.is_significant:
        run.decision, run.final = Decision(ADEQUATE), None


def _finish_best(run: Run, fits: Simulations) -> None:
    """The best law once more, if its fit explains most of the misfit but was cut short.

    It began as a rival, which is given up early, or the other fits had used up the work.
    """
    best = run.final
    if best is None or best.converged or best.stalled or run.deadline.is_over:
        return
    noise = best.fit.n_dof
    if best.cost - noise > run.settings.less_left * max(run.null.cost - noise, 0.0):
        return
    run.replace_final(fits.finished(best))
    run.decide()


def _try_larger(run: Run, fits: Simulations) -> None:
    """Laws that contain the best one, where it leaves more than noise and none of them was fitted.

    Their shapes may show only along the simulated motion, as that of a friction at low speed behind a slow
    sensor.
    """
    best = run.final
    if best is None or run.in_closed_loop or best.model.has_controller or run.deadline.is_over:
        return
    if run.evidence().is_adequate(best):
        return
    known = {*run.excluded, *(each for one in run.laws for each in one.effects)}
    for larger in worth_a_fit(best.fit, best.effects[0], known, run.settings):
        fitted = fits.fit(larger.model, (larger.effect,), best.cost)
        if fitted is not None and fitted.cost < best.cost:
            run.laws.append(fitted)
    run.decide()


def _fit_null_again(run: Run, fits: Simulations) -> None:
    """The linear part alone once more, with the values that it has beside the best law.

    From a start far off its first fit may end in a wrong minimum, and a law that has left it explains what is
    not missing.
    """
    if run.null is None or run.final is None or run.decision.verdict not in (MISSING, NEAREST):
        return
    # With work of its own: a law that was finished may have a null in a wrong minimum.
    fits = replace(fits, deadline=run.deadline.bounded(run.settings.moves_of_fit))
    for start in without_added(run.final.model, run.null.model):
        again = fits.fit(start, ())
        if again is not None and again.cost < run.null.cost - NOTEWORTHY:
            run.null = again
            run.decide()


def _fit_drive(run: Run, fits: Simulations) -> None:
    """Laws of the drive inside a loop, which the first stage has no column for."""
    for effect, model in drive_starts(run.null.fit, run.excluded, run.deadline):
        fitted = fits.fit(model, (effect,), min((one.cost for one in run.laws), default=None))
        run.tried.add(effect)
        if fitted is not None:
            run.laws.append(fitted)
            run.decide()


def fit_play(run: Run) -> None:
    """Play between motor and load, which the first stage has no column for.

    Parameters
    ----------
    run : Run
    """
    if BACKLASH in run.without or run.null is None or not may_have_play(run.null.model):
        return
    fits, least = run.simulations(), min((one.cost for one in run.laws), default=np.inf)
    with run.timed("simulation"):
        fitted = fits.fit_play(run.null.fit, run.given, least)
    run.not_tried.update(fits.not_tried)
    run.tried.add(BACKLASH)
    if fitted is not None:
        run.laws.append(fitted)
        run.decide()


def _add_bias(run: Run, fits: Simulations) -> None:
    """A constant torque beside each law that it helps, where the best leaves more than noise.

    The offset of a drive shifts the working point of a law. Where the best leaves only noise, it is tried
    beside simpler laws of the angle: cogging with its phase is any of them at another working point.
    """
    evidence = run.evidence()
    best = evidence.best()
    present = {effect.id for effect in best.model.effects}
    if SPRING not in present or BIAS in present or BIAS in run.without:
        return
    adequate = evidence.is_adequate(best)
    for i, one in enumerate(run.laws):
        if adequate and not is_simpler_of_angle(one, best):
            continue
        fitted = fits.fit(one.model.with_effect(BIAS, {"level": 0.0}), one.effects, best.cost)
        if fitted is not None and evidence.is_worse(one, fitted):
            run.laws[i] = fitted
    _try_cubic(run, fits, best)
    _try_unbalance(run, fits)
    _try_stop(run, fits, run.evidence().best())
    run.decide()


def _try_cubic(run: Run, fits: Simulations, best: Simulated) -> None:
    """A cubic spring that a constant torque has shifted, in place of the best law.

    If that is not confirmed, in place of the likeliest law that has the shape of one.
    """
    if CUBIC in run.excluded:
        return
    others = [] if run.decision.verdict == MISSING else sorted(run.laws, key=run.evidence().priced)
    starts = (cubic_in_place_of_cogging(one) or cubic_in_place_of_unbalance(one) for one in [best, *others])
    _try_in_place(run, fits, next((start for start in starts if start is not None), None), CUBIC, best)


def _try_unbalance(run: Run, fits: Simulations) -> None:
    """An unbalance in place of a shifted cubic spring, if no fit of one is known: each may be the other."""
    known = {one.effects[0]: one for one in run.laws}
    if UNBALANCE not in {*run.excluded, *known} and CUBIC in known:
        start = unbalance_in_place_of_cubic(known[CUBIC])
        _try_in_place(run, fits, start, UNBALANCE, known[CUBIC])


def _try_stop(run: Run, fits: Simulations, best: Simulated) -> None:
    """A stop that a constant torque has shifted, in place of a law of the angle that is the best one.

    One side alone then hits it: from a symmetrical start the fit ends in a wrong minimum.
    """
    is_of_angle = find(best.effects[0]).c.looks_at_angle and find(best.effects[0]).linear_part is None
    known = {effect.id for effect in run.null.model.effects}
    if STOP in {*run.without, *known} or not is_of_angle or run.deadline.is_over:
        return
    try:
        how = run.band, run.settings.search, run.deadline
        start = shifted_stop(run.null.model, run.measured, *how)
    except (*CANNOT_FIT, OutOfTime):
        return
    _try_in_place(run, fits, start, STOP, best)


def _try_spring(run: Run, fits: Simulations) -> None:
    """A spring in place of the best law or mode, if the spring's own fit is not as good."""
    _try_linear(run, fits, lambda best: {SPRING: spring_in_place_of(best)})


def _try_delay_or_lag(run: Run, fits: Simulations) -> None:
    """A delay in place of a lag that is the best law, or the reverse, if its own fit is not as good."""
    _try_linear(run, fits, delay_or_lag_in_place_of)


def _try_linear(run: Run, fits: Simulations, in_place: Callable[[Simulated], Starts]) -> None:
    """Linear effects in place of the best law, if their own fits are not as good."""
    best = run.final
    if best is None or run.in_closed_loop or best.model.has_controller or run.deadline.is_over:
        return
    starts, evidence = in_place(best), run.evidence()
    as_good = {one.effects[0] for one in run.laws if not evidence.is_worse(one, best)}
    tried = sorted(starts.keys() - run.excluded - as_good)
    if not tried:
        return
    # With work of its own: the law may have used up that of the round.
    fits = replace(fits, deadline=run.deadline.bounded(run.settings.moves_of_fit))
    for effect in tried:
        _try_in_place(run, fits, starts[effect], effect, best)
    run.decide()


def _try_in_place(run: Run, fits: Simulations, model: PlantModel | None, law: str, best: Simulated) -> None:
    """A law from another start, in place of its own fit if it costs less."""
    fitted = fits.fit(model, (law,), best.cost) if model is not None else None
    if fitted is None or fitted.cost >= run.null.cost:
        return
    known = [one for one in run.laws if one.effects == (law,)]
    if not known or fitted.cost < known[0].cost:
        run.laws = [one for one in run.laws if one.effects != (law,)] + [fitted]
