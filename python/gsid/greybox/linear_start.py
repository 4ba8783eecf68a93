"""Starting values for the linear part of a plant, from the measured frequency response.

The cost of a simulation has many local minima: if the model's resonance is a few per cent off the measured
peak, its gradient no longer points to it. The response of the linear part is a formula. A dense scan over the
resonance and a fit of this formula therefore take less time than one simulation, and lead to the global
minimum. Friction changes the measured response slightly; the fit by simulation that follows corrects this.

The scan holds the other parameters fixed. If the delay is wrong by a third of a turn at the resonance,
another frequency with the opposite sign of the mode fits better. A second scan therefore starts after a fit
of these parameters. The rest of the band determines them, unless the resonance covers the whole band.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from gsid.effects.types import catalogue
from gsid.greybox.settings import SETTINGS
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra, require_motion_of_output

# Parameters that the response of the linear part determines.
LINEAR = frozenset(f"{e.id}.{p.name}" for e in catalogue().values() for p in e.parameters if p.in_response)


def linear_start(model: PlantModel, measured: Sequence[Spectra]) -> PlantModel:
    """Fit the free parameters of the linear part to the measured frequency response.

    Parameters
    ----------
    model : PlantModel
    measured : sequence of Spectra

    Returns
    -------
    PlantModel
        The given model, if it has no such parameter or if its response fits no better than before.

    Raises
    ------
    InputError
        An output is constant.
    """
    require_motion_of_output(measured)
    names = [name for name in model.free_names if name in LINEAR]
    if not names:
        return model
    problem = _Problem(model, measured, names)
    everything = np.ones(len(names), bool)
    starts = [problem.values]
    if "flexible_mode.f_hz" in names:
        rest = np.array([not name.startswith("flexible_mode.") for name in names])
        starts = [_scanned(problem, at) for at in (problem.values, _fitted(problem, problem.values, rest))]
    fitted = min((_fitted(problem, start, everything) for start in starts), key=problem.cost)
    if not problem.cost(fitted) < problem.cost(problem.values):
        return model
    better = dict(zip(names, fitted, strict=True))
    return model.with_values([better.get(name, model[name].value) for name in model.free_names])


def _fitted(problem: _Problem, start: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Least squares over the free values."""
    values = start.copy()
    lower, upper = (bound[free] for bound in problem.bounds)
    scale = np.where(start != 0, np.abs(start), 1.0)[free]

    def error(z: np.ndarray) -> np.ndarray:
        values[free] = z * scale
        return problem.error(values)

    if np.any(free):
        first = np.clip(start[free], lower, upper) / scale
        bounds = lower / scale, upper / scale
        fitted = least_squares(
            error,
            first,
            bounds=bounds,
            x_scale="jac",
            ftol=SETTINGS.start_tolerance,
            xtol=SETTINGS.start_tolerance,
            max_nfev=SETTINGS.start_evaluations_max,
        )
        values[free] = fitted.x * scale
    return values


def linear_error(model: PlantModel, measured: Sequence[Spectra]) -> float:
    """Sum of squares of the weighted error of the linear part's frequency response.

    The weight of a line is the inverse of its noise, or of 0.1 % of its response if that dominates.

    Parameters
    ----------
    model : PlantModel
    measured : sequence of Spectra
    """
    return _Problem(model, measured, []).cost(np.empty(0))


class _Problem:
    def __init__(self, model: PlantModel, measured: Sequence[Spectra], names: list[str]) -> None:
        self.model, self.measured, self.names = model, measured, names
        self.values = np.array([model[name].value for name in names])
        lower, upper = model.bounds()
        chosen = [model.free_names.index(name) for name in names]
        self.bounds = lower[chosen], upper[chosen]
        self.g = [one.y[one.excited] / one.u[one.excited] for one in measured]
        self.weight = [_weight(one, g) for one, g in zip(measured, self.g, strict=True)]
        # Realisations share their lines: the response is computed once for all of them.
        kinds = [(one.fs_hz, one.hold, one.f_hz[one.excited].tobytes()) for one in measured]
        distinct = list(dict.fromkeys(kinds))
        self.distinct = [measured[kinds.index(kind)] for kind in distinct]
        self.which = [distinct.index(kind) for kind in kinds]

    def cost(self, values: np.ndarray) -> float:
        return float(np.sum(self.error(values) ** 2))

    def error(self, values: np.ndarray) -> np.ndarray:
        """Weighted error of the response over all records, real parts and imaginary parts."""
        stack = self.model.stack()
        for name, value in zip(self.names, values, strict=True):
            effect, _, parameter = name.rpartition(".")
            stack[effect][parameter] = float(value)
        answers = [self.model.linear_response(one, one.excited, stack=stack).command for one in self.distinct]
        together = np.concatenate(
            [(g - answers[i]) * w for g, i, w in zip(self.g, self.which, self.weight, strict=True)]
        )
        return np.concatenate([together.real, together.imag])


def _weight(one: Spectra, g: np.ndarray) -> np.ndarray:
    noise = np.sqrt(one.var_y[one.excited] / one.n_periods) / np.abs(one.u[one.excited])
    return 1 / np.hypot(noise, SETTINGS.response_floor * np.abs(g))


def _scanned(problem: _Problem, values: np.ndarray) -> np.ndarray:
    """Scan the resonance frequency. The residue is refitted at each point: the error is linear in it."""
    index = {name: i for i, name in enumerate(problem.names)}
    mode = problem.names.index("flexible_mode.f_hz")
    zeta = problem.model["flexible_mode.zeta"].value
    low, high = 1 - SETTINGS.scan_spread, 1 + SETTINGS.scan_spread
    step = max(SETTINGS.scan_step * 2 * zeta, SETTINGS.scan_step_min)
    n = min(int(np.ceil(np.log(high / low) / step)), SETTINGS.scan_points_max)
    best, least = values, np.inf
    for f_hz in values[mode] * np.geomspace(low, high, n):
        trial = values.copy()
        trial[mode] = f_hz
        if "flexible_mode.residue" in index:
            trial[index["flexible_mode.residue"]] = _best_size(problem, trial, index["flexible_mode.residue"])
        cost = problem.cost(trial)
        if cost < least:
            best, least = trial, cost
    return best


def _best_size(problem: _Problem, values: np.ndarray, which: int) -> float:
    """Least-squares value, within its bounds, of a parameter in which the error is linear."""
    without, with_one = values.copy(), values.copy()
    without[which], with_one[which] = 0.0, 1.0
    rest = problem.error(without)
    column = rest - problem.error(with_one)
    size = float(column @ rest) / max(float(column @ column), np.finfo(float).tiny)
    return float(np.clip(size, problem.bounds[0][which], problem.bounds[1][which]))
