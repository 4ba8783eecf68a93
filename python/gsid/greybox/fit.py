"""Grey-box fit: the free parameters of a plant, from one or many records at once.

The cost is the sum over records and lines of the band of P |E|^2 / s^2, E the mean output's lines minus the
plant's periodic answer to the mean input, s^2 the sample variance over the P periods (GBX-1). All lines of
the band count, those that are not excited too: that is where friction and the like speak. As residual r =
[Re; Im] E sqrt(2 P / s^2) its entries have variance 1 when only noise is left, and r'r is twice that sum:
-2 log likelihood.
"""

from __future__ import annotations

import copy
import logging
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from gsid.base.errors import InputError
from gsid.base.hold import fit_readings, likelier, other_reading
from gsid.greybox.minimise import SINGULAR, Minimum, Steps, lengths, minimise
from gsid.greybox.problem import Point, Problem
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel, check_plant, transport_delay_s
from gsid.plant.periodic import Prediction
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, is_open, read_as, require_motion_of_output

_log = logging.getLogger(__name__)

INVOLVED = 0.1  # share of a parameter in a pinned direction from which on it counts as undetermined
SOLVERS = ("lm", "nlopt")
# What the cost per degree of freedom says, by method.
COST_MEANS = {
    "ml": "1 when only noise is left",
    "nls-output": "in units of the noise: a right model, too, may have more than 1",
}
METHODS = tuple(COST_MEANS)


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
        1 on average when only noise is left, if that was minimised: see `method`.
    converged : bool
        No step promises to lower the cost by 0.01; with "nls-output" in the noise of the quietest line.
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
    method : {"ml", "nls-output"}
        What was minimised; cost and residuals are in units of the noise either way. With "nls-output" the
        cost of a right model may be above that of noise by any factor: the quiet lines bear the errors that
        the loud ones cause.
    hold : {"zoh", "none"} or None
        How the records' input was taken between the samples; None where they state different holds. In
        closed loop "zoh": the reference comes from the controller's clock.
    hold_assumed : bool
        Records do not state their hold: it is the likelier of the two.
    other_delay_s : float or None
        The model's delay [s] as the same fit with the other hold finds it; None where the hold is stated, the
        model has no delay, or the other has no fit.
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
    method: str
    hold: str | None = None
    hold_assumed: bool = False
    other_delay_s: float | None = None

    @property
    def delay_s(self) -> float | None:
        """Transport delay of the model [s]; None where it has none."""
        return transport_delay_s(self.model)

    @property
    def delay_hold_uncertainty_s(self) -> float | None:
        """By how much the delay depends on the hold that was assumed [s]; None where it was stated."""
        return None if self.other_delay_s is None else abs(self.delay_s - self.other_delay_s)

    @property
    def misfit(self) -> float:
        """Cost beyond that of noise and three standard deviations of it; 0 when there is none."""
        scatter = 3 * np.sqrt(2 * self.n_dof * (1 + 2 / self.variance_dof))
        return float(max(self.cost - self.n_dof - scatter, 0.0))

    def summary(self) -> dict[str, Any]:
        """What a model file keeps of the fit."""
        keys = ("cost", "n_dof", "cost_per_dof", "converged", "n_iterations", "undetermined", "at_bound")
        keys += ("unsettled", "variance_dof", "solver", "method", "hold", "hold_assumed", "other_delay_s")
        keys += ("delay_hold_uncertainty_s",)
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


def require_motion(fit: PlantFit) -> None:
    """Refuse (InputError) a model that stands still: what it lacks acts on a motion that it does not have."""
    if not any(np.any(record.prediction.rate) for record in fit.records):
        hint = "look at the gains of the rigid body and of a controller, and at a friction that holds it"
        raise InputError("the model does not move", fit.records[0].name, None, hint)


def fit_plant(
    model: PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    band: tuple[float, float] | None = None,
    fixed: Sequence[str] = (),
    per_record: Sequence[str] = (),
    solver: str = "lm",
    method: str = "ml",
    max_iter: int = 50,
) -> PlantFit:
    """Fit the free parameters of a plant (GBX-1, GBX-2, GBX-4).

    Parameters
    ----------
    model : PlantModel
        Its values are the start.
    records : Record or Spectra, or a sequence of them
        All share the physics. Where some do not state their hold, the fit is made with both, and the likelier
        is taken ("none" within 2 in -2 log likelihood): see `PlantFit.hold_assumed`.
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
    method : {"ml", "nls-output"}
        Maximum likelihood: lines weighted by their noise; or least squares of the output's error, all lines
        alike. The first has the smaller standard deviations when the model is right. When it is not, it puts
        the error where the noise is largest, the second where the error is smallest in rms.
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
        The model cannot be simulated as it starts, or does not fit the records; an output is constant; fewer
        lines than unknowns;
        records too short for a variance.
    GsidError
        NLopt was left out of the build.
    """
    if solver not in SOLVERS:
        raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {solver!r}")
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if max_iter < 1:
        raise ValueError(f"max_iter must be at least 1, got {max_iter}")
    measured = spectra_of(records)
    require_motion_of_output(measured)
    check_plant(model)
    if is_open(measured) and not model.has_controller:

        def under(reading: str) -> PlantFit:
            return fit_plant(
                model, read_as(measured, reading), band=band, fixed=fixed, per_record=per_record,
                solver=solver, method=method, max_iter=max_iter,
            )  # fmt: skip

        return likelier_fit(fit_readings(under))
    start = copy.deepcopy(model)
    for name in fixed:
        start[name].free = False
    with ThreadPoolExecutor(_n_threads(len(measured))) as pool:
        problem = Problem(start, measured, band, tuple(per_record), pool)
        if method == "nls-output":
            return _least_error(problem, solver, max_iter)
        minimum = minimise(problem, solver, max_iter)
        dof = min(part.dof for part in problem.parts)
        cov, pinned = _covariance(minimum.point.r)
        # Weights that are estimates: the estimate scatters more than their inverse says
        # (docs/explanation/decisions.md).
        cov *= (dof - 1) / (dof - 2)
        return _fitted(problem, minimum, minimum.point, cov, pinned, solver=solver, method=method)


def likelier_fit(fits: dict[str, PlantFit]) -> PlantFit:
    """The likelier of the fits under both assumptions for records that do not state their hold.

    Parameters
    ----------
    fits : dict of PlantFit
        By assumption; one may be missing.

    Returns
    -------
    PlantFit
        Marked as assumed, the model too.
    """
    taken = likelier({reading: fit.cost for reading, fit in fits.items()})
    return as_assumed(fits[taken], fits.get(other_reading(taken)))


def as_assumed(fit: PlantFit, other: PlantFit | None) -> PlantFit:
    """Mark a fit, and its model, as made under one assumption for records that do not state their hold.

    Parameters
    ----------
    fit : PlantFit
    other : PlantFit or None
        The same fit under the other assumption, if there is one.

    Returns
    -------
    PlantFit
    """
    fit.hold_assumed, fit.other_delay_s = True, None if other is None else other.delay_s
    if fit.delay_s is None:
        fit.other_delay_s = None
    fit.model.fit = fit.summary()
    return fit


def _least_error(problem: Problem, solver: str, max_iter: int) -> PlantFit:
    """Least squares with equal weights; then what the noise makes of its answer (GBX-4)."""
    by_noise, equal = problem.weights, problem.equal_weights()
    problem.weights = equal
    minimum = minimise(problem, solver, max_iter)
    inverse, pinned = _covariance(minimum.point.r)
    problem.weights = [e**2 / n for e, n in zip(equal, by_noise, strict=True)]
    noise = problem.at(minimum.point.x).r @ inverse
    problem.weights = by_noise
    dof = min(part.dof for part in problem.parts)
    cov = (dof - 1) / dof * noise.T @ noise  # the weights are those of the mean of 1/s^2
    at_noise = problem.at(minimum.point.x)
    return _fitted(problem, minimum, at_noise, cov, pinned, solver=solver, method="nls-output")


def _n_threads(n_records: int) -> int:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return max(1, min(usable or 1, n_records))


def _fitted(
    problem: Problem,
    minimum: Minimum,
    point: Point,
    cov: np.ndarray,
    pinned: np.ndarray,
    *,
    solver: str,
    method: str,
) -> PlantFit:
    """What came out, from the minimum and the point there with the weights of the noise."""
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
        at_bound=_at_bound(problem, minimum.point),
        unsettled=[
            part.name or f"record {i}"
            for i, (part, answer) in enumerate(zip(problem.parts, point.predictions, strict=True))
            if part.is_unsettled(answer)
        ],
        records=[_record_fit(problem, point, std, i) for i in range(problem.n_records)],
        band_hz=problem.band_hz,
        variance_dof=min(part.dof for part in problem.parts),
        solver=solver,
        method=method,
        hold=problem.hold,
    )
    fit.model.fit = fit.summary()
    if fit.unsettled:
        _log.warning(
            "no steady state was found for %s: the fit is not to be trusted", ", ".join(fit.unsettled)
        )
    return fit


def _covariance(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse of R'R with the pinned directions left out, and those directions (p, n) in scaled unknowns."""
    scale = lengths(r)
    _, s, vt = np.linalg.svd(r / scale)
    good = s > SINGULAR * s[0]
    half = (vt[good].T / s[good]) / scale[:, None]
    return half @ half.T, vt[~good]


def _plain(param: Param) -> list[float | None]:
    return [param.value, param.std if np.isfinite(param.std) else None]


def _with_result(problem: Problem, x: np.ndarray, std: np.ndarray, cov: np.ndarray) -> PlantModel:
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


def _undetermined(problem: Problem, x: np.ndarray, std: np.ndarray) -> list[str]:
    unknown = np.isnan(std) | (std > problem.sizes(x))
    return list(dict.fromkeys(name for name, at in zip(problem.names, unknown, strict=True) if at))


def _at_bound(problem: Problem, point: Point) -> list[str]:
    steps = Steps(point, lengths(point.r), problem.bounds())
    return list(dict.fromkeys(name for name, at in zip(problem.names, steps.blocked, strict=True) if at))


def _record_fit(problem: Problem, point: Point, std: np.ndarray, i: int) -> RecordFit:
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


def noise_p_value(fit: PlantFit, measured: list[Spectra]) -> float:
    """Probability of a misfit as large or larger by noise alone (CMP-1), the fitted parameters allowed for.

    Parameters
    ----------
    fit : PlantFit
    measured : list of Spectra
        As fitted.

    Returns
    -------
    float
    """
    total, n_lines = 0.0, 0
    for record, one in zip(fit.records, measured, strict=True):
        use = record.line[record.line > 0]
        nu = one.n_periods - 1
        error = one.y[use] - record.prediction.Y[use]
        variance = np.maximum(one.noise_y[use], np.finfo(float).tiny)
        total += float(np.sum(nu * np.log1p(one.n_periods * np.abs(error) ** 2 / variance / nu)))
        n_lines += len(use)
    return float(stats.chi2.sf(2 * total, max(2 * n_lines - len(fit.model.free_names), 1)))


def stacked(fit: PlantFit, what: str) -> np.ndarray:
    """Residual or Jacobian of all records: all real parts, then all imaginary parts.

    Parameters
    ----------
    fit : PlantFit
    what : "residual" or "jacobian"

    Returns
    -------
    (2 m, columns) ndarray, m the number of lines of all records
    """
    halves = [np.split(getattr(record, what).reshape(2 * len(record.line), -1), 2) for record in fit.records]
    return np.vstack([re for re, _ in halves] + [im for _, im in halves])


def whitened(fit: PlantFit, columns: list[np.ndarray]) -> np.ndarray:
    """Columns of a probe, weighted as the fit's residuals are and in the order of `stacked`.

    Parameters
    ----------
    fit : PlantFit
    columns : list of (q, K) complex ndarrays
        Lines 0 .. N/2, one entry per record.

    Returns
    -------
    (2 m, q) ndarray
    """
    parts = [
        (lines[:, record.line] * record.weight).T for lines, record in zip(columns, fit.records, strict=True)
    ]
    together = np.vstack(parts)
    real = np.concatenate([record.line == 0 for record in fit.records])
    return np.vstack([together.real, np.where(real[:, None], 0.0, together.imag)])
