"""Refinement of a structure's values: variable projection (Golub and Pereyra 1973; STR-3).

The gains are linear: for any other values the best gains are a linear least-squares solution. Gauss-Newton
steps with the damping of Levenberg and Marquardt move the other values, with Kaufman's approximation of the
projected residual's slopes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.structure.elements import Lines, Values, columns

STEPS = 30


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

    def __post_init__(self) -> None:
        object.__setattr__(self, "g", np.ascontiguousarray(self.g, complex))
        object.__setattr__(self, "weight", np.ascontiguousarray(self.weight, float))


@dataclass(frozen=True, eq=False)
class Fitted:
    """A structure with the values of least cost.

    Attributes
    ----------
    values : Values
    gains : (n_columns,) ndarray
        Of body, modes, residual term and torque along the motion.
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


def linear_fit(values: Values, data: Data) -> Fitted:
    """The best gains for given values."""
    return refine(values, data, n_steps=0)


def refine(values: Values, data: Data, *, n_steps: int = STEPS) -> Fitted:
    """Values of least cost, from a start; the cost is infinite where the start has no finite response.

    Parameters
    ----------
    values : Values
    data : Data
    n_steps : int
    """
    theta, cost = np.array(values.theta), ffi.new("double *")
    gains = np.empty(data.lines.n_columns(values.structure))
    doubles = (ffi.from_buffer("double[]", x) for x in (data.weight, theta, gains))
    weight, theta_c, gains_c = doubles
    status = lib.gsid_structure_refine(
        values.structure.c, data.lines.c, ffi.from_buffer("gsid_cplx[]", data.g), weight, n_steps, theta_c,
        gains_c, cost,
    )  # fmt: skip
    check(status, "refining a structure")
    return Fitted(Values(values.structure, theta), gains, cost[0])
