"""Scan of all laws beside the linear part, and joint refit of the best.

The whitened error of the null is freed of the linear part's tangent. A law's gain is what its columns, freed
of it too, explain of the rest. The best laws are fitted together with the linear part. What is kept out is
one realisation after the other: fitted to the others, linearised, and judged on the one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize, nnls

from gsid._lib import ffi
from gsid.diagnosis.missing_torque.catalogue import family as effect_family
from gsid.diagnosis.missing_torque.law_columns import (
    Law,
    command_lines,
    dissipated,
    mapped,
    torque_lines,
    torques,
)
from gsid.diagnosis.missing_torque.linear_fit import (
    LinearFit,
    LinearPart,
    Problem,
    basis,
    fit_linear_part,
    fit_with_shape,
    mode_columns,
    torque_columns,
)
from gsid.diagnosis.missing_torque.motion import Motion, motions
from gsid.effects.types import EffectType

BOUND = 1e-3  # of the largest coefficient: a smaller one is at its bound
GOLDEN = 0.381966  # 1 - 1 / golden ratio


@dataclass(eq=False)
class Candidate:
    """One law with the linear part.

    Attributes
    ----------
    name, family : str
    effect : EffectType
    gain : float
        Drop of the cost in the scan.
    law : Law or None
        None: a linear effect, which is in the linear part.
    shape : (d,) ndarray
        Values of the law's shapes.
    bracket : (d, 2) ndarray
        Between these values each of them is refined.
    ends : (d, 2) ndarray
        Largest range of several shapes: twice that of the grid.
    fit : LinearFit or None
        Joint fit; None if it was not refitted.
    kept : float
        Kept-out cost per whitened number; 1 is noise.
    coefficients, errors : (c,) ndarray
        Of the joint fit, and their standard errors.
    scatter, scatter_error : float
        Scatter of the coefficient over realisations, relative to it, and what noise makes of it.
    """

    name: str
    family: str
    effect: EffectType
    gain: float
    law: Law | None = None
    shape: np.ndarray = field(default_factory=lambda: np.zeros(0))
    bracket: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    ends: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    start: LinearPart | None = None
    points: tuple[float, ...] = ()
    fit: LinearFit | None = None
    kept: float = np.inf
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros(0))
    errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    scatter: float = np.inf
    scatter_error: float = 0.0

    @property
    def along_motion(self) -> bool:
        """Whether its column comes from the measured motion, whose errors it has."""
        return self.law is not None and not self.law.is_command

    @property
    def cost(self) -> float:
        """Sum of squares of the joint fit's whitened error."""
        return self.fit.cost if self.fit is not None else np.inf

    @property
    def n_parameters(self) -> int:
        """Numbers that it adds to the linear part."""
        return self.law.n_parameters if self.law is not None else len(self.effect.parameters)

    @property
    def params(self) -> dict[str, float]:
        """Values of the effect's parameters: starts of a fit by simulation."""
        if self.law is not None:
            if self.law.is_command:
                return {self.effect.parameters[0].name: float(self.shape[0])}
            return self.law.params(self.shape, self.coefficients)
        label = next(label for label in reversed(self.fit.part.stack) if label.startswith(self.effect.id))
        return dict(self.fit.part.stack[label])


# ---- scan ----------------------------------------------------------------------------------------------


class Scan:
    """Gains of laws beside a fitted linear part.

    Parameters
    ----------
    problem : Problem
    fit : LinearFit
        Of the linear part alone, or with a law whose shape is to be refined.
    moved : sequence of Motion
    """

    def __init__(self, problem: Problem, fit: LinearFit, moved: Sequence[Motion]) -> None:
        self.problem, self.fit, self.moved = problem, fit, moved
        self.q = basis(fit.jacobian[:, : len(fit.part.names)])
        self.entries = problem.responses(fit.part)

    def freed(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n_rows, ...) without what the tangent of the linear part can do."""
        return columns - self.q @ (self.q.T @ columns)

    def torque_gains(self, law: Law, shapes: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gains (s,) and coefficients (s, c) of a torque law.

        Parameters
        ----------
        law : Law
        shapes : (s, d) ndarray
        error : (n_rows,) ndarray
            What is left without the law, freed.
        """
        p = self.problem
        lines = torque_lines(law, shapes, p, self.moved)
        seen = [self.entries[r.group][1] * t for r, t in zip(p.records, lines, strict=True)]
        columns = p.whiten(seen)  # (s, c, n_rows)
        flat = columns.reshape(-1, p.n_rows).T
        flat = self.freed(flat)
        columns = flat.T.reshape(columns.shape)
        solved = [_solved(each, -error, law.lower) for each in columns]
        return np.array([gain for gain, _ in solved]), np.array([c for _, c in solved])

    def command_gains(self, law: Law, shapes: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Gains (s,) of a map of the command; its coefficient is 1.

        Parameters
        ----------
        law, shapes, error
            As `torque_gains`.
        """
        p = self.problem
        commands = command_lines(law, shapes, p)
        held = p.responses(self.fit.part, p.settings.images)
        changes = [-held[r.group][0] * (u - r.U) for r, u in zip(p.records, commands, strict=True)]
        left = error[:, None] + self.freed(p.whiten(changes).T)
        return error @ error - np.sum(left**2, axis=0)


def _solved(columns: np.ndarray, target: np.ndarray, lower: np.ndarray) -> tuple[float, np.ndarray]:
    """Gain and coefficients of columns (c, n_rows) for a target, with their least values."""
    size = np.linalg.norm(columns, axis=1)
    if not np.all(size > 0):
        return 0.0, np.zeros(len(columns))
    unit = columns / size[:, None]
    right = unit @ target
    if len(columns) == 1:
        c = right if right[0] >= 0 or lower[0] < 0 else np.zeros(1)
        return float(c[0] ** 2), c / size
    gram = unit @ unit.T
    if np.all(lower < 0):
        c = np.linalg.lstsq(gram, right, rcond=1e-10)[0]
    else:
        half = np.linalg.cholesky(gram + 1e-10 * np.eye(len(gram)))
        c = nnls(half.T, np.linalg.solve(half, right))[0]
    return float(2 * c @ right - c @ gram @ c), c / size


def scan_laws(scan: Scan, laws: Sequence[Law], scales: dict[str, float]) -> list[Candidate]:
    """The best shape of each law on its grid, largest gain first.

    Parameters
    ----------
    scan : Scan
    laws : sequence of Law
    scales : dict of float
        The quantities that grids are relative to.
    """
    error = scan.freed(scan.fit.error)
    found = []
    for law in laws:
        points = law.points(scales)
        if law.effect.c.has_memory:
            points = points[_is_dissipative(law, points, scan.problem, scan.moved)]
        if law.is_command:
            if law.shapes[0].grid.spacing == "rounding":
                points = _likely_steps(scan, law, points, error)
            gains = scan.command_gains(law, points, error)
        else:
            gains, _ = scan.torque_gains(law, points, error)
        best = int(np.argmax(gains))
        ends = _neighbours(points, points[best])
        one = Candidate(law.name, law.family, law.effect, float(gains[best]), law, points[best], ends)
        one.ends = np.stack([_twice(points.min(axis=0)), 2 * points.max(axis=0)], axis=1)
        found.append(one)
    found.sort(key=lambda one: -one.gain)
    most = found[0].gain if found else 0.0
    for one in found:
        if one.gain >= scan.problem.settings.refined_share * most:
            refine_shape(scan, one, error)
    return sorted(found, key=lambda one: -one.gain)


def _is_dissipative(law: Law, shapes: np.ndarray, problem: Problem, moved: Sequence[Motion]) -> np.ndarray:
    """Whether a law with memory is a friction, (shapes,) bool, and not a spring."""
    return dissipated(law, shapes, moved[0], problem.radians) >= problem.settings.dissipated_least


def _twice(least: np.ndarray) -> np.ndarray:
    return np.where(least < 0, 2 * least, least / 2)


def _neighbours(points: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Neighbours in the grid of each value of a shape, (d, 2)."""
    found = np.zeros((points.shape[1], 2))
    for k, value in enumerate(best):
        axis = np.unique(points[:, k])
        i = int(np.searchsorted(axis, value))
        found[k] = axis[max(i - 1, 0)], axis[min(i + 1, len(axis) - 1)]
    return found


LIKELY = 12  # steps of rounding whose gain is computed


def _likely_steps(scan: Scan, law: Law, steps: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Steps of rounding whose change of the command is most like the one that the error asks for.

    The product of a change with the error is a sum over samples: no transform is needed. Its norm is that of
    a uniform error, in proportion to the step.
    """
    p = scan.problem
    held = p.responses(scan.fit.part)
    complex_error = (error[: p.n_rows // 2] + 1j * error[p.n_rows // 2 :]).conj()
    at, total = 0, np.zeros(len(steps))
    for r in p.records[:2]:
        wanted = -complex_error[at : at + len(r.line)] * held[r.group][0] * r.weight
        at += len(r.line)
        whole = np.zeros(r.spectra.period_samples // 2 + 1, complex)
        whole[r.line] = wanted.conj()
        asked = np.fft.irfft(whole, r.spectra.period_samples)
        for some in np.array_split(np.arange(len(steps)), max(len(steps) // 50, 1)):
            total[some] += (mapped(law, steps[some], r.command) - r.command) @ asked
    likeness = -total / steps[:, 0]
    return np.sort(steps[np.argsort(likeness)[-LIKELY:]], axis=0)


def refine_shape(scan: Scan, one: Candidate, error: np.ndarray) -> None:
    """Refine a candidate's shape between its neighbours in the grid; in place.

    One value by golden section, two by Nelder and Mead's simplex.

    Parameters
    ----------
    scan : Scan
    one : Candidate
    error : (n_rows,) ndarray
        What is left without the law, freed.
    """
    law, steps = one.law, scan.problem.settings.shape_steps
    if law is None or not law.shapes:
        return

    def gain(shape: np.ndarray) -> float:
        if law.is_command:
            return float(scan.command_gains(law, shape[None, :], error)[0])
        return float(scan.torque_gains(law, shape[None, :], error)[0][0])

    if len(law.shapes) == 1:
        best = float(one.shape[0]), one.gain
        shape, one.gain = _golden(lambda x: gain(np.array([x])), tuple(one.bracket[0]), best, steps)
        one.shape = np.array([shape])
    else:
        one.shape, one.gain = _simplex(gain, one.bracket, (one.shape, one.gain), steps)


def _simplex(
    gain: Callable[[np.ndarray], float], bracket: np.ndarray, best: tuple[np.ndarray, float], steps: int
) -> tuple[np.ndarray, float]:
    """Largest gain inside a bracket, whose size is the unit of each value."""
    low, size = bracket[:, 0], np.ptp(bracket, axis=1)
    start = (best[0] - low) / size
    towards = np.where(start < 0.5, 0.3, -0.3)  # into the bracket
    found = minimize(
        lambda x: -gain(low + x * size),
        start,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(low),
        options={
            "initial_simplex": np.vstack([start, start + np.diag(towards)]),
            "maxfev": 4 * steps,
            "xatol": 1e-3,
            "fatol": 1e-6 * best[1],
        },
    )
    return max([best, (low + found.x * size, float(-found.fun))], key=lambda each: each[1])


def _golden(
    gain: Callable[[float], float], bracket: tuple[float, float], best: tuple[float, float], steps: int
) -> tuple[float, float]:
    low, high = bracket
    a, b = low + GOLDEN * (high - low), high - GOLDEN * (high - low)
    at_a, at_b = gain(a), gain(b)
    for _ in range(steps):
        if at_a > at_b:
            high, b, at_b = b, a, at_a
            a = low + GOLDEN * (high - low)
            at_a = gain(a)
        else:
            low, a, at_a = a, b, at_b
            b = high - GOLDEN * (high - low)
            at_b = gain(b)
    return max([best, (a, at_a), (b, at_b)], key=lambda each: each[1])


def linear_candidates(scan: Scan, effects: Sequence[EffectType], scales: dict[str, float]) -> list[Candidate]:
    """Linear effects that the model lacks, each with the start of its fit.

    Parameters
    ----------
    scan : Scan
    effects : sequence of EffectType
    scales : dict of float
    """
    found = []
    error = scan.freed(scan.fit.error)
    for effect in effects:
        if effect.linear_part == "mode":
            found.append(_mode_candidate(scan, effect, scales, error))
        else:
            found.append(_linear_candidate(scan, effect, scales, error))
    return found


def _enlarged(part: LinearPart, effect: EffectType, params: dict[str, float]) -> LinearPart:
    label = effect.id if effect.id not in part.stack else f"{effect.id}#2"
    stack = part.stack | {label: params}
    names = (*part.names, *(f"{label}.{name}" for name in params))
    least = [min(p.lower, p.null_value) if p.null_value is not None else p.lower for p in effect.parameters]
    lower = np.concatenate([part.lower, least])
    upper = np.concatenate([part.upper, [p.upper for p in effect.parameters]])
    return LinearPart(stack, names, lower, upper)


def _mode_candidate(scan: Scan, effect: EffectType, scales: dict[str, float], error: np.ndarray) -> Candidate:
    f_hz = effect["f_hz"].grid
    first, last = f_hz.first * scales[f_hz.of], f_hz.last * scales[f_hz.of]
    frequencies = np.geomspace(first, last, scan.problem.settings.mode_points)
    best = Candidate(effect.id, effect_family(effect), effect, 0.0)
    for zeta in effect["zeta"].grid.points:
        columns = scan.freed(mode_columns(scan.problem, scan.fit.part, frequencies, zeta))
        products = error @ columns
        share = products / np.sum(columns**2, axis=0)
        i = int(np.argmax(share * products))
        if share[i] * products[i] > best.gain:
            params = {"f_hz": float(frequencies[i]), "zeta": zeta, "residue": float(-share[i])}
            start = _enlarged(scan.fit.part, effect, params)
            # The given damping is in the grid: a mode beyond the band, or without damping, is another law.
            start.lower[-3], start.upper[-3] = first, last
            start.lower[-2] = 0.2 * min(effect["zeta"].grid.points)
            best = Candidate(
                effect.id, effect_family(effect), effect, float(share[i] * products[i]), start=start
            )
    if best.start is None:
        best.start = _enlarged(scan.fit.part, effect, {p.name: p.typical for p in effect.parameters})
    return best


def _linear_candidate(
    scan: Scan, effect: EffectType, scales: dict[str, float], error: np.ndarray
) -> Candidate:
    """A linear effect of one value: of a few finite values and the tangent at none, what explains most.

    The tangent of a lag is that of a delay but for what is small: its value is one of the finite ones.
    """
    (parameter,) = effect.parameters
    small = 1e-4 * parameter.typical
    column = _change(scan, _with_linear(scan.fit.part, effect, small)) / small
    most, c = _solved(column[None, :], -error, np.array([parameter.lower]))
    starts = [(most, _with_linear(scan.fit.part, effect, float(c[0])))] if effect.linear_part != "lag" else []
    for point in _linear_points(scan, effect, scales):
        larger = _with_linear(scan.fit.part, effect, float(point))
        left = error + _change(scan, larger)
        starts.append((float(error @ error - left @ left), larger))
    gain, start = max(starts, key=lambda each: each[0])
    tried = tuple(_linear_points(scan, effect, scales))
    return Candidate(effect.id, effect_family(effect), effect, max(gain, most), start=start, points=tried)


def _linear_points(scan: Scan, effect: EffectType, scales: dict[str, float]) -> np.ndarray:
    grid = effect.parameters[0].grid
    if grid is not None:
        return grid.at(scales[grid.of])
    if effect.linear_part == "delay":
        return scales["sample"] * np.array(scan.problem.settings.missing_delays)
    corner = 2 * np.pi * scan.problem.first[0].f_hz[0] * np.array(scan.problem.settings.corners)
    if effect.linear_part in ("spring", "damping"):
        return corner**2 if effect.linear_part == "spring" else corner
    return np.zeros(0)


def _with_linear(part: LinearPart, effect: EffectType, value: float) -> LinearPart:
    """The part with a linear effect of one value; the delay is reduced by what a lag delays."""
    larger = _enlarged(part, effect, {effect.parameters[0].name: value})
    name = "transport_delay.delay_s"
    if effect.linear_part != "lag" or name not in part.names:
        return larger
    values = larger.values
    i = larger.names.index(name)
    values[i] = max(values[i] - value, 0.0)
    return larger.at(values)


def _change(scan: Scan, larger: LinearPart) -> np.ndarray:
    """What another linear part changes of the freed error."""
    p = scan.problem
    there = p.responses(larger)
    changes = [-(there[r.group][0] - scan.entries[r.group][0]) * r.U for r in p.records]
    return scan.freed(p.whiten(changes))


# ---- joint refit ---------------------------------------------------------------------------------------


def refit(
    problem: Problem, null: LinearFit, one: Candidate, moved: Sequence[Motion], given: LinearPart
) -> None:
    """Fit a candidate together with the linear part, and judge it on what is kept out; in place.

    A law that has become another one stays without a fit: one with memory that dissipates nothing is a
    spring, and Stribeck's without its level or its extra is not Stribeck's.

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
    return bool(law.effect.c.has_memory) and not _is_dissipative(law, one.shape[None, :], problem, moved)[0]


def _refit_linear(problem: Problem, null: LinearFit, one: Candidate, given: LinearPart) -> None:
    good = problem.settings.good_cost
    one.fit = fit_linear_part(problem, one.start)
    if null.cost_per_dof > good:
        for point in one.points:
            if one.fit.cost_per_dof <= good:
                break
            again = fit_linear_part(problem, _with_linear(given, one.effect, point))
            one.fit = min(one.fit, again, key=lambda fit: fit.cost)
    one.coefficients = one.fit.part.values[len(null.part.names) :]
    one.kept, one.scatter, one.scatter_error = keep_out(problem, one.fit, one.fit.jacobian, 1)


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


# ---- kept out ------------------------------------------------------------------------------------------


def keep_out(
    problem: Problem,
    fit: LinearFit,
    jacobian: np.ndarray,
    n_coefficients: int,
    coefficients: np.ndarray | None = None,
    first: int | None = None,
) -> tuple[float, float, float]:
    """Kept-out cost, scatter of the coefficient over realisations, and its standard error.

    One realisation after the other is left out of the fit, linearised at the fit to all. Of a single record
    thirds of its periods are left out.

    Parameters
    ----------
    problem : Problem
    fit : LinearFit
    jacobian : (n_rows, m) ndarray
        With the derivative by the shape.
    n_coefficients : int
    coefficients : (n_coefficients,) ndarray, optional
        Their values; default the last of the linear part.
    first : int, optional
        Their first column; default the last ones.
    """
    n = jacobian.shape[1]
    first = n - n_coefficients if first is None else first
    chosen = np.arange(first, first + n_coefficients)
    values = fit.part.values[-n_coefficients:] if coefficients is None else coefficients
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(size > 0, size, 1.0)
    parts = _parts(problem, fit.error, scaled)
    total = sum(gram for gram, _, _, _ in parts)
    right = sum(slope for _, slope, _, _ in parts)
    squares, alone, errors = 0.0, [], []
    for gram, slope, rows, error in parts:
        moved = -_solve(total - gram, right - slope)
        squares += float(np.sum((error + rows @ moved) ** 2))
        alone.append(values - _solve(gram, slope)[chosen] / size[chosen])
        variances = np.maximum(np.diag(np.linalg.pinv(gram)), 0.0)  # rounding may leave them below 0
        errors.append(np.sqrt(variances)[chosen] / size[chosen])
    n_rows = sum(len(error) for *_, error in parts)
    norm = float(np.linalg.norm(values)) or np.inf
    spread = np.linalg.norm(np.std(alone, axis=0)) / norm
    noise = np.linalg.norm(np.sqrt(np.mean(np.square(errors), axis=0))) / norm
    return squares / n_rows, float(spread), float(noise)


def _parts(
    problem: Problem, error: np.ndarray, jacobian: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Normal equations, rows and error of each realisation; of a single record those of thirds.

    The thirds are those of its periods, or those of its lines where a model error is left.
    """
    if len(problem.records) > 1:
        found = []
        for i in range(len(problem.records)):
            rows = problem.rows_of(i)
            found.append(_normal(jacobian[rows], error[rows]))
        return found
    (record,) = problem.records
    if problem.has_model_error:
        # It is the same in all periods: the lines are what is independent.
        of = np.tile(np.arange(len(record.line)) % 3, 2)
        return [_normal(jacobian[of == i], error[of == i]) for i in range(3)]
    thirds = np.array_split(record.spectra.Y[:, record.line], min(3, record.spectra.n_periods))
    found = []
    for third in thirds:
        weight = np.sqrt(len(third) / record.spectra.n_periods)  # of noise that is larger
        change = problem.whiten([third.mean(axis=0) - record.Y])
        found.append(_normal(weight * jacobian, weight * (error + change)))
    return found


def _normal(rows: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return rows.T @ rows, rows.T @ error, rows, error


def _solve(gram: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(gram, right, rcond=1e-12)[0]
