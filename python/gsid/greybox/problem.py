"""A grey-box fit as the C library takes it: records, unknowns, bounds and weights (GBX-1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError, InputError
from gsid.effects.types import EffectParameter
from gsid.greybox.settings import SETTINGS
from gsid.greybox.weights import lines_used, pooled_variance
from gsid.plant.model import PlantModel
from gsid.plant.periodic import Answer, PeriodicPlant, Prediction, check_simulation
from gsid.spectrum.spectra import Spectra

DRIFT = "drift"
SOLVERS = {"lm": lib.GSID_SOLVER_GAUSS_NEWTON, "nlopt": lib.GSID_SOLVER_NLOPT}
METHODS = {"ml": lib.GSID_PLANT_FIT_ML, "nls-output": lib.GSID_PLANT_FIT_NLS_OUTPUT}
# Failures of a fit that do not tell that its start cannot be simulated.
_NOT_OF_THE_START = (lib.GSID_E_NO_MEMORY, lib.GSID_E_BACKEND, lib.GSID_E_TOO_FEW, lib.GSID_E_SINGULAR)


def least_size(known: EffectParameter) -> float:
    """Lower bound of the size of a parameter. A strength may be zero, a shape parameter may not."""
    return 0.0 if known.null_value is None else abs(known.typical)


class Part:
    """One record of the problem, and what is known of it after the fit.

    Parameters
    ----------
    model : PlantModel
    measured : Spectra
    variance : ((K,) ndarray, float)
        Variance of the lines of one period, and its degrees of freedom.
    band : (lo, hi) or None
    n_columns : int
        Unknowns of this record and shared ones.
    deadline : Deadline, optional
    """

    def __init__(
        self,
        model: PlantModel,
        measured: Spectra,
        variance: tuple[np.ndarray, float],
        band: tuple[float, float] | None,
        n_columns: int,
        deadline: Deadline | None = None,
    ) -> None:
        self.spectra = s = measured
        self.plant = PeriodicPlant.of(model, s, deadline)
        self.line = np.flatnonzero(lines_used(model, s, band)).astype(np.uint32)
        self.y = s.y[self.line]
        self.variance, self.dof = variance[0][self.line], variance[1]
        self.n_rows = 2 * len(self.line) - int(np.count_nonzero(self.line == 0))
        self.weight = np.empty(len(self.line))
        self.rows = np.empty((2 * len(self.line), n_columns + 1))
        self.answer = Answer(s.period_samples, len(model.free_names))

    def enter(self, record: Any, at: Any) -> None:
        """Enter this record and the memory for its results into the structures of the C library."""
        record.input = self.plant.c[0]
        record.n_lines, record.line = len(self.line), ffi.from_buffer("uint32_t[]", self.line)
        record.y = ffi.from_buffer("gsid_cplx[]", self.y)
        record.variance = ffi.from_buffer("double[]", self.variance)
        record.n_periods, record.dof = self.spectra.n_periods, self.dof
        at.weight = ffi.from_buffer("double[]", self.weight)
        at.row = ffi.cast("double *", ffi.from_buffer(self.rows))
        at.answer = self.answer.c[0]


@dataclass(eq=False)
class RecordAt:
    """Residuals, derivatives and response of one record at the minimum."""

    weight: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    prediction: Prediction
    is_unsettled: bool


@dataclass(eq=False)
class Minimum:
    """Result of the fit, by unknowns.

    Attributes
    ----------
    x : (n,) ndarray
    cov : (n, n) ndarray
    is_open : (n,) bool ndarray
        Unknowns whose variance is not known: a direction that the data do not determine contains a relevant
        part of them.
    is_at_bound : (n,) bool ndarray
    cost : float
    n_dof : int
    converged : bool
    n_iterations : int
    records : list of RecordAt
    """

    x: np.ndarray
    cov: np.ndarray
    is_open: np.ndarray
    is_at_bound: np.ndarray
    cost: float
    n_dof: int
    converged: bool
    n_iterations: int
    records: list[RecordAt]

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of each unknown; NaN where it is not known."""
        return np.where(self.is_open, np.nan, np.sqrt(np.diag(self.cov)))


class Problem:
    """Unknowns x: first those of each record (parameters, then the drift), then the shared ones."""

    def __init__(
        self,
        model: PlantModel,
        measured: list[Spectra],
        band: tuple[float, float] | None,
        per_record: tuple[str, ...],
        deadline: Deadline | None = None,
    ) -> None:
        self.model = model
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
        self.has_drift = DRIFT in per_record
        self.own_names = [free[i] for i in self.local] + [DRIFT] * self.has_drift
        self.n_records, self.n_own, self.n_shared = len(measured), len(self.own_names), len(self.shared)
        self.n = self.n_records * self.n_own + self.n_shared
        if self.n > lib.GSID_LSQ_COLUMNS_MAX:
            raise ValueError(
                f"{self.n} unknowns of {self.n_records} records are more than {lib.GSID_LSQ_COLUMNS_MAX}:"
                " fit fewer records together, or fewer parameters for each record"
            )
        variances = pooled_variance(measured, drift=self.has_drift)
        self.parts = [
            Part(model, s, v, band, self.n_own + self.n_shared, deadline)
            for s, v in zip(measured, variances, strict=True)
        ]
        self.deadline = deadline or Deadline()
        for part in self.parts:  # equal shares do not depend on the order of the threads
            part.plant.bound(self.deadline.moves_left / len(self.parts))
        self.n_rows = sum(part.n_rows for part in self.parts)
        if self.n_rows <= self.n:
            what = f"{self.n} unknowns need more lines than the band contains"
            raise InputError(
                what, measured[0].name, f"{self.n_rows} numbers", "widen the band, or fix parameters"
            )
        f_hz = np.concatenate([s.f_hz[part.line] for s, part in zip(measured, self.parts, strict=True)])
        self.band_hz = (float(f_hz.min()), float(f_hz.max()))

    @property
    def names(self) -> list[str]:
        """Name of each unknown; the unknowns of each record have the same names."""
        free = self.model.free_names
        return self.own_names * self.n_records + [free[i] for i in self.shared]

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """Size of each unknown, to which changes are compared."""
        least = [np.inf if name == DRIFT else least_size(self.model.parameter(name)) for name in self.names]
        return np.maximum(np.abs(x), least)

    def own(self, x: np.ndarray, record: int) -> np.ndarray:
        return x[record * self.n_own : (record + 1) * self.n_own]

    def minimise(self, solver: str, method: str, max_iter: int, pool: ThreadPoolExecutor) -> Minimum:
        """Fit from the starting values of the model; the pool simulates the records.

        Raises
        ------
        InputError
            The model cannot be simulated with its starting values.
        GsidError
            The library was built without NLopt.
        OutOfTime
            The deadline was reached before the starting values were simulated; later, the best point is
            returned.
        """
        call = _Call(self)
        call.cfg.solver, call.cfg.method, call.cfg.n_max = SOLVERS[solver], METHODS[method], max_iter
        status = call.run(pool)
        self._spend()
        if status in _NOT_OF_THE_START:
            check(status, "fitting the plant")
        try:
            check_simulation(status)
        except GsidError as error:
            raise InputError(
                "the model cannot be simulated with its starting values",
                self.parts[0].spectra.name,
                error.message,
                error.hint or "use starting values closer to those of a working axis",
            ) from error
        return call.minimum([self._at(part, at) for part, at in zip(self.parts, call.at, strict=True)])

    def _at(self, part: Part, at: Any) -> RecordAt:
        part.answer.c[0] = at.answer
        jacobian = np.empty((len(part.rows), len(self.local) + self.n_shared))
        jacobian[:, self.local] = part.rows[:, : len(self.local)]
        jacobian[:, self.shared] = part.rows[:, self.n_own : -1]
        prediction = part.answer.prediction()
        return RecordAt(part.weight, part.rows[:, -1].copy(), jacobian, prediction, bool(at.is_unsettled))

    def _spend(self) -> None:
        """Take the work of all simulations from the deadline's bound."""
        is_used_up = any(part.plant.is_used_up for part in self.parts)
        self.deadline.spend(math.inf if is_used_up else sum(part.plant.moves for part in self.parts))


class _Call:
    """Arguments and results of gsid_plant_fit."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        n, n_records = problem.n, problem.n_records
        self.records = ffi.new("gsid_plant_fit_record[]", n_records)
        self.at = ffi.new("gsid_plant_fit_at[]", n_records)
        for part, record, at in zip(problem.parts, self.records, self.at, strict=True):
            part.enter(record, at)
        self.is_own = np.zeros(len(problem.model.free_names), np.uint8)
        self.is_own[problem.local] = 1
        self.bounds = [np.array(bound, np.float64) for bound in problem.model.bounds()]
        self.cfg = cfg = ffi.new("gsid_plant_fit_cfg *")
        cfg.n_records, cfg.record, cfg.has_drift = n_records, self.records, problem.has_drift
        cfg.is_own = ffi.from_buffer("uint8_t[]", self.is_own)
        cfg.lower, cfg.upper = (ffi.from_buffer("double[]", bound) for bound in self.bounds)
        SETTINGS.to_c(cfg.settings)
        self.x, self.cov = np.empty(n), np.empty((n, n))
        self.is_open, self.is_at_bound = np.empty(n, np.uint8), np.empty(n, np.uint8)
        self.result = result = ffi.new("gsid_plant_fit_result *")
        result.x, result.at = ffi.from_buffer("double[]", self.x), self.at
        result.cov = ffi.cast("double *", ffi.from_buffer(self.cov))
        result.is_open = ffi.from_buffer("uint8_t[]", self.is_open)
        result.is_at_bound = ffi.from_buffer("uint8_t[]", self.is_at_bound)

    def run(self, pool: ThreadPoolExecutor) -> int:
        """Fit; the status.

        The fit has a thread of its own, where no Ctrl-C comes between it and its simulations: they use its
        memory. An interrupt stops the simulations, and is raised after the fit has ended.
        """
        raised: list[BaseException] = []

        def each(n: int, work: Callable[[int], None]) -> int:
            futures: list[Future] = []
            try:
                for i in range(n):
                    futures.append(pool.submit(work, i))
                for future in futures:
                    future.result()
                return 0
            except BaseException as error:
                raised.append(error)
                return 1
            finally:
                wait(futures)

        self.each = ffi.new_handle(each)
        self.cfg.each, self.cfg.user = lib.gsid_python_each, self.each
        with ThreadPoolExecutor(1) as alone:
            fitting = alone.submit(self._fit)
            while not fitting.done():
                try:
                    wait([fitting])
                except BaseException as error:
                    raised.append(error)
                    self.problem.deadline.stop()
        if raised:
            raise raised[0]
        return fitting.result()

    def _fit(self) -> int:
        return lib.gsid_plant_fit(self.cfg, self.result)

    def minimum(self, records: list[RecordAt]) -> Minimum:
        return Minimum(
            x=self.x,
            cov=self.cov,
            is_open=self.is_open.astype(bool),
            is_at_bound=self.is_at_bound.astype(bool),
            cost=self.result.cost,
            n_dof=int(self.result.n_dof),
            converged=bool(self.result.converged),
            n_iterations=self.result.n_iterations,
            records=records,
        )
