"""What a next excitation has to reach, and what standard deviations it leaves (EXC-11)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from gsid.excitation.expected import P_MIN, Errors, periods_for
from gsid.excitation.limits import Model
from gsid.excitation.multisine import Multisine
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.response.frf import Frf

PERIODS_MOST = 100_000
MATTERS = 0.1  # share of the wanted variance from which on distortion counts
HALVINGS = 16  # of the interval of the amplitude: to 1.5e-5 of it

Expected = tuple[np.ndarray, np.ndarray]


def goal_of(measured: Frf, errors: Errors, wanted: float, model: Model | None) -> Goal:
    """The goal for each line of the response, or for each free parameter of a model.

    Raises
    ------
    ValueError
        The model has no covariance, or no free parameter.
    """
    if model is None:
        return ResponseGoal(measured, errors, wanted)
    if isinstance(model, RationalModel):
        return RationalGoal(measured, errors, wanted, model)
    return StackGoal(measured, errors, wanted, model)


class Goal(ABC):
    """A wanted standard deviation over value of each quantity.

    Attributes
    ----------
    what : {"line", "parameter"}
    names : list of str
        Of the quantities.
    with_distortion : bool
        Whether the distortion counts against the wanted value.
    """

    what: str
    names: list[str]

    def __init__(self, measured: Frf, errors: Errors, wanted: float) -> None:
        self.measured, self.errors, self.wanted = measured, errors, wanted
        self.size = np.maximum(np.abs(measured.g), np.finfo(float).tiny)
        self.with_distortion = bool(np.max(errors.distortion / (self.size**2 * wanted**2)) > MATTERS)

    @abstractmethod
    def expected(self, signal: Multisine, n_periods: int, n_realisations: int) -> Expected:
        """Relative standard deviations, and the share of noise in their squares."""

    def periods(self, signal: Multisine, n_realisations: int) -> int | None:
        """Least number of periods that reaches the goal; None: no number does."""
        low, high = P_MIN, PERIODS_MOST
        if self._worst(signal, high, n_realisations) > self.wanted:
            return None
        while low < high:
            middle = (low + high) // 2
            if self._worst(signal, middle, n_realisations) <= self.wanted:
                high = middle
            else:
                low = middle + 1
        return low

    def least_factor(self, signal: Multisine, n_periods: int, n_realisations: int) -> float:
        """Least factor on the amplitude that still reaches the goal, at most 1."""
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            if self._worst(signal.scaled(middle), n_periods, n_realisations) <= self.wanted:
                high = middle
            else:
                low = middle
        return high

    def _worst(self, signal: Multisine, n_periods: int, n_realisations: int) -> float:
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self.expected(signal, n_periods, n_realisations)[0]
        return float(np.max(np.where(np.isnan(found), np.inf, found)))


class ResponseGoal(Goal):
    """The response at each line, relative to its gain."""

    what = "line"

    def __init__(self, measured: Frf, errors: Errors, wanted: float) -> None:
        super().__init__(measured, errors, wanted)
        self.names = [f"{f:.4g} Hz" for f in measured.f_hz]

    def expected(self, signal: Multisine, n_periods: int, n_realisations: int) -> Expected:
        variance = self.errors.variance(signal.amplitude, n_periods, n_realisations)
        noise = self.errors.noise / (signal.amplitude**2 * n_periods * n_realisations)
        return np.sqrt(variance) / self.size, noise / variance

    def periods(self, signal: Multisine, n_realisations: int) -> int | None:
        left = (self.wanted * self.size) ** 2 - self.errors.distortion / n_realisations
        if np.any(left <= 0):
            return None
        return periods_for(self.errors.noise / (signal.amplitude**2 * n_realisations), left)


class RationalGoal(Goal):
    """The coefficients and the free delay of a rational model."""

    what = "parameter"

    def __init__(self, measured: Frf, errors: Errors, wanted: float, model: RationalModel) -> None:
        super().__init__(measured, errors, wanted)
        if model.cov is None:
            raise ValueError("the uncertainty of parameters needs a model with covariance (gsid fit -o)")
        hold = model.response(measured.f_hz) / replace(model, hold="none").response(measured.f_hz)
        self._gradient = model.gradient(measured.f_hz) * hold[:, None]
        n, m = len(model.den) - 1, len(model.num)
        self.names = [f"den of power {n - 1 - i}" for i in range(n)]
        self.names += [f"num of power {m - 1 - i}" for i in range(m)] + ["delay"] * model.free_delay
        self._values = np.concatenate([model.den[1:], model.num, [model.delay_s] * model.free_delay])

    def expected(self, signal: Multisine, n_periods: int, n_realisations: int) -> Expected:
        variance = self.errors.variance(signal.amplitude, n_periods, n_realisations)
        noise = self.errors.noise / (signal.amplitude**2 * n_periods * n_realisations)
        std = deviations(self._gradient, variance)
        return relative(std, self._values), np.full(len(std), np.mean(noise / variance))


class StackGoal(Goal):
    """The free parameters of a stack of effects, by the simulated sensitivities of its output."""

    what = "parameter"

    def __init__(self, measured: Frf, errors: Errors, wanted: float, model: PlantModel) -> None:
        super().__init__(measured, errors, wanted)
        if not model.free_names:
            raise ValueError("the model has no free parameter")
        self._model, self.names, self._values = model, model.free_names, model.free_values
        first, last = int(measured.line[0]), int(measured.line[-1])
        self._line = np.arange(first, last + 1)  # a fit uses the lines between the excited ones too
        self._noise = np.interp(self._line, measured.line, errors.noise)
        if any(not effect.type.linear_part for effect in model.effects):  # a law explains the distortion
            self.with_distortion, self._distortion = False, np.zeros(len(measured.line))
        else:
            self._distortion = errors.distortion
        self._known: tuple[Multisine, np.ndarray] | None = None

    def expected(self, signal: Multisine, n_periods: int, n_realisations: int) -> Expected:
        noise = self._noise / (n_periods * n_realisations)
        variance = noise.copy()
        excited = self.measured.line - self._line[0]
        variance[excited] += self._distortion * signal.amplitude**2 / n_realisations
        std = deviations(self._sensitivities(signal), variance)
        return relative(std, self._values), np.full(len(std), np.mean((noise / variance)[excited]))

    def _sensitivities(self, signal: Multisine) -> np.ndarray:
        """Derivatives of the output by the parameters, (lines, p) complex; those of one signal are kept."""
        if self._known is None or self._known[0] is not signal:
            u = np.tile(signal.table(), 2)  # the output is simulated: that of this record is not used
            record = Record(
                u,
                u,
                signal.fs_hz,
                signal.period_samples,
                0,
                hold=self.measured.hold,
                y_unit=self._model.y_unit,
            )
            found = self._model.predict(record, sensitivities=True).dY
            self._known = signal, found[:, self._line].T
        return self._known[1]


def deviations(by: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Standard deviations of parameters by the inverse of the Fisher information; inf if it has none.

    Parameters
    ----------
    by : (F, p) complex ndarray
        Derivatives of what is measured.
    variance : (F,) ndarray
        E|error|^2 of each line.
    """
    weighted = by * np.sqrt(2 / variance)[:, None]
    rows = np.concatenate([weighted.real, weighted.imag])
    scale = np.linalg.norm(rows, axis=0)
    if not np.all(scale > 0):
        return np.full(len(scale), np.inf)
    try:
        inverse = np.linalg.inv((rows / scale).T @ (rows / scale))
    except np.linalg.LinAlgError:  # the measurement does not determine some of them
        return np.full(len(scale), np.inf)
    return np.sqrt(np.maximum(np.diag(inverse), 0)) / scale


def relative(std: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Standard deviations over the magnitude of the values; inf for a value of zero."""
    with np.errstate(divide="ignore"):
        return std / np.abs(values)
