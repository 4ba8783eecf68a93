"""Edges of a stop along the measured motion: where its fit by simulation starts.

The torque that is missing beside a linear part is zero between two edges and steep beyond. The edges need not
lie symmetrically: a constant torque shifts the middle of the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError
from gsid.diagnosis.missing_torque.linear_fit import torque_columns
from gsid.diagnosis.missing_torque.motion import Motion, motions
from gsid.diagnosis.missing_torque.problem import LinearPart, Problem, linear_part
from gsid.diagnosis.missing_torque.settings import SearchSettings
from gsid.effects.ids import BIAS, SPRING, STOP
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant
from gsid.spectrum.spectra import Spectra

LOUD = 0.8  # least input of a record of the high level, relative to the largest
WIDENED = (0.0, 0.05, 0.1, 0.2, 0.4)  # shares of the distance of the edges by which one may lie further out
NEAR = 2.0  # largest distance of a simulation from the records, over the least: other orbits are far off
SHARES = np.linspace(0.1, 1.0, 10)  # of the travel to each side: edges that are tried


def at_high_level(measured: Sequence[Spectra]) -> tuple[list[Spectra], list[Spectra]]:
    """The records of the high level, and the others.

    Parameters
    ----------
    measured : sequence of Spectra
    """
    inputs = [float(np.linalg.norm(one.u)) for one in measured]
    pairs = list(zip(measured, inputs, strict=True))
    most = LOUD * max(inputs)
    return [one for one, size in pairs if size >= most], [one for one, size in pairs if size < most]


def shifted_stop(
    linear: PlantModel,
    measured: Sequence[Spectra],
    band: tuple[float, float] | None,
    settings: SearchSettings,
    deadline: Deadline,
) -> PlantModel | None:
    """A linear part with a stop and a constant torque, from what is missing at the high level.

    Parameters
    ----------
    linear : PlantModel
        Fitted: a law of the angle beside it would have changed the spring.
    measured : sequence of Spectra
    band : (lo, hi) or None
        Hz.
    settings : SearchSettings
    deadline : Deadline

    Returns
    -------
    PlantModel or None
        None without edges that explain anything.
    """
    loud, _ = at_high_level(measured)
    problem = Problem(linear, loud, band, settings, deadline)
    edges = edges_along_motion(problem, linear_part(linear), most_left=1.0)
    return nearest_start(linear, edges, loud, deadline) if edges is not None else None


@dataclass(frozen=True)
class Edges:
    """Where the missing torque begins on each side, from the mean angle of a record.

    Attributes
    ----------
    low, high : float
        Angles [unit of the axis].
    stiffness : float
        Of both stops [1/s^2].
    mean_torque : float
        Mean of their torque over the record.
    record : int
        Number of the record.
    left : float
        Share of the misfit that remains.
    """

    low: float
    high: float
    stiffness: float
    mean_torque: float
    record: int
    left: float

    def widened(self, share: float) -> Edges:
        """The same with the side that carries less torque further out.

        Parameters
        ----------
        share : float
            Of the distance of the edges.
        """
        far = share * (self.high - self.low)
        low, high = (self.low, self.high + far) if self.mean_torque < 0 else (self.low - far, self.high)
        return replace(self, low=low, high=high)


def edges_along_motion(problem: Problem, part: LinearPart, most_left: float = 0.5) -> Edges | None:
    """Edges and stiffness that explain most of what the linear part leaves of one record.

    Parameters
    ----------
    problem : Problem
        With the records of the high level.
    part : LinearPart
    most_left : float
        Largest share of the misfit that remains: noise is a part of it.

    Returns
    -------
    Edges or None
        None if more remains.
    """
    error = problem.error(part, problem.commands)
    here = problem.responses(part)
    found = []
    for i, motion in enumerate(motions(problem, part)):
        rows = problem.rows_of(i)

        def fit(
            edges: Sequence[float], i: int = i, rows: np.ndarray = rows, motion: Motion = motion
        ) -> Edges:
            shape = _beyond(motion.angle - motion.angle.mean(), *edges)
            lines = [np.zeros((1, len(r.line)), complex) for r in problem.records]
            lines[i][0] = motion.lines(shape, problem.records[i].line)
            column = torque_columns(problem, part, lines, here)[rows, 0]
            power = float(column @ column)
            stiffness = max(-float(column @ error[rows]) / power, 0.0) if power > 0 else 0.0
            rest = error[rows] + stiffness * column
            left = float(rest @ rest) / float(error[rows] @ error[rows])
            return Edges(edges[0], edges[1], stiffness, stiffness * float(shape.mean()), i, left)

        mean = float(motion.angle.mean())
        least, most = float(motion.angle.min()) - mean, float(motion.angle.max()) - mean
        grid = [fit((a * least, b * most)) for a in SHARES for b in SHARES]
        first = min(grid, key=lambda one: one.left)
        better = optimize.minimize(
            lambda x, fit=fit: fit(x).left,
            (first.low, first.high),
            method="Nelder-Mead",
            options={"maxfev": 80},
        )
        found.append(fit(better.x))
    best = min(found, key=lambda one: one.left)
    return best if best.left < most_left and best.low < best.high else None


def _beyond(angle: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.maximum(angle - high, 0.0) + np.minimum(angle - low, 0.0)


def nearest_start(model: PlantModel, edges: Edges, loud: Sequence[Spectra], deadline: Deadline) -> PlantModel:
    """The model with stops at these edges, or with one of them further out.

    An edge that the motion does not reach may lie anywhere beyond it. Where the motion just touches it, the
    simulation may find another orbit, between both stops: the start is the narrowest stop whose simulation is
    near all records. One record alone may hit one side only, at any distance of the other.

    Parameters
    ----------
    model : PlantModel
    edges : Edges
    loud : sequence of Spectra
        The records of the high level.
    deadline : Deadline
        OutOfTime is raised there.
    """
    starts = [with_edges(model, edges.widened(share)) for share in WIDENED]
    distances = [sum(_distance(one, each, deadline) for each in loud) for one in starts]
    return next(start for start, left in zip(starts, distances, strict=True) if left <= NEAR * min(distances))


def _distance(model: PlantModel, measured: Spectra, deadline: Deadline) -> float:
    """Of the simulated output from the measured one, at the excited lines; infinite without a simulation."""
    try:
        error = measured.y - PeriodicPlant.of(model, measured, deadline).run().Y
    except GsidError:
        return np.inf
    left = float(np.linalg.norm(error[measured.excited]))
    return left if np.isfinite(left) else np.inf


def with_edges(model: PlantModel, edges: Edges) -> PlantModel:
    """The model with stops at these edges, and with the constant torque that shifts the motion between them.

    Parameters
    ----------
    model : PlantModel
    edges : Edges
    """
    half, mean = (edges.high - edges.low) / 2, -(edges.high + edges.low) / 2
    stopped = model.with_effect(STOP, {"angle_deg": half, "stiffness": edges.stiffness})
    springs = [effect for effect in model.effects if effect.id == SPRING]
    if not springs:
        return stopped
    level = -springs[0].params["stiffness"].value * mean - edges.mean_torque
    return stopped.with_effect(BIAS, {"level": level})
