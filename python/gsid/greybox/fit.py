"""Grey-box fit: estimate the free parameters of a plant from one or more records.

The cost is the sum of P |E|^2 / s^2 over all records and all lines of the band (GBX-1). E is the spectrum of
the mean output minus the plant's periodic response to the mean input. s^2 is the sample variance over the P
periods. Lines that are not excited count too, because friction and other nonlinear effects appear there. The
residual is r = [Re; Im] E sqrt(2 P / s^2). Its entries have variance 1 when only noise remains. r'r is twice
the cost, which is -2 log likelihood.
"""

from __future__ import annotations

import copy
import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid.base.deadline import Deadline
from gsid.base.errors import GsidError, InputError
from gsid.base.hold import fit_readings, likelier, other_reading
from gsid.base.plottable import Plottable
from gsid.base.tables import paragraphs
from gsid.base.threads import n_threads, with_one_thread_for_algebra
from gsid.greybox.linear_start import linear_start
from gsid.greybox.problem import METHODS, SOLVERS, Minimum, Problem
from gsid.greybox.settings import SETTINGS
from gsid.greybox.weights import whiten
from gsid.models.misfit import Errors, misfit
from gsid.plant.effect import Param
from gsid.plant.mean_input import with_mean_input
from gsid.plant.model import PlantModel, check_plant, transport_delay_s
from gsid.plant.periodic import Prediction
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, is_open, read_as, require_motion_of_output

_log = logging.getLogger(__name__)

# Meaning of the cost per degree of freedom, by method.
COST_MEANS = {
    "ml": "1 when only noise is left",
    "nls-output": "in units of the noise; a correct model may have more than 1",
}


CANNOT_FIT = (GsidError, InputError, np.linalg.LinAlgError)
"""A model cannot be simulated or fitted with these values: what a trial fit may end with."""


@dataclass(eq=False)
class RecordFit:
    """Residual, Jacobian and predicted response of one record after the fit.

    Attributes
    ----------
    name : str
    line : (k,) int
        Lines of the band.
    weight : (k,) float64
        sqrt(2 P / s^2), where s^2 is the variance of a line over the periods, corrected for its scatter.
    residual : (2 k,) float64
        [Re; Im] of the error times the weight. The variance is 1 when only noise remains. The imaginary part
        of a real line is 0.
    jacobian : (2 k, n_free) float64
        Derivatives of the plant's output with respect to the free parameters, times the weight.
    prediction : Prediction
    params : dict of Param
        Parameters of this record alone.
    spectra : Spectra
        The record that was fitted, with the hold that the fit assumed.
    """

    name: str
    line: np.ndarray
    weight: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    prediction: Prediction
    params: dict[str, Param]
    spectra: Spectra

    @property
    def errors(self) -> Errors:
        """Errors of the mean output at the lines above 0 Hz, without uncertainty of the model (CMP-1)."""
        one, use = self.spectra, self.line[self.line > 0]
        variance = one.noise_y[use] / one.n_periods
        return Errors(
            error=one.y[use] - self.prediction.Y[use],
            var_mean=variance,
            dof=np.full(len(use), one.n_periods - 1.0),
            var_weight=variance,
            real=np.zeros(len(use), bool),
            by_model=np.zeros((len(use), 0), complex),
        )

    def cost_of(self, model: PlantModel) -> float:
        """Cost of another model for this record, with the lines and weights of this fit.

        Parameters
        ----------
        model : PlantModel

        Returns
        -------
        float

        Raises
        ------
        GsidError
            The model cannot be simulated.
        """
        return self.cost_of_output(model.predict(self.spectra).Y)

    def cost_of_output(self, lines: np.ndarray) -> float:
        """Cost of another output, with the lines and weights of this fit.

        Parameters
        ----------
        lines : (K,) complex ndarray
            Lines 0 .. N/2.
        """
        error = (self.spectra.y - lines)[self.line]
        return float(np.sum(np.abs(error * self.weight) ** 2))

    def whitened(self, lines: np.ndarray) -> np.ndarray:
        """Weight lines like the residual.

        Parameters
        ----------
        lines : (..., K) complex ndarray
            Lines 0 .. N/2.

        Returns
        -------
        (..., 2 k) ndarray
            [Re; Im].
        """
        return whiten(lines[..., self.line], self.weight, self.line == 0)


@dataclass(eq=False, repr=False)
class PlantFit(Plottable):
    """A fitted plant.

    Attributes
    ----------
    model : PlantModel
        Fitted model with standard deviations and covariance.
    cost : float
        r'r: -2 log likelihood.
    n_dof : int
        Number of residuals minus number of unknowns.
    cost_per_dof : float
        1 on average when only noise remains and the method is "ml"; see `method`.
    converged : bool
        True if no step is predicted to lower the cost by 0.01. With "nls-output" the cost is in units of the
        noise of the quietest line.
    n_iterations : int
    undetermined : list of str
        Parameters that the data do not determine. They are either held at their starting value (standard
        deviation NaN), or have a standard deviation above both their value and their typical value.
    at_bound : list of str
        Parameters whose estimate lies at a bound.
    unsettled : list of str
        Records whose simulated steady state changes from period to period by more than a tenth of the noise.
    records : list of RecordFit
    band_hz : (lo, hi)
        Lowest and highest line used [Hz].
    variance_dof : float
        Degrees of freedom of the variances used as weights.
    solver : {"lm", "nlopt"}
    method : {"ml", "nls-output"}
        Minimised criterion. Cost and residuals are in units of the noise with both. With "nls-output" the
        cost of a correct model may exceed that of noise by any factor, because lines with low noise carry
        parameter errors caused by lines with high noise.
    hold : {"zoh", "none"} or None
        Assumed course of the input between the samples; None if the records state different holds. In closed
        loop it is "zoh", because the controller updates the reference at its own sample rate.
    hold_assumed : bool
        True if the records do not state their hold; then `hold` is the likelier of the two.
    other_delay_s : float or None
        Delay [s] estimated by the same fit with the other hold. None if the records state the hold, the model
        has no delay, or the fit with the other hold failed.
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
        """Transport delay of the model [s]; None if it has none."""
        return transport_delay_s(self.model)

    @property
    def delay_hold_uncertainty_s(self) -> float | None:
        """Difference of the delay between the two holds [s]; None if the records state the hold."""
        return None if self.other_delay_s is None else abs(self.delay_s - self.other_delay_s)

    @property
    def noise_p_value(self) -> float:
        """Probability that noise alone causes a misfit this large or larger (CMP-1).

        The number of fitted parameters is taken into account.
        """
        found = misfit(Errors.joined([record.errors for record in self.records]))
        return found.p_value_of_fit(len(self.model.free_names))

    @property
    def residual(self) -> np.ndarray:
        """Residuals of all records, (2 m,), m lines in total: all real parts, then all imaginary parts."""
        return _stacked([record.residual for record in self.records])

    @property
    def jacobian(self) -> np.ndarray:
        """Jacobians of all records, (2 m, n_free), in the order of `residual`."""
        return _stacked([record.jacobian for record in self.records])

    def whitened(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """Weight changes of the output like the residuals.

        Parameters
        ----------
        columns : sequence of (q, K) complex ndarrays
            Lines 0 .. N/2 of q changes, one array per record.

        Returns
        -------
        (2 m, q) ndarray
            In the order of `residual`.
        """
        return _stacked([record.whitened(q).T for record, q in zip(self.records, columns, strict=True)])

    def cost_of(self, model: PlantModel) -> float:
        """Cost of another model for the same records, with the lines and weights of this fit.

        Parameters
        ----------
        model : PlantModel

        Returns
        -------
        float

        Raises
        ------
        GsidError
            The model cannot be simulated.
        """
        return sum(record.cost_of(model) for record in self.records)

    def summary(self) -> dict[str, Any]:
        """Return the entries about the fit that a model file contains."""
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
        return "\n".join([repr(self.model), *(f"  {line}" for line in self._lines())])

    def _repr_html_(self) -> str:
        means = f"The cost per degree of freedom is {COST_MEANS[self.method]}."
        return self.model._repr_html_() + paragraphs(means, *self._lines())

    def _lines(self) -> list[str]:
        state = "converged" if self.converged else "NOT converged"
        lines = [f"{self.n_dof} degrees of freedom, {state} after {self.n_iterations} iterations"]
        for record in self.records:
            lines += [f"{record.name or 'record'}: {name} {param}" for name, param in record.params.items()]
        for words, names in (
            ("not determined by the data", self.undetermined),
            ("at a bound", self.at_bound),
            ("no steady state found", self.unsettled),
        ):
            if names:
                lines.append(f"{words}: {', '.join(names)}")
        return lines


def _stacked(parts: list[np.ndarray]) -> np.ndarray:
    """Stack [Re; Im] of each record: all real parts, then all imaginary parts."""
    halves = [np.split(part, 2) for part in parts]
    return np.concatenate([re for re, _ in halves] + [im for _, im in halves])


def require_motion(fit: PlantFit) -> None:
    """Raise InputError if the simulated axis does not move: effects cannot be judged without motion."""
    if not any(np.any(record.prediction.rate) for record in fit.records):
        hint = "check the gains of the rigid body and the controller, and whether friction holds the axis"
        raise InputError("the model does not move", fit.records[0].name, None, hint)


@with_one_thread_for_algebra
def fit_plant(
    model: PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    band: tuple[float, float] | None = None,
    fixed: Sequence[str] = (),
    per_record: Sequence[str] = (),
    solver: str = "lm",
    method: str = "ml",
    max_iter: int = SETTINGS.max_iter,
    deadline: Deadline | None = None,
    quiet: bool = False,
) -> PlantFit:
    """Fit the free parameters of a plant to records (GBX-1, GBX-2, GBX-4).

    Parameters
    ----------
    model : PlantModel
        Plant model. Its parameter values are the starting values.
    records : Record or Spectra, or a sequence of them
        Records of the same plant. If a record does not state its hold, the fit is made with both holds and
        the likelier is used ("none" if they differ by less than 2 in -2 log likelihood); see
        `PlantFit.hold_assumed`.
    band : (lo, hi), optional
        Band [Hz]. By default it extends from the first to the last excited line of each record, and includes
        0 Hz for an angle in closed loop. If the band excludes 0 Hz, each record may have its own offset.
    fixed : sequence of str
        Further parameters ("effect.parameter") to hold fixed, in addition to those fixed in the model.
    per_record : sequence of str
        Parameters estimated for each record separately: free parameters of the model, and "drift", the
        change of the output over one period.
    solver : {"lm", "nlopt"}
        Levenberg-Marquardt, or NLopt's sequential quadratic programming.
    method : {"ml", "nls-output"}
        "ml" is maximum likelihood: each line is weighted by its noise. "nls-output" is least squares of the
        output error with equal weights. "ml" has the smaller standard deviations when the model is correct.
        When the model is not correct, "ml" moves the error to lines with high noise, while "nls-output"
        minimises the rms error.
    max_iter : int
        Maximum number of iterations.
    deadline : Deadline, optional
        Time at which the search ends with the best values so far, not converged. A running simulation is
        stopped.
    quiet : bool
        Do not log that a simulation reaches no steady state: for one of several fits, of which only some are
        reported.

    Returns
    -------
    PlantFit

    Raises
    ------
    ValueError
        An argument is invalid, or the band contains no line.
    InputError
        The model cannot be simulated with its starting values, or its units or sample rate do not match the
        records; an output is constant; there are fewer lines than unknowns; the records are too short to
        estimate a variance.
    GsidError
        The library was built without NLopt.
    OutOfTime
        The deadline was reached before the starting values were simulated.
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
                solver=solver, method=method, max_iter=max_iter, deadline=deadline, quiet=quiet,
            )  # fmt: skip

        return likelier_fit(fit_readings(under))
    start = copy.deepcopy(model)
    for name in fixed:
        start[name].free = False
    if not all(one.input_repeats for one in measured):
        measured = with_mean_input(measured, linear_start(start, measured))
    deadline = deadline or Deadline()
    problem = Problem(start, measured, band, tuple(per_record), deadline)
    with ThreadPoolExecutor(n_threads(len(measured))) as pool:
        minimum = problem.minimise(solver, method, max_iter, pool)
    fit = _fitted(problem, minimum, solver=solver, method=method)
    if fit.unsettled and not quiet:
        _log.warning("%s", unsettled_text(fit))
    return fit


def unsettled_text(fit: PlantFit) -> str:
    """Warning of a fit whose simulation reaches no steady state.

    Parameters
    ----------
    fit : PlantFit
    """
    return f"no steady state was found for {', '.join(fit.unsettled)}: do not trust this fit"


def likelier_fit(fits: dict[str, PlantFit]) -> PlantFit:
    """Return the likelier of the fits with both holds, for records that do not state their hold.

    Parameters
    ----------
    fits : dict of PlantFit
        Fits by assumed hold; one may be missing.

    Returns
    -------
    PlantFit
        Likelier fit. The hold of the fit and of its model is marked as assumed.
    """
    taken = likelier({reading: fit.cost for reading, fit in fits.items()})
    return as_assumed(fits[taken], fits.get(other_reading(taken)))


def as_assumed(fit: PlantFit, other: PlantFit | None) -> PlantFit:
    """Mark the hold of a fit and of its model as assumed, for records that do not state their hold.

    Parameters
    ----------
    fit : PlantFit
    other : PlantFit or None
        Same fit with the other hold, if it succeeded.

    Returns
    -------
    PlantFit
    """
    fit.hold_assumed, fit.other_delay_s = True, None if other is None else other.delay_s
    if fit.delay_s is None:
        fit.other_delay_s = None
    fit.model.fit = fit.summary()
    return fit


def _fitted(problem: Problem, minimum: Minimum, *, solver: str, method: str) -> PlantFit:
    fit = PlantFit(
        model=_with_result(problem, minimum),
        cost=minimum.cost,
        n_dof=minimum.n_dof,
        cost_per_dof=minimum.cost / minimum.n_dof,
        converged=minimum.converged,
        n_iterations=minimum.n_iterations,
        undetermined=_named(problem, _is_undetermined(problem, minimum)),
        at_bound=_named(problem, minimum.is_at_bound),
        unsettled=[
            part.spectra.name or f"record {i}"
            for i, (part, at) in enumerate(zip(problem.parts, minimum.records, strict=True))
            if at.is_unsettled
        ],
        records=[_record_fit(problem, minimum, i) for i in range(problem.n_records)],
        band_hz=problem.band_hz,
        variance_dof=min(part.dof for part in problem.parts),
        solver=solver,
        method=method,
        hold=problem.hold,
    )
    fit.model.fit = fit.summary()
    return fit


def _plain(param: Param) -> list[float | None]:
    return [param.value, param.std if np.isfinite(param.std) else None]


def _with_result(problem: Problem, minimum: Minimum) -> PlantModel:
    """The model with the shared values and, for values estimated per record, their mean over the records."""
    model = copy.deepcopy(problem.model)
    own = np.arange(problem.n_records * problem.n_own).reshape(problem.n_records, problem.n_own)
    # Each free parameter is a mean of unknowns; its covariance follows from theirs.
    mean = np.zeros((len(problem.local) + problem.n_shared, problem.n))
    for k, i in enumerate(problem.local):
        mean[i, own[:, k]] = 1 / problem.n_records
    for k, i in enumerate(problem.shared):
        mean[i, problem.n - problem.n_shared + k] = 1
    model.cov, model.cov_names = mean @ minimum.cov @ mean.T, model.free_names
    unknown = np.any((mean > 0) & minimum.is_open, axis=1)
    for i, name in enumerate(model.free_names):
        model[name].value = float(mean[i] @ minimum.x)
        model[name].std = float("nan") if unknown[i] else float(np.sqrt(model.cov[i, i]))
    return model


def _is_undetermined(problem: Problem, minimum: Minimum) -> np.ndarray:
    return minimum.is_open | ~(np.sqrt(np.diag(minimum.cov)) <= problem.sizes(minimum.x))


def _named(problem: Problem, chosen: np.ndarray) -> list[str]:
    return list(dict.fromkeys(name for name, at in zip(problem.names, chosen, strict=True) if at))


def _record_fit(problem: Problem, minimum: Minimum, i: int) -> RecordFit:
    part, at = problem.parts[i], minimum.records[i]
    values, sigmas = problem.own(minimum.x, i), problem.own(minimum.std, i)
    return RecordFit(
        name=part.spectra.name,
        line=part.line.astype(int),
        weight=at.weight,
        residual=at.residual,
        jacobian=at.jacobian,
        prediction=at.prediction,
        params={
            name: Param(float(value), True, float(sigma))
            for name, value, sigma in zip(problem.own_names, values, sigmas, strict=True)
        },
        spectra=part.spectra,
    )
