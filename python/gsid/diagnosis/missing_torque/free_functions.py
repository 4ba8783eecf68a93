"""Free functions as rivals of a law from outside the catalogue.

The catalogue cannot list all laws. A smooth function of the angle, of the rate or of the command, or a
friction or a damping that varies over the angle, is therefore fitted beside the best law, linearised at its
fit. If such a function explains much of what the law leaves, the missing law is another one of that
coordinate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import rfft
from scipy.interpolate import BSpline

from gsid._lib import ffi
from gsid.diagnosis.missing_torque.law_columns import Law, torques
from gsid.diagnosis.missing_torque.linear_fit import LinearFit, basis, torque_columns
from gsid.diagnosis.missing_torque.motion import Motion, motions
from gsid.diagnosis.missing_torque.problem import Problem
from gsid.diagnosis.missing_torque.ranking import Candidate
from gsid.diagnosis.missing_torque.refit import stuck

Signals = Callable[[Motion], np.ndarray]
STEP_OF_ANGLE = 1e-3  # of the travel, of a derivative by the mean angle
HARMONICS = (0.5, 2.0, 3.0, 4.0, 5.0)  # of a periodic law


@dataclass(frozen=True)
class FreeFunction:
    """A free function beside the best law.

    Attributes
    ----------
    name : str
        What it is a function of.
    family : str
        Of the law.
    share : float
        Share that it explains, linearised, of what the law leaves above noise.
    of_misfit : float
        The same of the misfit without the law.
    price : float
        Drop of the cost over what its numbers cost, ln n each.
    """

    name: str
    family: str
    share: float
    of_misfit: float
    price: float


def beside(problem: Problem, null: LinearFit, best: Candidate) -> list[FreeFunction]:
    """Free functions beside the best law, each with its drop of the cost.

    Parameters
    ----------
    problem : Problem
    null : LinearFit
        The linear part alone.
    best : Candidate
        With its joint fit; a linear effect has no such rival.
    """
    if best.law is None:
        return []
    if best.law.is_command:
        columns, shifts = {"the command": _of_command(problem, best)}, np.zeros((problem.n_rows, 0))
    else:
        moved = _motions_of(problem, best)
        columns, shifts = _of_motion(problem, best, moved), _of_mean_angles(problem, best, moved)
    known = basis(np.hstack([best.fit.jacobian, shifts]))
    error = best.fit.error - known @ (known.T @ best.fit.error)
    n = problem.n_rows
    noise = n + 2 * math.sqrt(2 * n)  # with two standard deviations of a sum of n squares
    found = []
    for name, each in columns.items():
        free = basis(each - known @ (known.T @ each))
        gain = float(np.sum((free.T @ error) ** 2))
        scale = max((best.cost - gain) / n, 1.0)
        share, of_misfit = (gain / max(cost - noise, gain) for cost in (best.cost, null.cost))
        price = gain / scale / (free.shape[1] * math.log(n))
        found.append(FreeFunction(name, best.family, share, of_misfit, price))
    return found


def _motions_of(problem: Problem, best: Candidate) -> list[Motion]:
    """Motions of the law's own fit, with the direction of dry friction where the axis may stick."""
    moved = motions(problem, best.fit.part)
    if best.law.effect.c.holding == ffi.NULL or problem.closed_loop:
        return moved
    return [stuck(problem, best.law, best.shape, best.coefficients, motion) for motion in moved]


def _of_motion(problem: Problem, best: Candidate, moved: Sequence[Motion]) -> dict[str, np.ndarray]:
    n, few = problem.settings.free_functions, problem.settings.free_functions // 2
    own = len(moved) if not problem.has_mean_angle(best.fit.part) else 0
    along = smooth([m.angle for m in moved], n)
    fewer = smooth([m.angle for m in moved], few)
    over_rate = smooth([m.rate for m in moved], n)
    kinds: dict[str, tuple[Signals, int]] = {}
    if best.family == "position":
        kinds["the angle"] = lambda m: along(m.angle), own
        cycles = _cycles(best.law, best.shape, problem.radians)
        if cycles is not None:
            kinds["harmonics over the angle"] = lambda m: _waves(m.angle, cycles), own
    else:
        kinds["the rate"] = lambda m: np.vstack([over_rate(m.rate), m.side]), 0
    if best.family == "dry friction":
        kinds["friction over the angle"] = lambda m: m.side * fewer(m.angle), own
    if best.family == "drag":
        kinds["damping over the angle"] = lambda m: m.rate * fewer(m.angle), own
    return {name: _columns(problem, best, moved, *kind) for name, kind in kinds.items()}


def _cycles(law: Law, shape: np.ndarray, radians: float) -> float | None:
    """Angular frequency of a periodic law over the angle, whose only shape it is; None of another law."""
    return float(shape[0]) * radians if law.phase is not None and len(law.shapes) == 1 else None


def _waves(angle: np.ndarray, cycles: float) -> np.ndarray:
    return np.vstack([wave(h * cycles * angle) for h in HARMONICS for wave in (np.cos, np.sin)])


def smooth(signals: Sequence[np.ndarray], n: int) -> Callable[[np.ndarray], np.ndarray]:
    """Cubic splines over the range of signals.

    Parameters
    ----------
    signals : sequence of ndarray
    n : int
        Number of splines.

    Returns
    -------
    callable
        Of one signal, (n, ...).
    """
    low, high = min(x.min() for x in signals), max(x.max() for x in signals)
    inner = np.linspace(low, high, n - 2)
    knots = np.concatenate([[low] * 3, inner, [high] * 3])
    splines = BSpline(knots, np.eye(n), 3)
    return lambda x: splines(np.clip(x, low, high)).T


def _columns(
    problem: Problem, best: Candidate, moved: Sequence[Motion], signals: Signals, own: int
) -> np.ndarray:
    """(n_rows, functions) columns of torques along the motion; own: with one function for each record."""
    lines = []
    for i, (r, motion) in enumerate(zip(problem.records, moved, strict=True)):
        each = motion.lines(_without_linear(signals(motion), motion), r.line)
        if own:
            whole = np.zeros((own * len(each), len(r.line)), complex)
            whole[i * len(each) : (i + 1) * len(each)] = each
            each = whole
        lines.append(each)
    return torque_columns(problem, best.fit.part, lines)


def _of_mean_angles(problem: Problem, best: Candidate, moved: Sequence[Motion]) -> np.ndarray:
    """(n_rows, n_records) columns of a shift of each record's mean angle, where the records do not show it.

    A law that is not odd shifts the mean angle of an axis with a spring, in each record by another amount.
    """
    law, lines = best.law, []
    if problem.output_angle or law.own_phases or not law.effect.c.looks_at_angle:
        return np.zeros((problem.n_rows, 0))
    for i, (r, motion) in enumerate(zip(problem.records, moved, strict=True)):
        step = STEP_OF_ANGLE * float(np.ptp(motion.angle))
        ends = [replace(motion, angle=motion.angle + side * step) for side in (1, -1)]
        values = law.unit_values(best.shape)
        more, less = (best.coefficients @ torques(law, values, end, problem.radians) for end in ends)
        own = np.zeros((len(moved), len(r.line)), complex)
        own[i] = motion.lines((more - less) / (2 * step), r.line)
        lines.append(own)
    return torque_columns(problem, best.fit.part, lines)


def _without_linear(signals: np.ndarray, motion: Motion) -> np.ndarray:
    """Signals without a spring and a damping along the measured motion, whose noise would explain itself."""
    linear = np.stack([np.ones(len(motion.angle)), motion.angle, motion.rate])
    return signals - np.linalg.lstsq(linear.T, signals.T, rcond=None)[0].T @ linear


def _of_command(problem: Problem, best: Candidate) -> np.ndarray:
    over = smooth([r.command for r in problem.records], problem.settings.free_functions)
    entries = problem.responses(best.fit.part)
    answers = []
    for r in problem.records:
        lines = rfft(over(r.command))[:, r.line] * (2 / len(r.command))
        answers.append(entries[r.group][0] * lines)
    return problem.whiten(answers).T
