"""Refinement of a structure's values: variable projection (Golub and Pereyra 1973; STR-3).

The gains are linear: for any other values the best gains are a linear least-squares solution. Gauss-Newton
steps with the damping of Levenberg and Marquardt move the other values, with Kaufman's approximation of the
projected residual's slopes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid.structure.elements import Lines, Values, columns, slopes

STEPS = 30
SETTLED = 1e-3
"""Decrease of V in a step below which a fit has converged; scores are compared at 7."""
STEP_MAX = 0.7
"""Largest change of a logarithm in one step: a factor of 2."""
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Data:
    """Best linear approximation as the fits see it.

    Parameters
    ----------
    lines : Lines
    g : (F,) complex
    weight : (F,) ndarray
        1 / standard deviation.
    """

    lines: Lines
    g: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True, eq=False)
class Fitted:
    """A structure with the values of least cost.

    Attributes
    ----------
    values : Values
    gains : (n_columns,) ndarray
        Of body, modes and residual term.
    cost : float
        V, sum of squared errors over their variance.
    """

    values: Values
    gains: np.ndarray
    cost: float

    @property
    def structure(self):
        """Its elements."""
        return self.values.structure

    def response(self, lines: Lines) -> np.ndarray:
        """(F,) complex."""
        return columns(self.values, lines) @ self.gains

    def error(self, data: Data) -> np.ndarray:
        """Weighted error of each line, (F,) complex."""
        return (data.g - self.response(data.lines)) * data.weight


def _stacked(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x.real, x.imag])


@dataclass(eq=False)
class _Point:
    values: Values
    each: np.ndarray
    gains: np.ndarray
    q: np.ndarray
    rest: np.ndarray
    cost: float


def _point(values: Values, data: Data, target: np.ndarray) -> _Point:
    each = columns(values, data.lines)
    weighted = _stacked(each * data.weight[:, None])
    size = np.linalg.norm(weighted, axis=0)
    size = np.where(np.isfinite(size) & (size > 0), size, 1.0)
    q, r = np.linalg.qr(weighted / size)
    diagonal = np.abs(np.diag(r))
    r = r + np.diag(np.where(diagonal < TINY, TINY, 0.0))  # columns that are alike get one gain between them
    projected = q.T @ target
    rest = target - q @ projected
    gains = np.linalg.solve(r, projected) / size
    return _Point(values, each, gains, q, rest, float(rest @ rest))


def linear_fit(values: Values, data: Data) -> Fitted:
    """The best gains for given values."""
    point = _point(values, data, _stacked(data.g * data.weight))
    return Fitted(values, point.gains, point.cost)


def refine(values: Values, data: Data, *, n_steps: int = STEPS, hopeless: float = np.inf) -> Fitted:
    """Values of least cost, from a start.

    Parameters
    ----------
    values : Values
    data : Data
    n_steps : int
    hopeless : float
        A cost that is not reached after 8 steps ends the refinement.
    """
    target = _stacked(data.g * data.weight)
    at, damping = _point(values, data, target), 1e-3
    scale = np.ones(len(values.theta))
    scale[-1] = 0.2 / data.lines.w[-1]  # of the delay [s]
    for step in range(n_steps):
        slope = _stacked(slopes(at.values, data.lines, at.each, at.gains) * data.weight[:, None]) * scale
        slope -= at.q @ (at.q.T @ slope)
        gradient, curvature = slope.T @ at.rest, slope.T @ slope
        better = None
        while damping < 1e8:
            diagonal = np.diag(damping * np.maximum(np.diag(curvature), TINY * np.trace(curvature)))
            move = np.linalg.lstsq(curvature + diagonal, gradient, rcond=None)[0]
            move = np.clip(move, -STEP_MAX, STEP_MAX) * scale
            tried = _point(Values(at.values.structure, at.values.theta + move), data, target)
            if np.isfinite(tried.cost) and tried.cost < at.cost:
                better = tried
                break
            damping *= 8
        if better is None:
            break
        decrease, at, damping = at.cost - better.cost, better, max(damping / 10, 1e-9)
        if decrease < SETTLED or (step > 8 and at.cost > hopeless):
            break
    return Fitted(at.values, at.gains, at.cost)
