"""Stops that the axis runs into at its high level only.

A fit of the linear part to all records is then far from the truth, and so are all columns along it. The
records of the lower levels alone show the true linear part. The torque that is missing beside it at the high
level is zero between two edges and steep beyond: edges and stiffness start the fit by simulation. The edges
need not lie symmetrically: a constant torque shifts the middle of the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.from_records.canonical import BODY, SPRING, canonical_stack
from gsid.diagnosis.from_records.confirm import judged
from gsid.diagnosis.from_records.other_structure import add_rival, least_left, take
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.verdict import NEAREST, UNKNOWN
from gsid.diagnosis.missing_torque.linear_fit import torque_columns
from gsid.diagnosis.missing_torque.motion import Motion, motions
from gsid.diagnosis.missing_torque.problem import LinearPart, Problem, linear_part
from gsid.diagnosis.missing_torque.settings import DEFAULTS
from gsid.greybox.fit import PlantFit, fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra
from gsid.structure.start import start

STOP, BIAS = "hard_stop", "torque_bias"
LOUD = 0.8  # least input of a record of the high level, relative to the largest
SHARES = np.linspace(0.1, 1.0, 10)  # of the travel to each side: edges that are tried
STEPS = 25  # iterations of each fit
MISFIT = 2.0  # cost per degree of freedom from which on a law may be missing that the first stage cannot see


def seek_stop(run: Run) -> None:
    """Try stops where the lower levels alone leave only noise, and no law explains a clear misfit.

    A name needs a fit that leaves only noise: the linear structure is that of other records.

    Parameters
    ----------
    run : Run
    """
    if not _is_worth_it(run):
        return
    most = LOUD * max(map(_input, run.measured))
    loud = [one for one in run.measured if _input(one) >= most]
    quiet = [one for one in run.measured if _input(one) < most]
    if not quiet:
        return
    with run.timed("simulation"):
        try:
            deadline = run.deadline.bounded(run.settings.moves_of_fit)  # the laws may have used up theirs
            low = _linear_part_of(run, quiet, deadline)
            fitted = None if low is None else _fitted(run, low, loud, deadline)
        except (GsidError, InputError, OutOfTime, np.linalg.LinAlgError):
            return
        if fitted is None or fitted.cost_per_dof > run.settings.less_left * least_left(run):
            return
        found = judged(fitted, (STOP,), run.settings)
        take(run, found, STOP)
        if run.evidence().is_adequate(found):
            add_rival(run, run.simulations(), low.model, found)


def _is_worth_it(run: Run) -> bool:
    """Whether the best law leaves a clear misfit, and a stop can be added."""
    if run.null is None or run.in_closed_loop or run.null.model.has_controller or STOP in run.without:
        return False
    effects = {effect.id for effect in run.null.model.effects}
    if run.decision.verdict not in (UNKNOWN, NEAREST) or BODY not in effects or STOP in effects:
        return False
    return least_left(run) > MISFIT and not run.deadline.is_over


def _input(one: Spectra) -> float:
    return float(np.linalg.norm(one.u))


def _linear_part_of(run: Run, quiet: Sequence[Spectra], deadline: Deadline) -> PlantFit | None:
    """The linear part of some records, with a structure of their own unless one is given."""
    run.on_step("fitting the linear part to the records of the lower levels")
    structure = run.null.model
    if run.given is None:
        found = start(quiet, output=structure.output, band=run.band, deadline=deadline)
        if found.has_model:
            structure = canonical_stack(found.model(), run.f_lo_hz, run.settings)
    begin = linear_start(structure, quiet)
    low = fit_plant(begin, quiet, band=run.band, max_iter=STEPS, deadline=deadline)
    return low if low.cost_per_dof <= run.settings.adequate else None


def _fitted(run: Run, low: PlantFit, loud: Sequence[Spectra], deadline: Deadline) -> PlantFit | None:
    """The fit with stops to one record of the high level, and from there to all records."""
    problem = Problem(low.model, list(loud), run.band, DEFAULTS, deadline)
    edges = edges_along_motion(problem, linear_part(low.model))
    if edges is None:
        return None
    run.on_step(f"fitting {STOP} by simulation")
    with_stop = with_edges(low.model, edges)
    chosen = [one.spectra for one in low.records] + [loud[edges.record]]
    how = {"band": run.band, "max_iter": STEPS, "deadline": deadline}
    one = fit_plant(with_stop, chosen, **how)
    return fit_plant(one.model, run.measured, **how)


# ---- edges along the measured motion ---------------------------------------------------------------------


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


def edges_along_motion(problem: Problem, part: LinearPart) -> Edges | None:
    """Edges and stiffness that explain most of what the linear part leaves of one record.

    Parameters
    ----------
    problem : Problem
        With the records of the high level.
    part : LinearPart

    Returns
    -------
    Edges or None
        None if none explain half of it.
    """
    error = problem.error(part, problem.commands)
    here = problem.responses(part)
    found = []
    for i, motion in enumerate(motions(problem, part)):
        rows = problem.rows_of(i)

        def fit(
            edges: Sequence[float], i: int = i, rows: np.ndarray = rows, motion: Motion = motion
        ) -> Edges:
            shape = _beyond(motion.angle, *edges)
            lines = [np.zeros((1, len(r.line)), complex) for r in problem.records]
            lines[i][0] = motion.lines(shape, problem.records[i].line)
            column = torque_columns(problem, part, lines, here)[rows, 0]
            power = float(column @ column)
            stiffness = max(-float(column @ error[rows]) / power, 0.0) if power > 0 else 0.0
            rest = error[rows] + stiffness * column
            left = float(rest @ rest) / float(error[rows] @ error[rows])
            return Edges(edges[0], edges[1], stiffness, stiffness * float(shape.mean()), i, left)

        least, most = float(motion.angle.min()), float(motion.angle.max())
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
    return best if best.left < 0.5 and best.low < best.high else None


def _beyond(angle: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.maximum(angle - high, 0.0) + np.minimum(angle - low, 0.0)


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
