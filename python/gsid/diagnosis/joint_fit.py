"""Fit of backlash from the measured motion of the load, without simulating the feedback of the plant.

In a simulation of backlash each collision amplifies earlier errors, so that the cost has many narrow local
minima. The torque that the joint transmits also follows from the measured motion of the load. Driven by this
torque, the twist of a spring with backlash and damping is a stable differential equation of first order, and
the cost has one minimum. Noise of the torque leaves a bias, of up to 30 % in the gap, which simulations
remove (`gsid.diagnosis.joint_bias`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gsid.base.deadline import Deadline
from gsid.greybox.fit import PlantFit
from gsid.greybox.linear_start import LINEAR
from gsid.greybox.problem import least_size
from gsid.plant.linear_response import BACKLASH, linear_view
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS
from gsid.spectrum.lines import lines_of, period_of
from gsid.spectrum.spectra import Spectra

GEAR = ("gap_deg", "stiffness", "damping")
SHAPES = (f"{BACKLASH}.gap_deg", f"{BACKLASH}.inertia_ratio")
WIDE = 2.3  # times the highest excited line: upper limit of the harmonics of the torque that are used
OVERSAMPLING = 2  # time steps of the twist per sample
WARM = 8  # the simulation starts 1/WARM of a period early: the twist loses its initial state in one contact
STEPS_MAX = 12
# Relative to the last damping. All are evaluated in one call, which takes little longer than one of them.
DAMPINGS = 10.0 ** np.arange(-2, 4)
STIFFEST = 1e-3  # least damping / time step, relative to the stiffness
DIFFERENCE = 1e-4  # relative change of a parameter for a finite difference
LARGEST_STEP = (-0.5, 1.0)  # relative to a parameter
GAIN_LEAST = 1e-3  # relative reduction of the cost below which the search ends


def fit_joint(starts: list[PlantModel], fit: PlantFit, deadline: Deadline | None = None) -> PlantModel:
    """Fit backlash and the linear part to the output, given the measured motion of the load (DIA-10).

    Parameters
    ----------
    starts : list of PlantModel
        The same open-loop model with backlash, at different values; the fit starts from the best one.
    fit : PlantFit
        Provides records, lines and weights.
    deadline : Deadline, optional
        Checked before each step; by default there is none.

    Returns
    -------
    PlantModel

    Raises
    ------
    OutOfTime
        The deadline was reached.
    """
    deadline = deadline or Deadline()
    problem = _Problem(starts[0], fit)
    costs = problem.costs(np.array([values_of(one, problem.names) for one in starts]))
    model = starts[int(np.argmin(costs))]
    x, damping = values_of(model, problem.names), 1e-2
    lower, upper = problem.bounds
    for _ in range(STEPS_MAX):
        deadline.check()
        size = np.maximum(np.abs(x), problem.least_sizes)
        errors = problem.errors(np.vstack([x, x + DIFFERENCE * np.diag(size)]))
        if not np.all(np.isfinite(errors)):
            break
        e, jacobian = errors[0], (errors[1:] - errors[0]).T / DIFFERENCE
        steps = [_step(e, jacobian, damping * more) * size for more in DAMPINGS]
        trials = np.clip(x + np.array(steps), lower, upper)
        costs = problem.costs(trials)
        best = int(np.argmin(costs))
        if not costs[best] < e @ e:
            break
        x, damping = trials[best], max(damping * DAMPINGS[best], 1e-6)
        if costs[best] > (1 - GAIN_LEAST) * (e @ e):
            break
    better = dict(zip(problem.names, x, strict=True))
    return model.with_values([better.get(name, model[name].value) for name in model.free_names])


def fitted_names(model: PlantModel) -> list[str]:
    """Names of the parameters that `fit_joint` fits.

    Parameters
    ----------
    model : PlantModel
    """
    return [name for name in model.free_names if name in LINEAR or name in SHAPES]


def values_of(model: PlantModel, names: list[str]) -> np.ndarray:
    """(n,) values of some parameters.

    Parameters
    ----------
    model : PlantModel
    names : list of str
    """
    return np.array([model[name].value for name in names])


def joint_cost(model: PlantModel, fit: PlantFit) -> float:
    """Cost of a model with backlash, given the measured motion of the load (DIA-10); inf if not finite.

    Parameters
    ----------
    model, fit
        As `fit_joint`.
    """
    problem = _Problem(model, fit)
    return float(problem.costs(values_of(model, problem.names)[None])[0])


def _step(e: np.ndarray, jacobian: np.ndarray, damping: float) -> np.ndarray:
    """Levenberg-Marquardt step in relative parameters."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    rows = np.vstack([jacobian / scale, np.sqrt(damping) * np.eye(len(scale))])
    right = np.concatenate([-e, np.zeros(len(scale))])
    return np.clip(np.linalg.lstsq(rows, right, rcond=None)[0] / scale, *LARGEST_STEP)


@dataclass(eq=False)
class _Parts:
    """Responses around the backlash: command to motor torque, sensor, load alone, flexible modes.

    `gear` has the parameters of the backlash.
    """

    drive: np.ndarray
    sensor: np.ndarray
    load: np.ndarray
    modes: np.ndarray
    gear: dict[str, float]


class _Problem:
    """Weighted errors for many parameter sets, of the records with the period and rate of the first one."""

    def __init__(self, model: PlantModel, fit: PlantFit) -> None:
        self.model, first = model, fit.records[0].spectra

        def timing(one: Spectra) -> tuple[int, float, str | None]:
            return one.period_samples, one.fs_hz, one.hold

        self.records = [record for record in fit.records if timing(record.spectra) == timing(first)]
        self.measured = [record.spectra for record in self.records]
        self.names = fitted_names(model)
        chosen = [model.free_names.index(name) for name in self.names]
        lower, upper = model.bounds()
        self.bounds = lower[chosen], upper[chosen]
        self.least_sizes = [least_size(model.parameter(name)) for name in self.names]
        self.n, self.fs_hz = first.period_samples, first.fs_hz
        self.s = 2j * np.pi * np.where(first.f_hz > 0, first.f_hz, 1.0)
        self.signal_shares = [_signal_share(one) for one in self.measured]

    def costs(self, many: np.ndarray) -> np.ndarray:
        """(n_sets,) costs, infinite where the error is not finite."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # a step may end at a gain of 0
            costs = np.sum(self.errors(many) ** 2, axis=1)
        return np.where(np.isfinite(costs), costs, np.inf)

    def errors(self, many: np.ndarray) -> np.ndarray:
        """(n_sets, rows) errors, one row for each set of values."""
        parts = [self._parts(values) for values in many]
        torque = np.array([self._torque(part, i) for part in parts for i in range(len(self.measured))])
        gear = np.repeat([[part.gear[name] for name in GEAR] for part in parts], len(self.measured), axis=0)
        gap, stiffness, damping = gear.T
        twist = twist_of(torque, gap, stiffness, damping, 1 / (self.fs_hz * OVERSAMPLING))
        twist = lines_of(twist)[:, : len(self.s)].reshape(len(parts), -1, len(self.s))
        return np.array([self._error(part, x) for part, x in zip(parts, twist, strict=True)])

    def _parts(self, values: np.ndarray) -> _Parts:
        stack = self.model.stack()
        for name, value in zip(self.names, values, strict=True):
            effect, _, parameter = name.rpartition(".")
            stack[effect][parameter] = float(value)
        gear = stack.pop(BACKLASH)
        one = self.measured[0]
        view = linear_view(
            stack,
            one.f_hz,
            one.fs_hz,
            output_angle=self.model.output == "angle",
            radians_per_unit=RADIANS[self.model.angle_unit],
            held=one.hold == "zoh",
        )
        sensor = view.direct / view.drive
        load = view.torque / sensor
        return _Parts(view.drive, sensor, load, view.command / sensor - view.drive * load, gear)

    def _torque(self, part: _Parts, i: int) -> np.ndarray:
        """Torque on the load over one period."""
        one = self.measured[i]
        lines = (one.y / part.sensor - part.modes * one.u) / part.load * self.signal_shares[i]
        fine = np.zeros(self.n * OVERSAMPLING // 2 + 1, complex)
        fine[1 : len(lines)] = lines[1:]
        return period_of(fine, self.n * OVERSAMPLING)

    def _error(self, part: _Parts, twist: np.ndarray) -> np.ndarray:
        """For a given twist x, motor and load follow (r s + 1 / load) w = torque - r s^2 x."""
        ratio = part.gear["inertia_ratio"]
        rows = []
        for record, x in zip(self.records, twist, strict=True):
            one = record.spectra
            rate = (part.drive * one.u - ratio * self.s**2 * x) / (1 / part.load + ratio * self.s)
            weight = np.where(record.line > 0, record.weight, 0)  # the linear part does not determine line 0
            e = (one.y - part.sensor * (rate + part.modes * one.u))[record.line] * weight
            rows += [e.real, e.imag]
        return np.concatenate(rows)


def _signal_share(one: Spectra) -> np.ndarray:
    """Wiener weight of each line, 0 above `WIDE` times the highest excited line."""
    noise = 2 * one.var_y / one.n_periods
    power = np.maximum(np.abs(one.y) ** 2, np.finfo(float).tiny)
    return np.clip(1 - noise / power, 0, 1) * (one.f_hz <= WIDE * one.f_hz[one.excited].max())


def twist_of(
    torque: np.ndarray, gap: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, h: float
) -> np.ndarray:
    """Twist of springs with backlash and damping, by the trapezoidal rule, solved exactly in each step.

    Parameters
    ----------
    torque : (n_lanes, n) ndarray
        One period of the transmitted torque, divided by the inertia of the load.
    gap, stiffness, damping : (n_lanes,) ndarray
    h : float
        Step [s].

    Returns
    -------
    (n_lanes, n) ndarray
    """
    edge = gap / 2
    a = np.maximum(damping / h, STIFFEST * stiffness)
    mean = (torque + np.roll(torque, 1, axis=1)).T / 2
    n, warm = len(mean), len(mean) // WARM
    # Each step solves a x + spring(x) / 2 = push, and the next push is mean + a x - spring / 2.
    edge_push, softer = a * edge, 1 / (a + stiffness / 2)
    of_push, of_inner = 2 * a * softer - 1, 2 - 2 * a * softer
    push = np.concatenate([mean[n - warm :], mean])
    lower, inner = -edge_push, np.empty_like(edge_push)
    for before, here in pairwise(push):
        np.minimum(before, edge_push, out=inner)
        np.maximum(inner, lower, out=inner)
        inner *= of_inner
        here += inner
        np.multiply(before, of_push, out=inner)
        here += inner
    push = push[warm:]
    within = np.clip(push, -edge_push, edge_push)
    return (within / a + (push - within) * softer).T
