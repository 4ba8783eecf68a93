"""Fit of a plant's linear part to records, in the frequency domain and on all lines of the band."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from gsid.diagnosis.missing_torque.problem import (
    LinearPart,
    Problem,
    Responses,
    linear_kind,
    split,
)
from gsid.effects.ids import BODY, DAMPING, LAGS, SPRING

DELAY = "transport_delay.delay_s"
KnownFits = dict[tuple, "LinearFit"]  # by the hold of the records and the start
SAME_COST = 0.01  # relative difference of two costs that is no reason for a slow lag
ALIKE = 1e-6  # power of a column beside the tangent, over its own, below which it is one of the tangent
SHAPE_STEP = 1e-3  # relative step of the derivative by a shape: reversals lie between samples


@dataclass(frozen=True, eq=False)
class LinearFit:
    """A fit of the linear part, with torques or without.

    Attributes
    ----------
    part : LinearPart
    coefficients : (c,) ndarray
        Of the torque columns; empty without.
    error : (n_rows,) ndarray
        Whitened E.
    jacobian : (n_rows, n + c + d) ndarray
        Its derivative by the free values, the coefficients and the shape.
    shape : (d,) ndarray
        Of the torque columns; empty where it is not fitted.
    """

    part: LinearPart
    coefficients: np.ndarray
    error: np.ndarray
    jacobian: np.ndarray
    shape: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def cost(self) -> float:
        """Sum of squares of the whitened error."""
        return float(self.error @ self.error)

    @property
    def cost_per_dof(self) -> float:
        """The same per degree of freedom; 1 where only noise is left."""
        return self.cost / (self.jacobian.shape[0] - self.jacobian.shape[1])


def fit_linear_part(
    problem: Problem,
    start: LinearPart,
    commands: Sequence[np.ndarray] | None = None,
    torques: Sequence[np.ndarray] | None = None,
    first: np.ndarray | None = None,
    lower: np.ndarray | None = None,
) -> LinearFit:
    """Fit the free values of a linear part, and the coefficients of torque columns, by least squares.

    Parameters
    ----------
    problem : Problem
    start : LinearPart
        With the values to begin from.
    commands : sequence of (K,) complex ndarray, optional
        Default: as measured.
    torques : sequence of (c, K) complex ndarray, optional
        Lines of the torque of each record for a unit coefficient.
    first : (c,) ndarray, optional
        Coefficients to begin from; default 0.
    lower : (c,) ndarray, optional
        Least coefficients; default none.

    Returns
    -------
    LinearFit
    """
    given = problem.commands if commands is None else commands
    columns = torques or [np.zeros((0, len(r.line)), complex) for r in problem.records]
    n, n_columns = len(start.names), columns[0].shape[0]
    values = start.values
    c = np.zeros(n_columns) if first is None else np.array(first, float)
    scale = np.concatenate([np.where(values != 0, np.abs(values), 1.0), np.where(c != 0, np.abs(c), 1.0)])
    least = np.concatenate([start.lower, np.full(n_columns, -np.inf) if lower is None else lower])
    most = np.concatenate([_simulable(problem, start), np.full(n_columns, np.inf)])

    def total(coefficients: np.ndarray) -> list[np.ndarray] | None:
        return [coefficients @ t for t in columns] if n_columns else None

    def error(x: np.ndarray) -> np.ndarray:
        return problem.error(start.at(x[:n] * scale[:n]), given, total(x[n:] * scale[n:]))

    def jacobian(x: np.ndarray) -> np.ndarray:
        part = start.at(x[:n] * scale[:n])
        here = problem.responses(part)
        slopes = problem.tangent(part, given, total(x[n:] * scale[n:]), here)
        return np.hstack([slopes, torque_columns(problem, part, columns, here)]) * scale

    x0 = np.clip(np.concatenate([values, c]), least, most) / scale
    if not len(x0):
        return LinearFit(start, c, error(x0), np.zeros((problem.n_rows, 0)))
    ends = (least / scale, most / scale)
    found = least_squares(
        error,
        x0,
        jacobian,
        bounds=ends,
        x_scale="jac",
        ftol=problem.settings.tolerance,
        xtol=1e-9,
        gtol=1e-12,
        max_nfev=problem.settings.steps,
    )
    x = found.x * scale
    return LinearFit(start.at(x[:n]), x[n:], found.fun, found.jac / scale)


def _simulable(problem: Problem, part: LinearPart) -> np.ndarray:
    """Upper ends of the free values, with the longest delay that a simulation can have."""
    is_delay = np.array([name == DELAY for name in part.names], bool)
    longest = np.maximum(problem.longest_delay_s, part.lower)
    return np.where(is_delay, np.minimum(part.upper, longest), part.upper)


def fit_with_shape(
    problem: Problem,
    start: LinearFit,
    torques: Callable[[np.ndarray], list[np.ndarray]],
    ends: tuple[np.ndarray, np.ndarray],
) -> LinearFit:
    """Fit the linear part, the coefficients and the shape of torque columns together.

    Parameters
    ----------
    problem : Problem
    start : LinearFit
        Its part, coefficients and shape are the start.
    torques : callable
        Gives the lines of the torque of each record, (c, K), for a unit coefficient and a shape.
    ends : tuple of two (c + d,) ndarray
        Least and largest coefficients and shapes.

    Returns
    -------
    LinearFit
    """
    n, n_columns = len(start.part.names), len(start.coefficients)
    x0 = np.concatenate([start.part.values, start.coefficients, start.shape])
    scale = np.where(x0 != 0, np.abs(x0), 1.0)
    scale[n + n_columns :] = np.max(np.abs(start.shape))

    def parted(x: np.ndarray) -> tuple[LinearPart, np.ndarray, np.ndarray]:
        values = x * scale
        return start.part.at(values[:n]), values[n : n + n_columns], values[n + n_columns :]

    def total(c: np.ndarray, shape: np.ndarray) -> list[np.ndarray]:
        return [c @ t for t in torques(shape)]

    def error(x: np.ndarray) -> np.ndarray:
        part, c, shape = parted(x)
        return problem.error(part, problem.commands, total(c, shape))

    def jacobian(x: np.ndarray) -> np.ndarray:
        part, c, shape = parted(x)
        columns, here = torques(shape), problem.responses(part)
        slopes = problem.tangent(part, problem.commands, [c @ t for t in columns], here)
        step = SHAPE_STEP * np.max(np.abs(shape))
        changes = []
        for d in step * np.eye(len(shape)):
            pairs = zip(total(c, shape + d), total(c, shape - d), strict=True)
            changes.append([(more - less)[None, :] / (2 * step) for more, less in pairs])
        by_shape = [torque_columns(problem, part, change, here) for change in changes]
        return np.hstack([slopes, torque_columns(problem, part, columns, here), *by_shape]) * scale

    least = np.concatenate([start.part.lower, ends[0]]) / scale
    most = np.concatenate([_simulable(problem, start.part), ends[1]]) / scale
    found = least_squares(
        error,
        np.clip(x0 / scale, least, most),
        jacobian,
        bounds=(least, most),
        x_scale="jac",
        ftol=problem.settings.tolerance,
        xtol=1e-9,
        gtol=1e-12,
        max_nfev=problem.settings.steps,
    )
    part, c, shape = parted(found.x)
    return LinearFit(part, c, found.fun, found.jac / scale, shape)


def torque_columns(
    problem: Problem, part: LinearPart, torques: Sequence[np.ndarray], here: Responses | None = None
) -> np.ndarray:
    """Derivative of the whitened E by the coefficients of torques, (n_rows, c).

    Parameters
    ----------
    problem : Problem
    part : LinearPart
    torques : sequence of (c, K) complex ndarray
    here : list, optional
        `Problem.responses` of the part, if they are known.
    """
    entries = [p for _, p in here or problem.responses(part)]
    return problem.whiten([entries[r.group] * t for r, t in zip(problem.records, torques, strict=True)]).T


# ---- starts --------------------------------------------------------------------------------------------


def fit_null(
    problem: Problem, start: LinearPart, other: LinearPart | None = None, known: KnownFits | None = None
) -> LinearFit:
    """Fit the linear part alone; where the given values lead to a bad fit, from other starts as well.

    The fit without its modes begins at several delays, and from the best of them at several springs: a spring
    far below the lowest line does not grow. Then each mode is scanned over its frequency and damping, and all
    are fitted together. Last, each mode is searched again beside the others (`with_modes_searched`).

    Parameters
    ----------
    problem : Problem
    start : LinearPart
    other : LinearPart, optional
        The same structure with other values, which the fit begins from as well.
    known : dict, optional
        Fits that were made before with the same records and weights; in place.

    Returns
    -------
    LinearFit
    """
    return _with_fast_lag(problem, start, _least_cost(problem, start, other, known))


def fit_nulls(
    problems: Sequence[Problem], start: LinearPart, other: LinearPart | None, known: KnownFits | None
) -> list[LinearFit]:
    """`fit_null` of each reading of the hold; where one is bad, also from the minima of the others.

    The readings are compared by their costs, and the hold alone does not move a fit to another minimum.

    Parameters
    ----------
    problems : sequence of Problem
        The same records with different holds.
    start, other, known
        As `fit_null`.
    """
    alone = [fit_null(problem, start, other, known) for problem in problems]
    best = min(alone, key=lambda fit: fit.cost)
    found = []
    for problem, fit in zip(problems, alone, strict=True):
        if fit is not best and fit.cost_per_dof > problem.settings.good_cost:
            fit = min(fit, fit_linear_part(problem, best.part), key=lambda each: each.cost)
        found.append(fit)
    return found


def _least_cost(
    problem: Problem, start: LinearPart, other: LinearPart | None, known: KnownFits | None
) -> LinearFit:
    known = {} if known is None else known

    def fitted(part: LinearPart) -> LinearFit:
        key = (tuple(r.spectra.hold for r in problem.records), *part.key)
        if key not in known:
            known[key] = fit_linear_part(problem, part)
        return known[key]

    starts = [start] if other is None else [start, other]
    direct = min((fitted(each) for each in starts), key=lambda fit: fit.cost)
    if direct.cost_per_dof <= problem.settings.good_cost:
        return direct
    modes = [label for label in start.stack if label.partition("#")[0] == "flexible_mode"]
    bare = _without(start, modes)
    fits = [fitted(each) for each in _delayed(bare, problem.settings.delays)]
    best = min(fits, key=lambda fit: fit.cost)
    fits = [fitted(each) for each in _sprung(best.part, problem)]
    part = min([best, *fits], key=lambda fit: fit.cost).part
    for label in modes:
        part = _scanned(problem, part, start, label)
    again = fitted(start.at(_values(start.names, part)))
    near = with_modes_searched(problem, min(direct, again, key=lambda fit: fit.cost), start, fitted)
    if near.cost_per_dof <= problem.settings.good_cost:
        return near
    # Beside a large misfit a mode far from its frequency stands in for what is missing.
    far = with_modes_searched(problem, near, None, fitted)
    return far if far.cost_per_dof <= problem.settings.good_cost else near


def with_modes_searched(
    problem: Problem,
    fit: LinearFit,
    near: LinearPart | None = None,
    fitted: Callable[[LinearPart], LinearFit] | None = None,
) -> LinearFit:
    """A fit, or a better one with one or more of its modes at another resonance.

    A narrow resonance attracts a fit only from within its width: from elsewhere a mode stands in for what is
    missing, or fits noise. Each mode in turn is left out, the rest is fitted, and the mode is searched over
    the band, until no mode has a better place.

    Parameters
    ----------
    problem : Problem
    fit : LinearFit
        Without torques.
    near : LinearPart, optional
        Modes are searched around their frequencies in this part only.
    fitted : callable, optional
        Fits a linear part; default `fit_linear_part`.

    Returns
    -------
    LinearFit
    """
    fitted = fitted or partial(fit_linear_part, problem)
    modes = _free_modes(fit.part)
    since = 0  # modes that were searched since the last one that moved
    while modes and since < len(modes):
        label = modes[0]
        bare = fitted(_without(fit.part, [label])).part
        found = _scanned(problem, bare, near or fit.part, label, in_band=near is None)
        again = fitted(fit.part.at(_values(fit.part.names, found)))
        is_better = again.cost < (1 - problem.settings.mode_gain) * fit.cost
        fit, since = (again, 1) if is_better else (fit, since + 1)
        modes = [*modes[1:], label]
    return fit


def _free_modes(part: LinearPart) -> list[str]:
    """Labels of the modes whose values are all free."""
    labels = [label for label in part.stack if linear_kind(label) == "mode"]
    return [label for label in labels if all(f"{label}.{name}" in part.names for name in part.stack[label])]


def _values(names: Sequence[str], part: LinearPart) -> list[float]:
    return [part.stack[label][name] for label, name in map(split, names)]


def _with_fast_lag(problem: Problem, start: LinearPart, fit: LinearFit) -> LinearFit:
    """The fit with the fastest real pole as its lag, unless the start has a slow lag.

    A body with friction, a spring and a lag have the same response whichever of their real poles is the lag,
    but a torque acts on the body: with the wrong pole no law explains what is missing.
    """
    swapped = with_fast_lag(fit.part.stack)
    if swapped is None or with_fast_lag(start.stack) is not None:
        return fit
    again = fit_linear_part(problem, start.at([swapped[a][b] for a, b in map(split, start.names)]))
    return again if again.cost <= (1 + SAME_COST) * fit.cost else fit


def with_fast_lag(stack: dict[str, dict[str, float]]) -> dict[str, dict[str, float]] | None:
    """A stack with the fastest real pole as its lag; None where it is, or has no such poles.

    Parameters
    ----------
    stack : dict of dict of float
        {effect: {parameter: value}}; exact without modes.
    """
    lags = [label for label in LAGS if label in stack]
    if len(lags) != 1 or not {BODY, DAMPING} <= stack.keys():
        return None
    (lag,) = lags
    tau, rate = stack[lag]["time_constant_s"], stack[DAMPING]["rate"]
    stiffness = stack.get(SPRING, {"stiffness": 0.0})["stiffness"]
    square = rate**2 - 4 * stiffness
    if square <= 0 or tau <= 0 or tau * (rate + math.sqrt(square)) / 2 <= 1:
        return None
    poles = sorted([(rate - math.sqrt(square)) / 2, (rate + math.sqrt(square)) / 2, 1 / tau])
    swapped = {label: dict(params) for label, params in stack.items()}
    swapped[BODY]["gain"] /= tau * poles[2]
    swapped[DAMPING]["rate"] = poles[0] + poles[1]
    swapped[lag]["time_constant_s"] = 1 / poles[2]
    if SPRING in stack:
        swapped[SPRING]["stiffness"] = poles[0] * poles[1]
    return swapped


def _without(part: LinearPart, labels: Sequence[str]) -> LinearPart:
    keep = [i for i, name in enumerate(part.names) if split(name)[0] not in labels]
    stack = {label: params for label, params in part.stack.items() if label not in labels}
    return LinearPart(stack, tuple(part.names[i] for i in keep), part.lower[keep], part.upper[keep])


def _delayed(part: LinearPart, shares: Sequence[float]) -> list[LinearPart]:
    if DELAY not in part.names:
        return [part]
    i, values = part.names.index(DELAY), part.values
    return [part.at(np.where(np.arange(len(values)) == i, values * share, values)) for share in shares]


def _sprung(part: LinearPart, problem: Problem) -> list[LinearPart]:
    """The part with other springs."""
    name = "cable_spring.stiffness"
    if name not in part.names:
        return []
    i, values = part.names.index(name), part.values
    corners = 2 * np.pi * problem.first[0].f_hz[0] * np.array(problem.settings.corners)
    return [part.at(np.where(np.arange(len(values)) == i, w**2, values)) for w in corners]


def _scanned(
    problem: Problem, part: LinearPart, start: LinearPart, label: str, in_band: bool = False
) -> LinearPart:
    """The part with one more mode, where its column explains most of the error.

    It is searched around its frequency in the start, or over the band as well.
    """
    given, settings = start.stack[label], problem.settings
    scan = ModeScan(problem, part, basis(problem.tangent(part, problem.commands)))
    spread = math.log(settings.mode_spread)
    most, best = 0.0, dict(given)
    for zeta in settings.mode_dampings:
        around = given["f_hz"] * np.exp(np.linspace(-spread, spread, settings.mode_points))
        f_hz = np.concatenate([around, mode_grid(problem, zeta)]) if in_band else around
        found = scan.best(f_hz, zeta)
        if found.gain > most:
            most, best = found.gain, {"f_hz": found.f_hz, "zeta": zeta, "residue": found.residue}
    return replace(part, stack=part.stack | {label: best})


def mode_grid(problem: Problem, zeta: float) -> np.ndarray:
    """Frequencies of the band [Hz] at which no mode of a damping ratio is missed.

    Half of its half-power bandwidth apart, or half a line where the lines are farther apart.

    Parameters
    ----------
    problem : Problem
    zeta : float
    """
    lines = problem.first[0].f_hz
    gap = float(np.median(np.diff(lines))) if len(lines) > 1 else float(lines[0])
    found = [float(lines[0])]
    while found[-1] < lines[-1]:
        found.append(found[-1] + max(zeta * found[-1], gap / 2))
    return np.array(found)


@dataclass(frozen=True)
class FoundMode:
    """A mode that lowers the cost by `gain`."""

    f_hz: float
    residue: float
    gain: float


class ModeScan:
    """What a further mode explains of the error of a linear part, for many frequencies.

    The columns of a mode in records of the same lines differ only in the input. Their products with the error
    and with the tangent are therefore summed over the records first.

    Parameters
    ----------
    problem : Problem
    part : LinearPart
    tangent : (n_rows, m) ndarray
        Orthonormal: what the linear part can do itself.
    error : (n_rows,) ndarray, optional
        Default: what the part leaves.
    """

    def __init__(
        self, problem: Problem, part: LinearPart, tangent: np.ndarray, error: np.ndarray | None = None
    ) -> None:
        error = problem.error(part, problem.commands) if error is None else error
        error = error - tangent @ (tangent.T @ error)
        self.s = [2j * np.pi * lines.f_hz for lines in problem.first]
        rows = np.vstack([error, tangent.T])
        half = problem.n_rows // 2
        rows = (rows[:, :half] - 1j * rows[:, half:]).astype(complex)
        views = [problem.view(part, group) for group in range(problem.n_groups)]
        directs = [view.direct * view.loop * view.reference for view in views]
        self.rows = [np.zeros((len(rows), len(s)), complex) for s in self.s]
        self.power = [np.zeros(len(s)) for s in self.s]
        at = 0
        for r in problem.records:
            unit = -r.weight * directs[r.group] * r.U * self.s[r.group]
            self.rows[r.group] += rows[:, at : at + len(r.line)] * unit
            self.power[r.group] += np.abs(unit) ** 2
            at += len(r.line)

    def best(self, f_hz: np.ndarray, zeta: float) -> FoundMode:
        """The frequency with the largest gain.

        Parameters
        ----------
        f_hz : (m,) ndarray
        zeta : float
        """
        products, power = np.zeros((len(self.rows[0]), len(f_hz))), np.zeros(len(f_hz))
        w0 = 2 * np.pi * f_hz
        for s, rows, weight in zip(self.s, self.rows, self.power, strict=True):
            shape = 1 / (s[:, None] ** 2 + 2 * zeta * w0 * s[:, None] + w0**2)
            products += (rows @ shape).real
            power += weight @ np.abs(shape) ** 2
        free = power - np.sum(products[1:] ** 2, axis=0)
        free = np.where(free > ALIKE * power, free, np.inf)
        gains = products[0] ** 2 / free
        i = int(np.argmax(gains))
        return FoundMode(float(f_hz[i]), float(-products[0, i] / free[i]), float(gains[i]))


def basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of columns, without those that others nearly repeat, (n_rows, m).

    Parameters
    ----------
    columns : (n_rows, n) ndarray
    """
    if not columns.shape[1]:
        return columns
    size = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    return left[:, values > 1e-7 * values[0]]
