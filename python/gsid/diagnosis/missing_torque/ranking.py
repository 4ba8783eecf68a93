"""Scan of all laws beside the linear part.

The whitened error of the null is freed of the linear part's tangent. A law's gain is what its columns, freed
of it too, explain of the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize, nnls

from gsid.base.threads import in_parallel
from gsid.diagnosis.missing_torque.catalogue import family as effect_family
from gsid.diagnosis.missing_torque.law_columns import (
    Law,
    command_lines,
    dissipated,
    torque_lines,
)
from gsid.diagnosis.missing_torque.linear_fit import (
    LinearFit,
    ModeScan,
    basis,
)
from gsid.diagnosis.missing_torque.motion import Motion
from gsid.diagnosis.missing_torque.problem import LinearPart, Problem
from gsid.effects.types import EffectType

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
    others : tuple of LinearPart
        Further starts of a linear effect's fit.
    fit : LinearFit or None
        Joint fit; None if it was not refitted.
    kept : float
        Kept-out cost per whitened number; 1 is noise.
    coefficients : (c,) ndarray
        Of the joint fit.
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
    others: tuple[LinearPart, ...] = ()
    fit: LinearFit | None = None
    kept: float = np.inf
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros(0))
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
        found = [solved(each, -error, law.lower) for each in columns]
        return np.array([gain for gain, _ in found]), np.array([c for _, c in found])

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


def solved(columns: np.ndarray, target: np.ndarray, lower: np.ndarray) -> tuple[float, np.ndarray]:
    """Gain and coefficients of columns for a target.

    Parameters
    ----------
    columns : (c, n_rows) ndarray
    target : (n_rows,) ndarray
    lower : (c,) ndarray
        Least coefficients: 0 or none.
    """
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
    scanned = in_parallel(
        lambda law: _best_of_grid(scan, law, scales, error), laws, size=lambda law: len(law.points(scales))
    )
    found = [one for one in scanned if one is not None]
    most = max((one.gain for one in found), default=0.0)
    close = [one for one in found if one.gain >= scan.problem.settings.refined_share * most]
    in_parallel(lambda one: refine_shape(scan, one, error), close)
    return sorted(found, key=lambda one: -one.gain)


def _best_of_grid(scan: Scan, law: Law, scales: dict[str, float], error: np.ndarray) -> Candidate | None:
    """A law with the best shape of its grid.

    None where over this travel every shape is a spring, or beyond its bounds.
    """
    points = law.points(scales)
    if len(points) and law.effect.c.has_memory:
        points = points[is_dissipative(law, points, scan.problem, scan.moved)]
    if not len(points):
        return None
    if law.is_command:
        if law.shapes[0].grid.spacing == "rounding":
            points = _likely_steps(scan, points, error)
        gains = scan.command_gains(law, points, error)
    else:
        gains, _ = scan.torque_gains(law, points, error)
    best = int(np.argmax(gains))
    ends = _neighbours(points, points[best])
    one = Candidate(law.name, law.family, law.effect, float(gains[best]), law, points[best], ends)
    one.ends = np.stack([_twice(points.min(axis=0)), 2 * points.max(axis=0)], axis=1)
    return one


def is_dissipative(law: Law, shapes: np.ndarray, problem: Problem, moved: Sequence[Motion]) -> np.ndarray:
    """Whether a law with memory is a friction, and not a spring.

    Parameters
    ----------
    law : Law
    shapes : (n, d) ndarray
    problem : Problem
    moved : sequence of Motion

    Returns
    -------
    (n,) bool ndarray
    """
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
MANY_LINES = 40.0  # on which changes are as large as each other: with fewer their sizes differ by chance


def _likely_steps(scan: Scan, steps: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Steps of rounding whose change of the command is most like the one that the error asks for.

    The product of a change with the error is a sum over samples. Its norm is that of a uniform error, in
    proportion to the step. At a sharp resonance a few lines have nearly all weight, and norms differ by
    chance: more steps are kept, as many times as lines are too few.
    """
    sizes = steps[:, 0]
    p = scan.problem
    held = p.responses(scan.fit.part)
    complex_error = (error[: p.n_rows // 2] + 1j * error[p.n_rows // 2 :]).conj()
    at, total, n_kept = 0, np.zeros(len(steps)), LIKELY
    for r in p.records:
        size = held[r.group][0] * r.weight
        n_kept = max(n_kept, math.ceil(LIKELY * MANY_LINES / _n_effective(np.abs(size) ** 2)))
        wanted = -complex_error[at : at + len(r.line)] * size
        at += len(r.line)
        whole = np.zeros(r.spectra.period_samples // 2 + 1, complex)
        whole[r.line] = wanted.conj()
        asked = np.fft.irfft(whole, r.spectra.period_samples)
        total += changes_by_rounding(r.command, asked, sizes)
    likeness = -total / sizes
    return np.sort(steps[np.argsort(likeness)[-n_kept:]], axis=0)


HARMONICS = 8  # of the saw tooth of the rounding error: they have 93 % of its power
BINS = 2**16  # of a command


def changes_by_rounding(x: np.ndarray, weights: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Sums of weights times what rounding to whole steps changes of x, one for each step, (s,); about.

    The change is a saw tooth of x whose period is the step. With steps whose inverses are equally spaced, one
    Fourier transform of the weights over x has the harmonics of all of them.

    Parameters
    ----------
    x, weights : (n,) ndarray
    steps : (s,) ndarray
        Positive; their inverses are whole multiples of their distance.
    """
    cycles = np.diff(np.sort(1 / steps)).min(initial=1 / steps[0])  # in one unit of the command
    at = np.floor(x * cycles * BINS + 0.5).astype(int) % BINS
    lines = np.fft.rfft(np.bincount(at, weights, minlength=BINS))
    first = np.rint(1 / steps / cycles).astype(int)
    total = np.zeros(len(steps))
    for k in range(1, HARMONICS + 1):
        known = k * first < len(lines)
        total[known] -= (-1) ** k * lines[k * first[known]].imag / (math.pi * k)
    return steps * total


def _n_effective(power: np.ndarray) -> float:
    """Number of lines of equal power whose sum varies as much as this one."""
    return float(np.sum(power) ** 2 / np.sum(power**2))


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
    """Largest gain inside a bracket, whose size is the unit of each value; one without neighbours stays."""
    low, size = bracket[:, 0], np.ptp(bracket, axis=1)
    if not np.all(size > 0):
        free = np.flatnonzero(size > 0)
        if not len(free):
            return best

        def along(x: np.ndarray) -> np.ndarray:
            shape = best[0].copy()
            shape[free] = x
            return shape

        x, most = _simplex(lambda x: gain(along(x)), bracket[free], (best[0][free], best[1]), steps)
        return along(x), most
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
            found.append(_mode_candidate(scan, effect, scales))
        else:
            found.append(_linear_candidate(scan, effect, scales, error))
    return found


def _enlarged(part: LinearPart, effect: EffectType, params: dict[str, float]) -> LinearPart:
    n_alike = sum(label.partition("#")[0] == effect.id for label in part.stack)
    label = f"{effect.id}#{n_alike + 1}" if n_alike else effect.id
    stack = part.stack | {label: params}
    names = (*part.names, *(f"{label}.{name}" for name in params))
    least = [min(p.lower, p.null_value) if p.null_value is not None else p.lower for p in effect.parameters]
    lower = np.concatenate([part.lower, least])
    upper = np.concatenate([part.upper, [p.upper for p in effect.parameters]])
    return LinearPart(stack, names, lower, upper)


def mode_start(
    problem: Problem, part: LinearPart, effect: EffectType, scales: dict[str, float]
) -> LinearPart:
    """A linear part with the further mode that explains most beside a small change of the part's values.

    Parameters
    ----------
    problem : Problem
    part : LinearPart
        With values that were not fitted.
    effect : EffectType
        The mode.
    scales : dict of float
    """
    modes = ModeScan(problem, part, basis(problem.tangent(part, problem.commands)))
    _, start = _best_mode(modes, problem, part, effect, scales)
    return start


def _mode_candidate(scan: Scan, effect: EffectType, scales: dict[str, float]) -> Candidate:
    modes = ModeScan(scan.problem, scan.fit.part, scan.q, scan.fit.error)
    gain, start = _best_mode(modes, scan.problem, scan.fit.part, effect, scales)
    return Candidate(effect.id, effect_family(effect), effect, gain, start=start)


def _best_mode(
    modes: ModeScan, problem: Problem, part: LinearPart, effect: EffectType, scales: dict[str, float]
) -> tuple[float, LinearPart]:
    """The largest gain, and the part with this mode; typical values if none explains anything."""
    f_hz = effect["f_hz"].grid
    first, last = f_hz.first * scales[f_hz.of], f_hz.last * scales[f_hz.of]
    settings = problem.settings
    lowest = min(first, settings.mode_lowest * problem.first[0].f_hz[0])
    n_points = settings.mode_points * np.log(last / lowest) / np.log(last / first)
    first, frequencies = lowest, np.geomspace(lowest, last, int(n_points))
    gain, start = 0.0, _enlarged(part, effect, {p.name: p.typical for p in effect.parameters})
    for zeta in effect["zeta"].grid.points:
        found = modes.best(frequencies, zeta)
        if found.gain > gain:
            params = {"f_hz": found.f_hz, "zeta": zeta, "residue": found.residue}
            gain, start = found.gain, _enlarged(part, effect, params)
            # The given damping is in the grid: a mode beyond the band, or without damping, is another law.
            start.lower[-3], start.upper[-3] = first, last
            start.lower[-2] = 0.2 * min(effect["zeta"].grid.points)
    return gain, start


def _linear_candidate(
    scan: Scan, effect: EffectType, scales: dict[str, float], error: np.ndarray
) -> Candidate:
    """A linear effect of one value: of a few finite values and the tangent at none, what explains most.

    The tangent of a lag is that of a delay but for what is small: its value is one of the finite ones.
    """
    (parameter,) = effect.parameters
    small = 1e-4 * parameter.typical
    column = _change(scan, with_linear(scan.fit.part, effect, small)) / small
    most, c = solved(column[None, :], -error, np.array([parameter.lower]))
    starts = [(most, with_linear(scan.fit.part, effect, float(c[0])))] if effect.linear_part != "lag" else []
    for point in _linear_points(scan, effect, scales):
        larger = with_linear(scan.fit.part, effect, float(point))
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


def with_linear(part: LinearPart, effect: EffectType, value: float) -> LinearPart:
    """The part with a linear effect of one value; the delay is reduced by what a lag delays.

    Parameters
    ----------
    part : LinearPart
    effect : EffectType
    value : float
        Of its first parameter.
    """
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
