"""Minimisation of the cost of a grey-box fit, by Levenberg-Marquardt or NLopt.

Levenberg-Marquardt scales each parameter by the norm of its column of the Jacobian. The step is computed from
the triangular factor of a QR factorisation (GBX-2). Small singular values of this factor show the directions
that the data do not determine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.deadline import OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.greybox.problem import Point, Problem
from gsid.greybox.settings import SETTINGS


@dataclass
class Minimum:
    """Result of a minimisation."""

    point: Point
    converged: bool
    n_iterations: int


def minimise(problem: Problem, solver: str, max_iter: int) -> Minimum:
    """Minimise the cost from the starting values of the model.

    Raises
    ------
    InputError
        The model cannot be simulated with its starting values.
    GsidError
        The library was built without NLopt.
    OutOfTime
        The deadline was reached before the starting values were simulated; later, the best point is returned.
    """
    try:
        start = problem.at(problem.start())
    except GsidError as error:
        raise InputError(
            "the model cannot be simulated with its starting values",
            problem.parts[0].name,
            error.message,
            error.hint or "use starting values closer to those of a working axis",
        ) from error
    return (
        _levenberg_marquardt(problem, start, max_iter) if solver == "lm" else _nlopt(problem, start, max_iter)
    )


class Steps:
    """Steps from one point for any damping, from the singular values of the scaled triangular factor.

    Pinned directions are excluded.
    """

    def __init__(self, point: Point, scale: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> None:
        self.point, self.lower, self.upper, self.scale = point, *bounds, scale
        downhill = point.r.T @ point.q
        self.blocked = ((point.x <= self.lower) & (downhill < 0)) | ((point.x >= self.upper) & (downhill > 0))
        u, s, vt = np.linalg.svd(point.r[:, ~self.blocked] / scale[~self.blocked], full_matrices=False)
        good = s > SETTINGS.singular * (s[0] if len(s) else 0)
        self.s, self.vt, self.along = s[good], vt[good], u[:, good].T @ point.q

    @property
    def decrease(self) -> float:
        """Predicted decrease of the cost for a full step, without regard to the bounds."""
        return float(self.along @ self.along)

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        """Unknowns after a step within the bounds, and the predicted decrease of the cost."""
        x = self.point.x.copy()
        x[~self.blocked] += (
            self.vt.T @ (self.s / (self.s**2 + damping) * self.along) / self.scale[~self.blocked]
        )
        x = np.clip(x, self.lower, self.upper)
        left = self.point.q - self.point.r @ (x - self.point.x)
        return x, float(self.point.q @ self.point.q - left @ left)


def _levenberg_marquardt(problem: Problem, point: Point, max_iter: int) -> Minimum:
    """Marquardt's scaling and Nielsen's rule for the damping. A step that cannot be simulated is rejected."""
    bounds, scale = problem.bounds(), lengths(point.r)
    damping, growth = SETTINGS.damping_start, SETTINGS.damping_growth
    problem.keep()
    for i in range(max_iter):
        scale = np.maximum(scale, lengths(point.r))
        steps = Steps(point, scale, bounds)
        if steps.decrease < SETTINGS.decrease:
            return Minimum(point, True, i)
        while True:
            x, promised = steps.step(damping)
            try:
                trial = _try(problem, point, x) if promised > 0 else None
            except OutOfTime:
                return Minimum(point, False, i)
            if trial is not None and trial.cost < point.cost:
                break
            damping, growth = damping * growth, growth * 2
            if damping > SETTINGS.damping_max:
                # Rounding errors and events prevent any further decrease: accept this minimum.
                return Minimum(point, steps.decrease < SETTINGS.stalled * point.cost, i)
        gain = (point.cost - trial.cost) / promised
        damping *= max(SETTINGS.damping_fall, 1 - (2 * gain - 1) ** 3)
        growth = SETTINGS.damping_growth
        point = trial
        problem.keep()
    return Minimum(point, Steps(point, scale, bounds).decrease < SETTINGS.decrease, max_iter)


def _try(problem: Problem, point: Point, x: np.ndarray) -> Point | None:
    """Simulate the trial point; None if the search may not continue from it."""
    try:
        trial = problem.at(x)
        return trial if problem.may_follow(point, trial) else None
    except GsidError as error:
        if error.code == lib.GSID_E_NO_MEMORY:
            raise
        return None


def _nlopt(problem: Problem, start: Point, max_iter: int) -> Minimum:
    """NLopt in scaled unknowns. A point that cannot be simulated gets a constant high cost."""
    scale, (lower, upper) = lengths(start.r), problem.bounds()
    best, n_calls, failure = start, 0, []

    def objective(n: int, z: Any, gradient: Any, _: Any) -> float:
        nonlocal best, n_calls
        n_calls += 1
        try:
            x = np.frombuffer(ffi.buffer(z, 8 * n)).copy() / scale
            point = _try(problem, best, np.clip(x, lower, upper))
        except BaseException as error:  # an exception must not propagate through the C library
            failure.append(error)
            point = None
        slope = np.zeros(n) if point is None else -2 * (point.r.T @ point.q) / scale
        if gradient != ffi.NULL:
            ffi.memmove(gradient, slope, 8 * n)
        if point is None:
            return SETTINGS.failed_cost * start.cost
        best = point if point.cost < best.cost else best
        return point.cost

    callback = ffi.callback("double(unsigned, const double *, double *, void *)", objective)
    x, least = start.x * scale, ffi.new("double *")
    pointers = [ffi.from_buffer("double[]", row) for row in (lower * scale, upper * scale, x)]
    status = lib.gsid_minimise(
        problem.n, callback, ffi.NULL, *pointers[:2], SETTINGS.decrease, max_iter, pointers[2], least
    )
    if failure and not isinstance(failure[0], OutOfTime):
        raise failure[0]
    if failure:
        return Minimum(best, False, n_calls)
    check(status, "minimising by NLopt")
    left = Steps(best, lengths(best.r), (lower, upper)).decrease
    return Minimum(best, left < SETTINGS.decrease, n_calls)


def lengths(r: np.ndarray) -> np.ndarray:
    """Norms of the columns of the Jacobian; 1 for a column of zeros."""
    lengths = np.linalg.norm(r, axis=0)
    return np.where(lengths > 0, lengths, 1.0)
