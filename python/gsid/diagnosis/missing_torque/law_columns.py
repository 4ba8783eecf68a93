"""Laws as columns: what a unit of each adds to the whitened error, for shapes over a grid.

A law is linear in some of its parameters, its coefficients: those that vanish at 0. Its other parameters are
its shape. A shape with a grid is searched. One without is a phase, and the law at a phase of 0 and of a
quarter of a turn spans all of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.fft import rfft

from gsid._lib import check, ffi, lib
from gsid.diagnosis.missing_torque.motion import Motion
from gsid.diagnosis.missing_torque.problem import Problem
from gsid.effects.types import EffectParameter, EffectType

ENDLESS = 1e60  # torque of a memory that grows from period to period; its square is a number
QUARTER = {"rad": math.pi / 2, "deg": 90.0}  # of a turn, by the unit of a phase


@dataclass(frozen=True, eq=False)
class Law:
    """A torque law or a map of the command, as the first stage looks at it.

    Attributes
    ----------
    effect : EffectType
    name : str
        Id of the effect, or the text of an enlarged law.
    family : str
        Laws of one family are easily taken for each other: "dry friction", "drag", "position", "command",
        "spring", "damping", "mode" or "lag".
    own_phases : int
        Number of records that have a phase of their own each, where the mean angle is not known; 0: one
        phase.
    """

    effect: EffectType
    name: str
    family: str
    own_phases: int = 0

    @property
    def is_command(self) -> bool:
        """Whether it maps the command."""
        return self.effect.c.command != ffi.NULL

    @property
    def shapes(self) -> list[EffectParameter]:
        """The parameters that are searched; of a map of the command its only one."""
        return [p for p in self.effect.parameters if p.grid is not None]

    @property
    def coefficients(self) -> list[EffectParameter]:
        """Parameters in which the torque is linear."""
        if self.is_command:
            return []
        return [p for p in self.effect.parameters if p.null_value == 0]

    @property
    def phase(self) -> EffectParameter | None:
        """A shape that needs no search."""
        found = [p for p in self.effect.parameters if p.null_value is None and p.grid is None]
        return found[0] if found else None

    @property
    def n_columns(self) -> int:
        """Columns of one shape."""
        return len(self.coefficients) * (2 * max(self.own_phases, 1) if self.phase else 1)

    @property
    def n_parameters(self) -> int:
        """Numbers that a fit adjusts."""
        return len(self.effect.parameters) + max(self.own_phases - 1, 0)

    @property
    def lower(self) -> np.ndarray:
        """(n_columns,) least coefficients: friction does not push."""
        if self.phase:
            return np.full(self.n_columns, -np.inf)
        return np.array([p.lower if p.lower == 0 else -np.inf for p in self.coefficients])

    def unit_values(self, shape: np.ndarray) -> np.ndarray:
        """(n_columns, parameters of the C library) values of each column of a record for a shape.

        Parameters
        ----------
        shape : (d,) ndarray
            Values of `shapes`.
        """
        searched = {p.name: value for p, value in zip(self.shapes, shape, strict=True)}
        rows = []
        for quarter in (0.0, 1.0) if self.phase else (0.0,):
            for one in self.coefficients:
                row = np.zeros(lib.GSID_EFFECT_PARAMETERS_MAX)
                for i, p in enumerate(self.effect.parameters):
                    if p is one:
                        row[i] = 1.0
                    elif p.name in searched:
                        row[i] = searched[p.name]
                    elif p is self.phase:
                        row[i] = quarter * quarter_turn(p)
                rows.append(row)
        return np.array(rows)

    def params(self, shape: np.ndarray, coefficients: Sequence[float]) -> dict[str, float]:
        """Values of the effect's parameters by name.

        Parameters
        ----------
        shape : (d,) ndarray
        coefficients : (n_columns,) sequence of float
        """
        values = {p.name: float(value) for p, value in zip(self.shapes, shape, strict=True)}
        if self.phase:
            in_phase, quadrature = coefficients[:2]  # of the first record
            turned = math.atan2(quadrature, in_phase) / (math.pi / 2)
            values[self.coefficients[0].name] = math.hypot(in_phase, quadrature)
            values[self.phase.name] = turned * quarter_turn(self.phase)
        else:
            values |= {p.name: float(c) for p, c in zip(self.coefficients, coefficients, strict=True)}
        return values

    def points(self, scales: dict[str, float]) -> np.ndarray:
        """Grid of its shapes for this motion, (s, d); one point of no values for a law without.

        Parameters
        ----------
        scales : dict of float
            The quantities that grids are relative to.
        """
        return np.array(list(itertools.product(*(_points(p, scales) for p in self.shapes))))


def _points(shape: EffectParameter, scales: dict[str, float]) -> np.ndarray:
    turns = shape.grid.spacing == "turns"  # of a sine, whose argument is in rad
    points = np.sort(shape.grid.at(scales["travel in rad" if turns else shape.grid.of]))
    return points[(points >= shape.lower) & (points <= shape.upper)]


def quarter_turn(phase: EffectParameter) -> float:
    """A quarter of a turn in the unit of a phase.

    Parameters
    ----------
    phase : EffectParameter
    """
    return QUARTER[phase.unit[:3]]


def torques(law: Law, values: np.ndarray, motion: Motion, radians: float) -> np.ndarray:
    """Torque of a law along a motion, (n_sets, n).

    Parameters
    ----------
    law : Law
    values : (n_sets, parameters) ndarray
    motion : Motion
    radians : float
        In a unit of angle.
    """
    values = np.ascontiguousarray(values, float)
    out = np.empty((len(values), len(motion.angle)))
    along, _kept = _along(motion, radians)
    arrays = [ffi.from_buffer("double[]", x) for x in (values, out)]
    status = lib.gsid_law_torques(law.effect.c, law.effect.data, along, len(values), *arrays)
    check(status, f"torque of {law.name}")
    return _limited(out)


def unit_torques(law: Law, shapes: np.ndarray, motion: Motion, radians: float) -> np.ndarray:
    """Torque of each column of a law for unit coefficients, (shapes, columns of a record, n).

    That of a quarter of a turn is the derivative by the phase: both come from one sine.

    Parameters
    ----------
    law : Law
    shapes : (s, d) ndarray
    motion : Motion
    radians : float
        In a unit of angle.
    """
    values = np.stack([law.unit_values(shape) for shape in shapes])
    n_sets, n = len(shapes), len(motion.angle)
    if law.phase is None:
        return torques(law, np.concatenate(values), motion, radians).reshape(n_sets, -1, n)
    in_phase = np.ascontiguousarray(values[:, 0])
    out, slope = np.empty((n_sets, n)), np.empty((n_sets, n))
    along, _kept = _along(motion, radians)
    arrays = [ffi.from_buffer("double[]", x) for x in (in_phase, out, slope)]
    by = law.effect.parameters.index(law.phase)
    status = lib.gsid_law_torques_and_slopes(
        law.effect.c, law.effect.data, along, n_sets, arrays[0], by, *arrays[1:]
    )
    check(status, f"torque of {law.name}")
    slope *= quarter_turn(law.phase) / (math.pi / 2)
    return np.stack([_limited(out), _limited(slope)], axis=1)


def _along(motion: Motion, radians: float) -> tuple[Any, list[Any]]:
    """A motion for the C library, and what has to live as long."""
    keep = [ffi.from_buffer("double[]", x) for x in (motion.angle, motion.rate, motion.side)]
    sizes = {"n": len(motion.angle), "step_s": motion.step_s, "unit_rad": radians}
    return ffi.new("gsid_law_motion *", sizes | dict(zip(("angle", "rate", "side"), keep, strict=True))), keep


def _limited(torque: np.ndarray) -> np.ndarray:
    if torque.min() >= -ENDLESS and torque.max() <= ENDLESS:  # not so with a NaN
        return torque
    return np.clip(np.nan_to_num(torque, copy=False), -ENDLESS, ENDLESS, out=torque)


def dissipated(law: Law, shapes: np.ndarray, motion: Motion, radians: float) -> np.ndarray:
    """Share of the work of a law with one coefficient that does not come back, (shapes,): 0 is a spring.

    Parameters
    ----------
    law : Law
    shapes : (s, d) ndarray
    motion : Motion
    radians : float
        In a unit of angle.
    """
    values = np.concatenate([law.unit_values(shape) for shape in shapes])
    power = torques(law, values, motion, radians) * motion.rate
    return np.sum(power, axis=1) / np.maximum(np.sum(np.abs(power), axis=1), np.finfo(float).tiny)


def torque_lines(law: Law, shapes: np.ndarray, problem: Problem, moved: Sequence[Motion]) -> list[np.ndarray]:
    """Lines of a law's torque for unit coefficients, (shapes, n_columns, K) of each record.

    Parameters
    ----------
    law : Law
    shapes : (s, d) ndarray
    problem : Problem
    moved : sequence of Motion
    """
    found = []
    for i, (r, motion) in enumerate(zip(problem.records, moved, strict=True)):
        problem.deadline.check()
        lines = motion.lines(unit_torques(law, shapes, motion, problem.radians), r.line)
        if law.own_phases:
            own = np.zeros((len(shapes), law.n_columns, len(r.line)), complex)
            own[:, 2 * i : 2 * i + 2] = lines
            lines = own
        found.append(lines)
    return found


def mapped(law: Law, shapes: np.ndarray, u: np.ndarray) -> np.ndarray:
    """A command after a law's map, (shapes, n).

    Parameters
    ----------
    law : Law
    shapes : (s, 1) ndarray
    u : (n,) ndarray
    """
    values = np.zeros((len(shapes), lib.GSID_EFFECT_PARAMETERS_MAX))
    values[:, :1] = shapes
    u, out = np.ascontiguousarray(u, float), np.empty((len(shapes), len(u)))
    arrays = [ffi.from_buffer("double[]", x) for x in (u, values, out)]
    effect = law.effect
    status = lib.gsid_law_commands(effect.c, effect.data, len(u), arrays[0], len(shapes), *arrays[1:])
    check(status, f"command of {law.name}")
    return out


def command_lines(law: Law, shapes: np.ndarray, problem: Problem) -> list[np.ndarray]:
    """Lines of the mapped command, (shapes, K) of each record.

    Parameters
    ----------
    law : Law
    shapes : (s, d) ndarray
    problem : Problem
    """
    found = []
    for r in problem.records:
        change = mapped(law, shapes, r.command) - r.command
        found.append(r.U + rfft(change)[:, r.line] * (2 / len(r.command)))
    return found
