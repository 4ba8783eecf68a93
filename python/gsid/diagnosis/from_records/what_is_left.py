"""What a law leaves: does it depend on angle, rate, command, or direction at each angle? (DIA-13)

A wrong law may leave so little that its cost is that of noise: a test of thousands of numbers together sees
no hundred that are left. What another law would explain lies in few directions: those of smooth functions of
the coordinates. The functions act along the simulated motion, which has no noise of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special
from scipy.fft import rfft

from gsid.diagnosis.missing_torque.free_functions import smooth
from gsid.diagnosis.missing_torque.linear_fit import basis
from gsid.diagnosis.missing_torque.motion import Motion, motions
from gsid.diagnosis.missing_torque.problem import LinearPart, Lines, Problem, linear_part
from gsid.diagnosis.missing_torque.settings import DEFAULTS
from gsid.greybox.fit import PlantFit
from gsid.plant.linear_response import BACKLASH

FRICTION_OVER_ANGLE = "the direction of motion, differently at each angle"


def what_is_left(fit: PlantFit, least: float = 0.0) -> dict[str, float]:
    """p-values that what a fit leaves does not depend on each coordinate; empty where it cannot be tested.

    They hold for all coordinates together (Bonferroni). In a closed loop the command inside the loop is not
    in the records, and with play between motor and load a torque acts on two bodies: both are not tested.

    Parameters
    ----------
    fit : PlantFit
        That leaves only noise.
    least : float
        Coordinates whose functions lower the cost by less are not in the result.
    """
    model = fit.model
    if model.has_controller or any(effect.id == BACKLASH for effect in model.effects):
        return {}
    linear, functions = _columns(along_simulated_motion(fit), linear_part(model))
    known = basis(np.hstack([fit.jacobian, fit.whitened(linear)]))
    scale = max(fit.cost_per_dof, 1.0)
    found = {}
    for name, columns in functions.items():
        changes = fit.whitened(columns)
        free = basis(changes - known @ (known.T @ changes))
        gain = float(np.sum((free.T @ fit.residual) ** 2)) / scale
        if gain >= least:
            found[name] = float(special.chdtrc(free.shape[1], gain))
    return {name: min(len(functions) * p_value, 1.0) for name, p_value in found.items()}


def along_simulated_motion(fit: PlantFit) -> Problem:
    """Records of a fit, with the motion of its simulation.

    Parameters
    ----------
    fit : PlantFit
    """
    measured = [one.spectra for one in fit.records]
    along = [replace(r.spectra, Y=r.spectra.Y - r.spectra.y + r.prediction.Y) for r in fit.records]
    return Problem(fit.model, measured, fit.band_hz, DEFAULTS, along=along)


def _columns(problem: Problem, part: LinearPart) -> tuple[list[np.ndarray], dict[str, list[np.ndarray]]]:
    """Changes of the output by what is linear in the coordinates, and by smooth functions of each of them."""
    moved, entries, n = motions(problem, part), problem.responses(part), problem.settings.free_functions
    over_angle, over_rate = smooth([m.angle for m in moved], n), smooth([m.rate for m in moved], n)
    over_command = smooth([r.command for r in problem.records], n)
    linear, functions = [], {"the angle": [], "the rate": [], "the command": [], FRICTION_OVER_ANGLE: []}
    for r, m in zip(problem.records, moved, strict=True):
        answers = _Answers(r, m, *entries[r.group])
        linear.append(np.vstack([answers.to_torques(m.angle, m.rate), answers.to_commands(r.command)]))
        of_angle = over_angle(m.angle)
        functions["the angle"].append(answers.to_torques(of_angle))
        functions[FRICTION_OVER_ANGLE].append(answers.to_torques(of_angle * m.side))
        functions["the rate"].append(answers.to_torques(over_rate(m.rate), m.side))
        functions["the command"].append(answers.to_commands(over_command(r.command)))
    return linear, functions


@dataclass(frozen=True, eq=False)
class _Answers:
    """Lines of the output of one record, (q, N/2 + 1), that torques along the motion or commands cause."""

    record: Lines
    motion: Motion
    by_command: np.ndarray
    by_torque: np.ndarray

    def to_torques(self, *signals: np.ndarray) -> np.ndarray:
        return self._all_lines(self.motion.lines(np.vstack(signals), self.record.line) * self.by_torque)

    def to_commands(self, *signals: np.ndarray) -> np.ndarray:
        lines = rfft(np.vstack(signals))[:, self.record.line] * (2 / len(self.record.command))
        return self._all_lines(lines * self.by_command)

    def _all_lines(self, columns: np.ndarray) -> np.ndarray:
        lines = np.zeros((len(columns), len(self.record.y)), complex)
        lines[:, self.record.line] = columns
        return lines
