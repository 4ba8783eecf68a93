"""Grey-box fit: the free parameters of a plant, from one or many records at once.

The cost is the sum over records and lines of the band of P |E|^2 / s^2, E the mean output's lines minus the
plant's periodic answer to the mean input, s^2 the sample variance over the P periods (GBX-1). All lines of
the band count, those that are not excited too: that is where friction and the like speak. As residual r =
[Re; Im] E sqrt(2 P / s^2) its entries have variance 1 when only noise is left, and r'r is twice that sum:
-2 log likelihood.

Levenberg-Marquardt in parameters scaled by the length of their columns; the step is found from the triangle
of a QR factorisation (GBX-2), its singular values say what the data do not determine.
"""

from __future__ import annotations

import copy
import logging
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import ndimage

from gsid._lib import check, ffi, lib
from gsid.errors import GsidError, InputError
from gsid.fit import in_band
from gsid.plant import Param, PlantModel
from gsid.plant_periodic import PeriodicPlant, Prediction
from gsid.record import Record
from gsid.spectra import Spectra, lines_of, spectra

_log = logging.getLogger("gsid.greybox")

DOF_WANTED = 20  # variances with fewer degrees of freedom are pooled over neighbouring lines
SAME_LEVEL = 1.05  # records whose inputs' rms differ by less are of one level
SETTLED, UNSETTLED = 1e-2, 0.1  # what may change in a period, over the mean's noise: sought, and reported
FLOOR = 1e-7  # of the largest line: an output repeats no better than this

DECREASE = 0.01  # stop when a step promises less, in units of the cost
SILENT = (
    1e-3  # a parameter is pinned when a change by its own size moves the residuals less than this, all told
)
SINGULAR = 1e-6  # directions with a singular value this far below the largest are pinned
INVOLVED = 0.1  # share of a parameter in a pinned direction from which on it counts as undetermined
DAMPING_START, DAMPING_MOST = 1e-3, 1e10

DRIFT = "drift"
SOLVERS = ("lm", "nlopt")


@dataclass(eq=False)
class RecordFit:
    """What the fit leaves of one record.

    Attributes
    ----------
    name : str
    line : (k,) int
        Lines of the band.
    weight : (k,) float64
        sqrt(2 P / s^2), s^2 the variance of one period's line, its scatter allowed for.
    residual : (2 k,) float64
        [Re; Im] of the error times the weight, of variance 1 when only noise is left; real lines have no
        second part and stand there with 0.
    jacobian : (2 k, n_free) float64
        Derivatives of the plant's output by the free parameters, times the weight.
    prediction : Prediction
    params : dict of Param
        Parameters of this record alone.
    """

    name: str
    line: np.ndarray
    weight: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    prediction: Prediction
    params: dict[str, Param]


@dataclass(eq=False, repr=False)
class PlantFit:
    """A fitted plant.

    Attributes
    ----------
    model : PlantModel
        With standard deviations and covariance.
    cost : float
        r'r: -2 log likelihood.
    n_dof : int
        Residuals less unknowns.
    cost_per_dof : float
        1 on average when only noise is left.
    converged : bool
        No step promises to lower the cost by 0.01.
    n_iterations : int
    undetermined : list of str
        Parameters that the data do not tell: pinned where they were (their standard deviation is NaN), or
        uncertain by more than their own size and their typical one.
    at_bound : list of str
        Parameters that the data press against a bound.
    unsettled : list of str
        Records whose steady state was not found to a tenth of their noise.
    records : list of RecordFit
    band_hz : (lo, hi)
        Lowest and highest line used [Hz].
    variance_dof : float
        Degrees of freedom of the variances that weigh.
    solver : {"lm", "nlopt"}
    """

    model: PlantModel
    cost: float
    n_dof: int
    cost_per_dof: float
    converged: bool
    n_iterations: int
    undetermined: list[str]
    at_bound: list[str]
    unsettled: list[str]
    records: list[RecordFit]
    band_hz: tuple[float, float]
    variance_dof: float
    solver: str

    def summary(self) -> dict[str, Any]:
        """What a model file keeps of the fit."""
        keys = ("cost", "n_dof", "cost_per_dof", "converged", "n_iterations", "undetermined", "at_bound")
        keys += ("unsettled", "variance_dof", "solver")
        own = [
            {"name": r.name} | {name: _plain(p) for name, p in r.params.items()}
            for r in self.records
            if r.params
        ]
        return {key: getattr(self, key) for key in keys} | {"band_hz": list(self.band_hz), "per_record": own}

    def __repr__(self) -> str:
        lines = [repr(self.model)]
        state = "converged" if self.converged else "NOT converged"
        lines.append(f"  {self.n_dof} degrees of freedom, {state} after {self.n_iterations} iterations")
        for record in self.records:
            lines += [f"  {record.name or 'record'}: {name} {param}" for name, param in record.params.items()]
        for words, names in (
            ("not determined by the data", self.undetermined),
            ("at a bound", self.at_bound),
            ("no steady state found", self.unsettled),
        ):
            if names:
                lines.append(f"  {words}: {', '.join(names)}")
        return "\n".join(lines)


def fit_plant(
    model: PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    band: tuple[float, float] | None = None,
    fixed: Sequence[str] = (),
    per_record: Sequence[str] = (),
    solver: str = "lm",
    max_iter: int = 50,
) -> PlantFit:
    """Fit the free parameters of a plant (GBX-1, GBX-2).

    Parameters
    ----------
    model : PlantModel
        Its values are the start.
    records : Record or Spectra, or a sequence of them
        All share the physics.
    band : (lo, hi), optional
        Hz; default for each record from its first to its last excited line, and 0 Hz for an angle in closed
        loop. As long as the band leaves 0 Hz out, each record has an offset of its own.
    fixed : sequence of str
        Parameters ("effect.parameter") to leave as they are, besides those that the model holds fixed.
    per_record : sequence of str
        What each record has for itself: free parameters of the model, and "drift": by how much the output
        moves away in a period.
    solver : {"lm", "nlopt"}
        Levenberg-Marquardt, or NLopt's sequential quadratic programming.
    max_iter : int
        Steps at most.

    Returns
    -------
    PlantFit

    Raises
    ------
    ValueError
        Wrong arguments, or no line in the band.
    InputError
        The model cannot be simulated as it starts, or does not fit the records; fewer lines than unknowns;
        records too short for a variance.
    GsidError
        NLopt was left out of the build.
    """
    if solver not in SOLVERS:
        raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {solver!r}")
    if max_iter < 1:
        raise ValueError(f"max_iter must be at least 1, got {max_iter}")
    several = [records] if isinstance(records, Record | Spectra) else list(records)
    if not several:
        raise ValueError("no record was given")
    start = copy.deepcopy(model)
    for name in fixed:
        start[name].free = False
    measured = [r if isinstance(r, Spectra) else spectra(r) for r in several]
    with ThreadPoolExecutor(_n_threads(len(measured))) as pool:
        problem = _Problem(start, measured, band, tuple(per_record), pool)
        return _fitted(problem, _minimise(problem, solver, max_iter), solver)


def _n_threads(n_records: int) -> int:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return max(1, min(usable or 1, n_records))


# ---- weights -----------------------------------------------------------------------------------------


def pooled_variance(measured: Sequence[Spectra]) -> list[tuple[np.ndarray, float]]:
    """Variance of one period's output lines, pooled (GBX-3).

    Over records of one period, sample rate and level of the input (5 %), and where that leaves fewer than
    20 degrees of freedom over neighbouring lines too.

    Parameters
    ----------
    measured : sequence of Spectra

    Returns
    -------
    list of ((K,) ndarray, float)
        For each record: variance of lines 0 .. N/2, and its degrees of freedom.

    Raises
    ------
    InputError
        The records together have too few periods.
    """
    groups: list[list[Spectra]] = []
    for one in measured:
        for group in groups:
            if _alike(one, group[0]):
                group.append(one)
                break
        else:
            groups.append([one])
    pooled = [(group, _pool(group)) for group in groups]
    return [
        next(found for group, found in pooled if any(one is other for other in group)) for one in measured
    ]


def _level(one: Spectra) -> float:
    return float(np.linalg.norm(one.u[one.excited]))


def _alike(a: Spectra, b: Spectra) -> bool:
    same = a.period_samples == b.period_samples and a.fs_hz == b.fs_hz
    return same and 1 / SAME_LEVEL < _level(a) / _level(b) < SAME_LEVEL


def _pool(group: list[Spectra]) -> tuple[np.ndarray, float]:
    dof = float(sum(one.n_periods - 1 for one in group))
    variance = sum((one.n_periods - 1) * one.var_y for one in group) / dof
    if dof < DOF_WANTED:
        inner = variance[1:-1]  # the ends, real lines, have variances of their own size
        half = min(int(np.ceil((DOF_WANTED / dof - 1) / 2)), (len(inner) - 1) // 2)
        variance[1:-1] = ndimage.uniform_filter1d(inner, 2 * half + 1, mode="reflect")
        dof *= 2 * half + 1
    if dof <= 2:
        hint = "measure more periods: at least 3 in all, or longer ones"
        raise InputError(
            "too few periods and lines for a variance", group[0].name, f"{dof:g} degrees of freedom", hint
        )
    return variance, dof


# ---- residuals ---------------------------------------------------------------------------------------


class _Part:
    """One record in the problem: its weights, its plant, and what it has for itself."""

    def __init__(
        self,
        model: PlantModel,
        measured: Spectra,
        variance: tuple[np.ndarray, float],
        band: tuple[float, float] | None,
        has_drift: bool,
    ) -> None:
        s = measured
        self.name = s.name
        self.plant = PeriodicPlant.of(model, s)
        self.line = np.flatnonzero(lines_used(model, s, band))
        self.y = s.y[self.line]
        self.dof = variance[1]
        floor = (FLOOR * float(np.max(np.abs(self.y)))) ** 2
        self.variance = np.maximum(variance[0][self.line], max(floor, np.finfo(float).tiny))
        self.noise_rms = float(np.sqrt(np.sum(self.variance) / (2 * s.n_periods)))  # of the mean, over time
        self.plant.tolerance = SETTLED * self.noise_rms
        real = self.line == 0
        # The mean of 1/s^2 is nu / (nu - 1) times that of 1/variance.
        scale = (self.dof - 1) / self.dof * np.where(real, 1, 2)
        self.weight = np.sqrt(scale * s.n_periods / self.variance)
        self.n_rows = 2 * len(self.line) - int(np.count_nonzero(real))
        n = s.period_samples
        ramps = np.tile(np.arange(n) / n - (n - 1) / (2 * n), (int(has_drift), 1))
        self.drift = lines_of(ramps)[:, self.line]  # no row without drift

    def whiten(self, lines: np.ndarray) -> np.ndarray:
        """[Re; Im] of (..., k) lines times the weight."""
        weighted = lines * self.weight
        return np.concatenate([weighted.real, np.where(self.line == 0, 0.0, weighted.imag)], axis=-1)


def lines_used(model: PlantModel, s: Spectra, band: tuple[float, float] | None) -> np.ndarray:
    """(K,) which lines of a record count in a fit of a plant and in a comparison with it.

    Parameters
    ----------
    model : PlantModel
    s : Spectra
    band : (lo, hi) or None
        Hz; None: see `fit_plant`.

    Raises
    ------
    ValueError
        None does.
    """
    if band is None:
        f_excited = s.f_hz[s.excited]
        # A position loop and its reference have one zero: there the mean angle says something.
        common_zero = model.output == "angle" and model.has_controller
        band = (0.0 if common_zero else f_excited[0], f_excited[-1])
    use = in_band(s.f_hz, band)
    use &= 2 * s.line < s.period_samples
    if model.output == "angle" and not model.looks_at_angle:
        use[0] = False  # nothing says where the axis stands
    if not np.any(use):
        raise ValueError("no line between 0 and half the sample rate lies in the band")
    return use


@dataclass(eq=False)
class _Point:
    """Residuals and Jacobian at one set of unknowns, reduced to a triangle."""

    x: np.ndarray
    cost: float
    residuals: list[np.ndarray]
    jacobians: list[np.ndarray]
    predictions: list[Prediction]
    r: np.ndarray = field(repr=False)  # (n, n): the columns' triangle
    q: np.ndarray = field(repr=False)  # (n,): the residual along it


class _Problem:
    """Unknowns x: those of each record in turn (parameters, then the drift), then the shared ones."""

    def __init__(
        self,
        model: PlantModel,
        measured: list[Spectra],
        band: tuple[float, float] | None,
        per_record: tuple[str, ...],
        pool: ThreadPoolExecutor,
    ) -> None:
        self.model, self.pool = model, pool
        free = model.free_names
        for name in per_record:
            if name != DRIFT and name not in free:
                known = ", ".join([*free, DRIFT])
                raise ValueError(f"per_record names {name!r}, which is none of the free parameters: {known}")
        self.local = [i for i, name in enumerate(free) if name in per_record]
        self.shared = [i for i, name in enumerate(free) if name not in per_record]
        if not self.shared:
            raise ValueError("no free parameter is shared by the records: there is nothing to fit in common")
        has_drift = DRIFT in per_record
        self.own_names = [free[i] for i in self.local] + [DRIFT] * has_drift
        variances = pooled_variance(measured)
        self.parts = [_Part(model, s, v, band, has_drift) for s, v in zip(measured, variances, strict=True)]
        # With play, what does not settle soon rattles: waiting is dear and in vain.
        self.has_joint = any(effect.id == "gear_backlash" for effect in model.effects)
        self.n_records, self.n_own, self.n_shared = len(self.parts), len(self.own_names), len(self.shared)
        self.n = self.n_records * self.n_own + self.n_shared
        self.n_rows = sum(part.n_rows for part in self.parts)
        if self.n_rows <= self.n:
            what = f"{self.n} unknowns need more lines than the band holds"
            raise InputError(
                what, measured[0].name, f"{self.n_rows} numbers", "widen the band, or fix parameters"
            )
        f_hz = np.concatenate([s.f_hz[part.line] for s, part in zip(measured, self.parts, strict=True)])
        self.band_hz = (float(f_hz.min()), float(f_hz.max()))

    @property
    def names(self) -> list[str]:
        """Name of each unknown; a record's own stand for all records' together."""
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
        """What a change of each unknown is large against: a strength may well be zero, a shape may not."""
        typical = []
        for name in self.names:
            known = None if name == DRIFT else self.model.parameter(name)
            typical.append(np.inf if known is None else 0 if known.null_value is None else abs(known.typical))
        return np.maximum(np.abs(x), typical)

    def own(self, x: np.ndarray, record: int) -> np.ndarray:
        return x[record * self.n_own : (record + 1) * self.n_own]

    def values(self, x: np.ndarray, record: int) -> np.ndarray:
        """Free parameters of the plant for one record."""
        values = np.empty(len(self.local) + self.n_shared)
        values[self.local] = self.own(x, record)[: len(self.local)]
        values[self.shared] = x[self.n - self.n_shared :]
        return values

    def at(self, x: np.ndarray) -> _Point:
        """Simulate all records.

        Raises
        ------
        GsidError
            The values cannot be simulated.
        """
        simulated = list(self.pool.map(lambda i: self._record(x, i), range(self.n_records)))
        residuals, jacobians, predictions, rows = (list(column) for column in zip(*simulated, strict=True))
        cost = float(sum(r @ r for r in residuals))
        if not np.isfinite(cost):
            raise GsidError(lib.GSID_E_NONFINITE, "the plant's answer is out of the range of numbers")
        r, q = self._reduce(rows)
        r[:, np.linalg.norm(r, axis=0) * self.sizes(x) < SILENT] = 0
        return _Point(x, cost, residuals, jacobians, predictions, r, q)

    def keep(self) -> None:
        """The point simulated last is where the search goes on from."""
        for part in self.parts:
            part.plant.keep()

    def _record(self, x: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray, Prediction, np.ndarray]:
        part, n_local = self.parts[i], len(self.local)
        answer = part.plant.run(self.values(x, i), sensitivities=True, patient=not self.has_joint)
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


# ---- minimisation ------------------------------------------------------------------------------------


@dataclass
class _Minimum:
    point: _Point
    converged: bool
    n_iterations: int


def _minimise(problem: _Problem, solver: str, max_iter: int) -> _Minimum:
    try:
        start = problem.at(problem.start())
    except GsidError as error:
        raise InputError(
            "the model cannot be simulated as it starts",
            problem.parts[0].name,
            error.message,
            error.hint or "start from other values, nearer to those of a working axis",
        ) from error
    return (
        _levenberg_marquardt(problem, start, max_iter) if solver == "lm" else _nlopt(problem, start, max_iter)
    )


def _lengths(r: np.ndarray) -> np.ndarray:
    """Lengths of the Jacobian's columns; 1 for a column of zeros."""
    lengths = np.linalg.norm(r, axis=0)
    return np.where(lengths > 0, lengths, 1.0)


class _Steps:
    """Steps from one point, for any damping: singular values of the scaled triangle, pinned directions left
    out."""

    def __init__(self, point: _Point, scale: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]) -> None:
        self.point, self.lower, self.upper, self.scale = point, *bounds, scale
        downhill = point.r.T @ point.q
        self.blocked = ((point.x <= self.lower) & (downhill < 0)) | ((point.x >= self.upper) & (downhill > 0))
        u, s, vt = np.linalg.svd(point.r[:, ~self.blocked] / scale[~self.blocked], full_matrices=False)
        good = s > SINGULAR * (s[0] if len(s) else 0)
        self.s, self.vt, self.along = s[good], vt[good], u[:, good].T @ point.q

    @property
    def decrease(self) -> float:
        """Of the cost that a full step promises. (Cut off at the bounds, a long one may promise nothing.)"""
        return float(self.along @ self.along)

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        """Unknowns after a step within the bounds, and the decrease of the cost that it promises."""
        x = self.point.x.copy()
        x[~self.blocked] += (
            self.vt.T @ (self.s / (self.s**2 + damping) * self.along) / self.scale[~self.blocked]
        )
        x = np.clip(x, self.lower, self.upper)
        left = self.point.q - self.point.r @ (x - self.point.x)
        return x, float(self.point.q @ self.point.q - left @ left)


def _levenberg_marquardt(problem: _Problem, point: _Point, max_iter: int) -> _Minimum:
    """Marquardt's scaling, Nielsen's rule for the damping; a step that cannot be simulated has failed."""
    bounds, scale, damping, growth = problem.bounds(), _lengths(point.r), DAMPING_START, 2.0
    problem.keep()
    for i in range(max_iter):
        scale = np.maximum(scale, _lengths(point.r))
        steps = _Steps(point, scale, bounds)
        if steps.decrease < DECREASE:
            return _Minimum(point, True, i)
        while True:
            x, promised = steps.step(damping)
            trial = _try(problem, x) if promised > 0 else None
            if trial is not None and trial.cost < point.cost:
                break
            damping, growth = damping * growth, growth * 2
            if damping > DAMPING_MOST:
                # Where rounding and events rule, no step helps: that is the minimum as far as it can be
                # found.
                return _Minimum(point, steps.decrease < 1e-6 * point.cost, i)
        gain = (point.cost - trial.cost) / promised
        damping, growth = damping * max(1 / 3, 1 - (2 * gain - 1) ** 3), 2.0
        point = trial
        problem.keep()
    return _Minimum(point, _Steps(point, scale, bounds).decrease < DECREASE, max_iter)


def _try(problem: _Problem, x: np.ndarray) -> _Point | None:
    try:
        return problem.at(x)
    except GsidError as error:
        if error.code == lib.GSID_E_NO_MEMORY:
            raise
        return None


def _nlopt(problem: _Problem, start: _Point, max_iter: int) -> _Minimum:
    """NLopt in scaled unknowns; what cannot be simulated is a high plateau."""
    scale, (lower, upper) = _lengths(start.r), problem.bounds()
    best, n_calls, failure = start, 0, []

    def objective(n: int, z: Any, gradient: Any, _: Any) -> float:
        nonlocal best, n_calls
        n_calls += 1
        try:
            point = _try(problem, np.clip(np.frombuffer(ffi.buffer(z, 8 * n)).copy() / scale, lower, upper))
        except BaseException as error:  # it must not cross the C library
            failure.append(error)
            point = None
        slope = np.zeros(n) if point is None else -2 * (point.r.T @ point.q) / scale
        if gradient != ffi.NULL:
            ffi.memmove(gradient, slope, 8 * n)
        if point is None:
            return 10 * start.cost
        best = point if point.cost < best.cost else best
        return point.cost

    callback = ffi.callback("double(unsigned, const double *, double *, void *)", objective)
    x, least = start.x * scale, ffi.new("double *")
    pointers = [ffi.from_buffer("double[]", row) for row in (lower * scale, upper * scale, x)]
    status = lib.gsid_minimise(
        problem.n, callback, ffi.NULL, *pointers[:2], DECREASE, max_iter, pointers[2], least
    )
    if failure:
        raise failure[0]
    check(status, "minimising by NLopt")
    left = _Steps(best, _lengths(best.r), (lower, upper)).decrease
    return _Minimum(best, left < DECREASE, n_calls)


# ---- what it says ------------------------------------------------------------------------------------


def _fitted(problem: _Problem, minimum: _Minimum, solver: str) -> PlantFit:
    point, dof = minimum.point, min(part.dof for part in problem.parts)
    cov, pinned = _covariance(point.r)
    # Weights that are estimates: the estimate scatters more than their inverse says (docs/decisions.md).
    cov *= (dof - 1) / (dof - 2)
    n_pinned = int(np.linalg.matrix_rank(pinned)) if len(pinned) else 0
    std = np.sqrt(np.diag(cov))
    std[np.any(np.abs(pinned) > INVOLVED, axis=0)] = np.nan
    n_dof = problem.n_rows - problem.n + n_pinned
    fit = PlantFit(
        model=_with_result(problem, point.x, std, cov),
        cost=point.cost,
        n_dof=n_dof,
        cost_per_dof=point.cost / n_dof,
        converged=minimum.converged,
        n_iterations=minimum.n_iterations,
        undetermined=_undetermined(problem, point.x, std),
        at_bound=_at_bound(problem, point),
        unsettled=[
            part.name or f"record {i}"
            for i, (part, answer) in enumerate(zip(problem.parts, point.predictions, strict=True))
            if answer.residual > UNSETTLED * part.noise_rms
        ],
        records=[_record_fit(problem, point, std, i) for i in range(problem.n_records)],
        band_hz=problem.band_hz,
        variance_dof=dof,
        solver=solver,
    )
    fit.model.fit = fit.summary()
    if fit.unsettled:
        _log.warning(
            "no steady state was found for %s: the fit is not to be trusted", ", ".join(fit.unsettled)
        )
    return fit


def _covariance(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse of R'R with the pinned directions left out, and those directions (p, n) in scaled unknowns."""
    scale = _lengths(r)
    _, s, vt = np.linalg.svd(r / scale)
    good = s > SINGULAR * s[0]
    half = (vt[good].T / s[good]) / scale[:, None]
    return half @ half.T, vt[~good]


def _plain(param: Param) -> list[float | None]:
    return [param.value, param.std if np.isfinite(param.std) else None]


def _with_result(problem: _Problem, x: np.ndarray, std: np.ndarray, cov: np.ndarray) -> PlantModel:
    """The model with the shared values, and the mean over records of those that each has for itself."""
    model = copy.deepcopy(problem.model)
    own = np.arange(problem.n_records * problem.n_own).reshape(problem.n_records, problem.n_own)
    # Each free parameter as a mean of unknowns, so that the covariance follows.
    mean = np.zeros((len(problem.local) + problem.n_shared, problem.n))
    for k, i in enumerate(problem.local):
        mean[i, own[:, k]] = 1 / problem.n_records
    for k, i in enumerate(problem.shared):
        mean[i, problem.n - problem.n_shared + k] = 1
    model.cov = mean @ cov @ mean.T
    unknown = np.any((mean > 0) & np.isnan(std), axis=1)
    for i, name in enumerate(model.free_names):
        model[name].value = float(mean[i] @ x)
        model[name].std = float("nan") if unknown[i] else float(np.sqrt(model.cov[i, i]))
    return model


def _undetermined(problem: _Problem, x: np.ndarray, std: np.ndarray) -> list[str]:
    unknown = np.isnan(std) | (std > problem.sizes(x))
    return list(dict.fromkeys(name for name, at in zip(problem.names, unknown, strict=True) if at))


def _at_bound(problem: _Problem, point: _Point) -> list[str]:
    steps = _Steps(point, _lengths(point.r), problem.bounds())
    return list(dict.fromkeys(name for name, at in zip(problem.names, steps.blocked, strict=True) if at))


def _record_fit(problem: _Problem, point: _Point, std: np.ndarray, i: int) -> RecordFit:
    part = problem.parts[i]
    values, sigmas = problem.own(point.x, i), problem.own(std, i)
    return RecordFit(
        name=part.name,
        line=part.line,
        weight=part.weight,
        residual=point.residuals[i],
        jacobian=point.jacobians[i],
        prediction=point.predictions[i],
        params={
            name: Param(float(value), True, float(sigma))
            for name, value, sigma in zip(problem.own_names, values, sigmas, strict=True)
        },
    )
