"""Joint fits of a law with the linear part, with its kept-out cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gsid._lib import ffi
from gsid.diagnosis.missing_torque.kept_out import keep_out
from gsid.diagnosis.missing_torque.law_columns import (
    Law,
    command_lines,
    torque_lines,
    torques,
)
from gsid.diagnosis.missing_torque.linear_fit import (
    LinearFit,
    fit_linear_part,
    fit_with_shape,
    torque_columns,
    with_modes_searched,
)
from gsid.diagnosis.missing_torque.motion import Motion, motions
from gsid.diagnosis.missing_torque.problem import LinearPart, Problem, split
from gsid.diagnosis.missing_torque.ranking import (
    Candidate,
    Scan,
    is_dissipative,
    refine_shape,
    with_linear,
)

BOUND = 1e-3  # of the largest coefficient: a smaller one is at its bound


def refit(
    problem: Problem, null: LinearFit, one: Candidate, moved: Sequence[Motion], given: LinearPart
) -> None:
    """Fit a candidate together with the linear part, and judge it on what is kept out; in place.

    A law that has become another one stays without a fit: one with memory that dissipates nothing is a
    spring, and Stribeck's without its level or its extra is not Stribeck's. A law that cancels the spring of
    the linear part is none either.

    Parameters
    ----------
    problem : Problem
    null : LinearFit
        The linear part alone.
    one : Candidate
    moved : sequence of Motion
        Motions of the null.
    given : LinearPart
        With the values of the model: a fit without a linear effect that is missing may have left them far
        behind.
    """
    if one.law is None:
        _refit_linear(problem, null, one, given)
    elif one.law.is_command:
        _refit_command(problem, null, one, moved)
    else:
        _refit_torque(problem, null, one, moved)
        if _is_other_law(problem, one, moved):
            one.fit, one.kept = None, np.inf


def _is_other_law(problem: Problem, one: Candidate, moved: Sequence[Motion]) -> bool:
    law, c = one.law, one.coefficients
    at_bound = np.isfinite(law.lower) & (c - law.lower <= BOUND * np.max(np.abs(c)))
    if len(c) > 1 and np.any(at_bound):
        return True
    if _cancels_spring(problem, one, moved):
        return True
    return bool(law.effect.c.has_memory) and not is_dissipative(law, one.shape[None, :], problem, moved)[0]


def _cancels_spring(problem: Problem, one: Candidate, moved: Sequence[Motion]) -> bool:
    """Whether the law's own spring nearly cancels that of the linear part.

    The torque then holds the measured motion, whatever moves the axis: the output explains itself, with a
    coefficient as large as the fit lets it become.
    """
    stiffness = problem.stiffness(one.fit.part)
    law, c = one.law, one.coefficients
    if stiffness == 0 or not law.effect.c.looks_at_angle:
        return False
    values = law.unit_values(one.shape)
    shares = c.reshape(-1, len(values))  # of each record where its phase is its own
    against, power = 0.0, 0.0
    for i, motion in enumerate(moved):
        angle = motion.angle - np.mean(motion.angle)
        torque = shares[i % len(shares)] @ torques(law, values, motion, problem.radians)
        against, power = against + torque @ angle, power + angle @ angle
    return bool(abs(against / power + stiffness) < problem.settings.cancelled * stiffness)


def is_at_an_end(one: Candidate) -> bool:
    """Whether a refitted candidate is a mode at an end of the band: no resonance, it stands in for a lag.

    Parameters
    ----------
    one : Candidate
    """
    if one.effect.linear_part != "mode":
        return False
    at = -len(one.effect.parameters)  # its frequency
    part = one.fit.part
    return not part.lower[at] * (1 + BOUND) < part.values[at] < part.upper[at] * (1 - BOUND)


def _refit_linear(problem: Problem, null: LinearFit, one: Candidate, given: LinearPart) -> None:
    good = problem.settings.good_cost
    one.fit = fit_linear_part(problem, one.start)
    for other in one.others:
        one.fit = min(one.fit, fit_linear_part(problem, other), key=lambda fit: fit.cost)
    if null.cost_per_dof > good or has_strayed(null.part, given, problem.settings.mode_spread):
        for point in one.points:
            if one.fit.cost_per_dof <= good < null.cost_per_dof:
                break
            again = fit_linear_part(problem, with_linear(given, one.effect, point))
            one.fit = min(one.fit, again, key=lambda fit: fit.cost)
    if one.fit.cost_per_dof > good or has_strayed(one.fit.part, given, problem.settings.mode_spread):
        one.fit = with_modes_searched(problem, one.fit)
    one.coefficients = one.fit.part.values[len(null.part.names) :]
    one.kept, one.scatter, one.scatter_error = keep_out(problem, one.fit, one.fit.jacobian, 1)


def has_strayed(part: LinearPart, given: LinearPart, most: float) -> bool:
    """Whether a fit has left the given values so far behind that they may imitate what is missing.

    Parameters
    ----------
    part, given : LinearPart
        Of one structure, or `part` with further effects.
    most : float
        Largest ratio of a value to the given one.
    """
    before = given.values
    now = np.array([part.stack[label][name] for label, name in map(split, given.names)])
    known = before != 0
    return bool(np.any(np.abs(np.log(np.maximum(now[known] / before[known], 1e-9))) > np.log(most)))


def _refit_command(problem: Problem, null: LinearFit, one: Candidate, moved: Sequence[Motion]) -> None:
    law, part = one.law, null.part
    for _ in range(problem.settings.passes):
        commands = [u[0] for u in command_lines(law, one.shape[None, :], problem)]
        one.fit = fit_linear_part(problem, part, commands)
        part = one.fit.part
        # The error without the law, on the tangent of the fit with it.
        scan = Scan(problem, one.fit, moved)
        one.bracket = _around(one)
        error = scan.freed(problem.error(part, problem.commands))
        one.gain = float(scan.command_gains(law, one.shape[None, :], error)[0])
        refine_shape(scan, one, error)
    commands = [u[0] for u in command_lines(law, one.shape[None, :], problem)]
    one.fit = fit_linear_part(problem, part, commands)
    slopes = _shape_slopes(one, lambda shape: _command_error(problem, one, shape))
    jacobian = np.hstack([one.fit.jacobian, slopes])
    one.coefficients = one.shape
    one.kept, one.scatter, one.scatter_error = keep_out(problem, one.fit, jacobian, 1, one.coefficients)


def _command_error(problem: Problem, one: Candidate, shape: np.ndarray) -> np.ndarray:
    commands = [u[0] for u in command_lines(one.law, shape[None, :], problem)]
    return problem.error(one.fit.part, commands)


def _around(one: Candidate) -> np.ndarray:
    """The bracket of a shape for the next pass, half as wide."""
    half = 0.25 * np.ptp(one.bracket, axis=1)
    lower, upper = (np.array([getattr(p, end) for p in one.law.shapes]) for end in ("lower", "upper"))
    return np.stack([np.maximum(one.shape - half, lower), np.minimum(one.shape + half, upper)], axis=1)


def _shape_slopes(one: Candidate, error: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Derivative of the error by the shape, (n_rows, d), over a thousandth of its largest value."""
    step = 1e-3 * np.max(np.abs(one.shape))
    changes = step * np.eye(len(one.shape))
    return np.stack([error(one.shape + d) - error(one.shape - d) for d in changes], axis=1) / (2 * step)


def _refit_torque(problem: Problem, null: LinearFit, one: Candidate, moved: Sequence[Motion]) -> None:
    law = one.law
    scan = Scan(problem, null, moved)
    error = scan.freed(null.error)
    _, found = scan.torque_gains(law, one.shape[None, :], error)
    part, c = null.part, found[0]
    if one.fit is not None:  # with other weights
        part, c = one.fit.part, one.fit.coefficients
        moved = motions(problem, part)
    best: tuple[LinearFit, Sequence[Motion], float] | None = None
    for attempt in range(problem.settings.passes + 1):
        lines = [t[0] for t in torque_lines(law, one.shape[None, :], problem, moved)]
        fit = fit_linear_part(problem, part, torques=lines, first=c, lower=law.lower)
        if len(law.shapes) > 1:
            fit = _with_shape(problem, one, replace(fit, shape=one.shape), moved)
            one.shape = fit.shape
        if best is None or fit.cost < best[0].cost:
            best = fit, moved, one.shape
        if attempt == problem.settings.passes:
            break
        part, c = fit.part, fit.coefficients
        moved = motions(problem, part)
        # In a closed loop the motor's torque is not in the record.
        if law.effect.c.holding != ffi.NULL and np.any(c != 0) and not problem.closed_loop:
            moved = [stuck(problem, law, one.shape, c, motion) for motion in moved]
        if len(law.shapes) == 1:
            scan = Scan(problem, fit, moved)
            totals = [c @ t for t in lines]
            without = torque_columns(problem, part, [t[None, :] for t in totals])[:, 0]
            rest = scan.freed(fit.error - without)
            one.bracket = _around(one)
            one.gain = float(scan.torque_gains(law, one.shape[None, :], rest)[0][0])
            refine_shape(scan, one, rest)
    one.fit, moved, one.shape = best
    n = len(null.part.names)
    judged = one.fit.coefficients
    if law.own_phases:
        one.fit, level = _with_one_level(one.fit, n)
        judged = np.array([level])
    one.coefficients = one.fit.coefficients
    jacobian = one.fit.jacobian
    if len(law.shapes) == 1:

        def error_at(shape: np.ndarray) -> np.ndarray:
            lines = [one.coefficients @ t[0] for t in torque_lines(law, shape[None, :], problem, moved)]
            return torque_columns(problem, one.fit.part, [t[None, :] for t in lines])[:, 0]

        jacobian = np.hstack([jacobian, _shape_slopes(one, error_at)])
    kept = keep_out(problem, one.fit, jacobian, len(judged), judged, n)
    one.kept, one.scatter, one.scatter_error = kept


def _with_one_level(fit: LinearFit, first: int) -> tuple[LinearFit, float]:
    """A fit with a phase of each record's own, with one level for all, and this level.

    The derivatives by sine and cosine become those by the level and by the phases: what is kept out of a
    record is its level.
    """
    pairs = fit.coefficients.reshape(-1, 2)
    columns = fit.jacobian[:, first : first + pairs.size].reshape(len(fit.error), -1, 2)
    levels = np.hypot(*pairs.T)
    direction = pairs / np.where(levels > 0, levels, 1.0)[:, None]
    by_level = np.einsum("nrk,rk->nr", columns, direction)
    by_phase = columns[:, :, 1] * direction[:, 0] - columns[:, :, 0] * direction[:, 1]
    power = np.sum(by_level**2, axis=0)
    level = float(power @ levels / np.sum(power)) if np.any(power > 0) else 0.0
    equal = level * direction
    error = fit.error + columns.reshape(len(fit.error), -1) @ (equal - pairs).ravel()
    parts = [
        fit.jacobian[:, :first],
        by_level.sum(axis=1, keepdims=True),
        level * by_phase,
        fit.jacobian[:, first + pairs.size :],
    ]
    return replace(fit, coefficients=equal.ravel(), error=error, jacobian=np.hstack(parts)), level


def _with_shape(problem: Problem, one: Candidate, fit: LinearFit, moved: Sequence[Motion]) -> LinearFit:
    """Fit several shapes together with all else: their best values depend on each other's."""
    law, free = one.law, np.full(one.law.n_columns, np.inf)
    ends = np.concatenate([law.lower, one.ends[:, 0]]), np.concatenate([free, one.ends[:, 1]])

    def torques_of(shape: np.ndarray) -> list[np.ndarray]:
        return [t[0] for t in torque_lines(law, shape[None, :], problem, moved)]

    return fit_with_shape(problem, fit, torques_of, ends)


def stuck(problem: Problem, law: Law, shape: np.ndarray, c: np.ndarray, motion: Motion) -> Motion:
    """The motion with the direction of dry friction where the axis may stand still.

    The sign of the measured rate is noise there. The friction is what holds the axis: the torque of the motor
    less those of damping and springs, as far as its level reaches (Karnopp 1985).

    Parameters
    ----------
    problem : Problem
    law : Law
    shape : (d,) ndarray
    c : (c,) ndarray
        Coefficients.
    motion : Motion
    """
    still = np.abs(motion.rate) < problem.settings.stuck * motion.rate_std
    forward = replace(motion, side=np.ones(len(motion.rate)))
    level = np.abs(c @ torques(law, law.unit_values(shape), forward, problem.radians))
    held = np.clip(motion.drive / np.where(level > 0, level, np.inf), -1, 1)
    return replace(motion, side=np.where(still, held, motion.side))
