"""Least-squares problem of a grey-box fit: unknowns, bounds, residuals and Jacobian (GBX-1)."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError, InputError
from gsid.effects.types import EffectParameter
from gsid.greybox.settings import SETTINGS
from gsid.greybox.weights import lines_used, pooled_variance, whiten
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant, Prediction
from gsid.spectrum.lines import lines_of
from gsid.spectrum.spectra import Spectra

DRIFT = "drift"


def least_size(known: EffectParameter) -> float:
    """Lower bound of the size of a parameter. A strength may be zero, a shape parameter may not."""
    return 0.0 if known.null_value is None else abs(known.typical)


class Part:
    """One record of the problem: its weights, its plant and its own unknowns."""

    def __init__(
        self,
        model: PlantModel,
        measured: Spectra,
        variance: tuple[np.ndarray, float],
        band: tuple[float, float] | None,
        has_drift: bool,
        deadline: Deadline | None = None,
    ) -> None:
        self.spectra = s = measured
        self.name = s.name
        self.plant = PeriodicPlant.of(model, s, deadline)
        self.line = np.flatnonzero(lines_used(model, s, band))
        self.y = s.y[self.line]
        self.dof = variance[1]
        floor = (SETTINGS.noise_floor * float(np.max(np.abs(self.y)))) ** 2
        self.variance = np.maximum(variance[0][self.line], max(floor, np.finfo(float).tiny))
        self.noise_rms = float(np.sqrt(np.sum(self.variance) / (2 * s.n_periods)))  # of the mean, in time
        self.plant.tolerance = SETTINGS.settled * self.noise_rms
        real = self.line == 0
        # The mean of 1/s^2 is nu / (nu - 1) times that of 1/variance.
        scale = (self.dof - 1) / self.dof * np.where(real, 1, 2)
        self.weight = np.sqrt(scale * s.n_periods / self.variance)
        self.n_rows = 2 * len(self.line) - int(np.count_nonzero(real))
        n = s.period_samples
        ramps = np.tile(np.arange(n) / n - (n - 1) / (2 * n), (int(has_drift), 1))
        self.drift = lines_of(ramps)[:, self.line]  # no row without drift

    def is_unsettled(self, answer: Prediction) -> bool:
        """Whether the simulated response changes from period to period by a relevant part of the noise."""
        return answer.residual > SETTINGS.unsettled * self.noise_rms

    def whiten(self, lines: np.ndarray) -> np.ndarray:
        """[Re; Im] of lines, (..., k), times the weight."""
        return whiten(lines, self.weight, self.line == 0)


@dataclass(eq=False)
class Point:
    """Residuals and Jacobian at one set of unknowns, with their triangular factor."""

    x: np.ndarray
    cost: float
    residuals: list[np.ndarray]
    jacobians: list[np.ndarray]
    predictions: list[Prediction]
    settled: bool  # all records have reached a steady state
    r: np.ndarray = field(repr=False)  # (n, n): triangular factor of the Jacobian
    q: np.ndarray = field(repr=False)  # (n,): projection of the residual on its columns


class Problem:
    """Unknowns x: first those of each record (parameters, then the drift), then the shared ones."""

    def __init__(
        self,
        model: PlantModel,
        measured: list[Spectra],
        band: tuple[float, float] | None,
        per_record: tuple[str, ...],
        pool: ThreadPoolExecutor,
        deadline: Deadline | None = None,
    ) -> None:
        self.model, self.pool = model, pool
        holds = {"zoh"} if model.has_controller else {one.hold for one in measured}
        self.hold = holds.pop() if len(holds) == 1 else None
        free = model.free_names
        for name in per_record:
            if name != DRIFT and name not in free:
                known = ", ".join([*free, DRIFT])
                raise ValueError(
                    f"per_record contains {name!r}, which is not a free parameter; known are {known}"
                )
        self.local = [i for i, name in enumerate(free) if name in per_record]
        self.shared = [i for i, name in enumerate(free) if name not in per_record]
        if not self.shared:
            raise ValueError("the records share no free parameter: fit each record separately")
        has_drift = DRIFT in per_record
        self.own_names = [free[i] for i in self.local] + [DRIFT] * has_drift
        variances = pooled_variance(measured, drift=has_drift)
        self.parts = [
            Part(model, s, v, band, has_drift, deadline) for s, v in zip(measured, variances, strict=True)
        ]
        self.deadline = deadline or Deadline()
        for part in self.parts:  # equal shares do not depend on the order of the threads
            part.plant.bound(self.deadline.moves_left / len(self.parts))
        # With backlash, a response that does not settle soon usually never does: do not wait longer.
        self.has_backlash = any(effect.id == BACKLASH for effect in model.effects)
        self.n_records, self.n_own, self.n_shared = len(self.parts), len(self.own_names), len(self.shared)
        self.n = self.n_records * self.n_own + self.n_shared
        self.n_rows = sum(part.n_rows for part in self.parts)
        if self.n_rows <= self.n:
            what = f"{self.n} unknowns need more lines than the band contains"
            raise InputError(
                what, measured[0].name, f"{self.n_rows} numbers", "widen the band, or fix parameters"
            )
        f_hz = np.concatenate([s.f_hz[part.line] for s, part in zip(measured, self.parts, strict=True)])
        self.band_hz = (float(f_hz.min()), float(f_hz.max()))

    @property
    def weights(self) -> list[np.ndarray]:
        """Weights of the lines of each record; initially those of the noise."""
        return [part.weight for part in self.parts]

    @weights.setter
    def weights(self, weights: list[np.ndarray]) -> None:
        for part, weight in zip(self.parts, weights, strict=True):
            part.weight = weight

    def equal_weights(self) -> list[np.ndarray]:
        """Equal weights for all lines of all records, as in the mean square of the output (GBX-4).

        The unit is the noise of the quietest line, so that no residual has a variance below 1. (J'J)^-1 then
        does not exceed the covariance, and the stopping tolerance is far below a standard deviation.
        """
        quietest = np.min(np.concatenate(self.weights) ** -2)
        # The mean square of a cosine is half its squared amplitude.
        return [np.sqrt(np.where(part.line == 0, 2.0, 1.0) / quietest) for part in self.parts]

    @property
    def names(self) -> list[str]:
        """Name of each unknown; the unknowns of each record have the same names."""
        free = self.model.free_names
        return self.own_names * self.n_records + [free[i] for i in self.shared]

    def start(self) -> np.ndarray:
        values = self.model.free_values
        own = np.concatenate([values[self.local], np.zeros(self.n_own - len(self.local))])
        return np.concatenate([np.tile(own, self.n_records), values[self.shared]])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        both = []
        for bound, infinite in zip(self.model.bounds(), (-np.inf, np.inf), strict=True):
            own = np.concatenate([bound[self.local], np.full(self.n_own - len(self.local), infinite)])
            both.append(np.concatenate([np.tile(own, self.n_records), bound[self.shared]]))
        return both[0], both[1]

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """Size of each unknown, to which changes are compared."""
        least = [np.inf if name == DRIFT else least_size(self.model.parameter(name)) for name in self.names]
        return np.maximum(np.abs(x), least)

    def own(self, x: np.ndarray, record: int) -> np.ndarray:
        return x[record * self.n_own : (record + 1) * self.n_own]

    def values(self, x: np.ndarray, record: int) -> np.ndarray:
        """Free parameters of the plant for one record."""
        values = np.empty(len(self.local) + self.n_shared)
        values[self.local] = self.own(x, record)[: len(self.local)]
        values[self.shared] = x[self.n - self.n_shared :]
        return values

    def at(self, x: np.ndarray) -> Point:
        """Simulate all records.

        Raises
        ------
        GsidError
            The values cannot be simulated.
        OutOfTime
            The deadline was reached.
        """
        simulated = list(self.pool.map(lambda i: self._record(x, i), range(self.n_records)))
        residuals, jacobians, predictions, rows = (list(column) for column in zip(*simulated, strict=True))
        cost = float(sum(r @ r for r in residuals))
        if not np.isfinite(cost):
            raise GsidError(
                lib.GSID_E_NONFINITE, "the simulated response exceeds the range of floating-point numbers"
            )
        r, q = self._reduce(rows)
        r[:, np.linalg.norm(r, axis=0) * self.sizes(x) < SETTINGS.silent] = 0
        settled = not any(
            part.is_unsettled(answer) for part, answer in zip(self.parts, predictions, strict=True)
        )
        return Point(x, cost, residuals, jacobians, predictions, settled, r, q)

    def may_follow(self, point: Point, trial: Point) -> bool:
        """Whether the search may move to the trial. Without a steady state its cost is meaningless."""
        return trial.settled or not point.settled or not self.has_backlash

    def spend(self) -> None:
        """Take the work of all simulations from the deadline's bound."""
        is_used_up = any(part.plant.is_used_up for part in self.parts)
        self.deadline.spend(math.inf if is_used_up else sum(part.plant.moves for part in self.parts))

    def keep(self) -> None:
        """Continue the search from the point simulated last."""
        for part in self.parts:
            part.plant.keep()

    def _record(self, x: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray, Prediction, np.ndarray]:
        part, n_local = self.parts[i], len(self.local)
        answer = part.plant.run(self.values(x, i), sensitivities=True, patient=not self.has_backlash)
        error = part.y - answer.Y[part.line] - self.own(x, i)[n_local:] @ part.drift
        residual, jacobian = part.whiten(error), part.whiten(answer.dY[:, part.line]).T
        columns = [
            jacobian[:, self.local],
            part.whiten(part.drift).T,
            jacobian[:, self.shared],
            residual[:, None],
        ]
        return residual, jacobian, answer, np.ascontiguousarray(np.hstack(columns))

    def _reduce(self, rows: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Triangular factor of all equations, (n, n), and projection of the residual, (n,) (GBX-2)."""
        arrow = ffi.new("gsid_arrow *")
        n_rows = ffi.new("uint32_t[]", [len(block) for block in rows])
        pointers = ffi.new("double *[]", [ffi.from_buffer("double[]", block) for block in rows])
        arrow.n_records, arrow.n_local, arrow.n_shared = len(rows), self.n_own, self.n_shared
        arrow.n_rows, arrow.row = n_rows, ffi.cast("double *const *", pointers)
        triangle = np.empty((self.n + 1, self.n + 1))
        check(
            lib.gsid_arrow_reduce(arrow, ffi.from_buffer("double[]", triangle)),
            "reducing the fit's equations",
        )
        return triangle[:-1, :-1], triangle[:-1, -1]
