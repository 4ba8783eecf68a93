"""Periodic steady-state response of a plant to one period of its input, with its sensitivities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import InputError, SimulationError
from gsid.base.zero_order_hold import hold_factor
from gsid.plant.effect import Stack
from gsid.plant.measured_start import has_several_orbits, measured_state
from gsid.plant.units import RADIANS, check_plant_units
from gsid.spectrum.lines import lines_of, period_of
from gsid.spectrum.spectra import Spectra

# An input that is not held is simulated at this many times the sample rate (docs/explanation/decisions.md).
OVERSAMPLING = 4

MOVES_MOST = 2**63  # no bound: moves of ten thousand years


@dataclass(eq=False)
class Prediction:
    """Periodic steady-state response of a plant.

    Attributes
    ----------
    y, angle, rate : (N,) float64
        Output, angle and rate of the axis at each sample of one period.
    Y : (K,) complex
        Lines 0 .. N/2 of y, as in Spectra.
    dY : (n_free, K) complex or None
        Sensitivities of Y to the free parameters.
    residual : float
        Bound on how much y changes in one more period, unit of y: 0 in the steady state.
    settled : bool
        Whether `residual` is below 1e-7 of the output's rms, or below the tolerance of a fit.
    """

    y: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    Y: np.ndarray
    dY: np.ndarray | None
    residual: float
    settled: bool


def input_period(measured: Spectra, oversampling: int) -> np.ndarray:
    """One period of a record's mean input at each 1/oversampling of a sample (PLT-3).

    With oversampling 1 the samples are returned unchanged. Otherwise the input has no lines above half the
    sample rate, and the first-order hold is given the same lines: each is divided by the response of the hold
    over 1/oversampling of a sample.

    Parameters
    ----------
    measured : Spectra
    oversampling : int

    Returns
    -------
    (N oversampling,) float64
    """
    n = measured.period_samples
    if oversampling == 1:
        return period_of(measured.u, n)
    below = measured.u[: (n + 1) // 2]  # without the line at half the rate, which has no phase
    fine = np.zeros(n * oversampling // 2 + 1, complex)
    fine[: len(below)] = below / np.abs(hold_factor(np.arange(len(below)), n * oversampling)) ** 2
    return period_of(fine, n * oversampling)


def oversampling_of(measured: Spectra, closed_loop: bool) -> int:
    """Steps of the simulation per sample: several for an input that is not held.

    Parameters
    ----------
    measured : Spectra
    closed_loop : bool
    """
    return 1 if measured.hold == "zoh" or closed_loop else OVERSAMPLING


def longest_delay_s(measured: Spectra, closed_loop: bool) -> float:
    """Longest delay of the command that a simulation of a record can have [s].

    Parameters
    ----------
    measured : Spectra
    closed_loop : bool
    """
    step_s = 1 / (measured.fs_hz * oversampling_of(measured, closed_loop))
    return (lib.GSID_PLANT_DELAY_MAX - 1) * step_s


def check_simulation(status: int) -> None:
    """Raise for a plant that cannot be simulated."""
    if status == lib.GSID_E_NONFINITE:
        what = "the plant cannot be simulated: it is unstable, or a law has no value, as 1/0 and sqrt(-1)"
        hint = "look for friction or springs of the wrong sign, unstable gains of a loop, unbounded laws"
        raise SimulationError(status, what, hint)
    if status == lib.GSID_E_CONFIG:
        what = "the plant cannot be simulated: a delay is too long, or a spring, lag or law too fast"
        delay = f"a delay is shorter than {lib.GSID_PLANT_DELAY_MAX} samples"
        hint = f"{delay}; look at the signs and units of springs, time constants and levels"
        raise SimulationError(status, what, hint)
    if status == lib.GSID_E_STOPPED:
        raise OutOfTime("the time or the work was over before the steady state was found")
    if status == lib.GSID_E_NO_MEMORY:
        check(status, "simulating the plant")
    if status < 0:
        meaning, hint = (ffi.string(f(status)).decode() for f in (lib.gsid_status_str, lib.gsid_status_hint))
        raise SimulationError(status, f"the plant cannot be simulated: {meaning}", hint)


class PeriodicPlant:
    """A plant bound to one period of its input: set up once, then simulated with any values.

    Not thread-safe; different objects can run in parallel threads.

    Parameters
    ----------
    model : PlantModel
        Supplies the effects, the free parameters and the values of the others.
    u : (N oversampling,) array_like
        One period of the input: held over each step if that is a sample, otherwise linear between the steps.
    fs_hz : float
        Output samples per second [Hz].
    oversampling : int
        Steps of the input in one sample of the output.
    deadline : Deadline, optional
        Time at which a running simulation ends.

    Attributes
    ----------
    c : gsid_steady_cfg *
        The same for the C library.
    """

    def __init__(
        self,
        model: Stack,
        u: np.ndarray,
        fs_hz: float,
        oversampling: int = 1,
        deadline: Deadline | None = None,
    ) -> None:
        self._u = np.ascontiguousarray(u, dtype=np.float64)
        self._values = model.free_values
        self._items = ffi.new("gsid_plant_item[]", len(model.effects))
        free = []
        self._types = [effect.type for effect in model.effects]  # whose memory the items point to
        for i, effect in enumerate(model.effects):
            self._items[i].effect, self._items[i].data = effect.type.c, effect.type.data
            for j, param in enumerate(effect.params.values()):
                self._items[i].value[j] = param.value
                if param.free:
                    free.append((i, j))
        self._free = ffi.new("gsid_plant_free[]", free or 1)
        self.c = ffi.new("gsid_steady_cfg *")
        self.c.u, self.c.oversampling = ffi.from_buffer("double[]", self._u), oversampling
        self.c.n_period = len(self._u) // oversampling
        plant = self.c.plant
        plant.fs_hz, plant.output_angle = fs_hz * oversampling, model.output == "angle"
        plant.n_items, plant.item = len(model.effects), self._items
        plant.n_free, plant.free_parameter = len(free), self._free
        plant.unit_rad = RADIANS[model.angle_unit]
        plant.first_order_hold = oversampling > 1
        if deadline is not None:
            self._stop = ffi.from_buffer("int[]", deadline.flag)
            plant.stop = self._stop
        self._moves_left = ffi.new("uint64_t *")
        plant.moves_left = self._moves_left
        self.bound(math.inf)
        self._steady: Any = None  # made by the first search

    def bound(self, moves: float) -> None:
        """End the next searches after so much work, in moves of one column.

        Parameters
        ----------
        moves : float
        """
        self._moves_most = int(min(moves, MOVES_MOST))
        self._moves_left[0] = self._moves_most

    @property
    def moves(self) -> int:
        """Work since the bound was set."""
        return self._moves_most - self._moves_left[0]

    @property
    def is_used_up(self) -> bool:
        """Whether the bound was reached."""
        return self._moves_left[0] == 0

    @classmethod
    def of(cls, model: Stack, measured: Spectra, deadline: Deadline | None = None) -> PeriodicPlant:
        """Bind a model to a record's mean input.

        Parameters
        ----------
        model : Stack
        measured : Spectra
        deadline : Deadline, optional
            Time at which a running simulation ends.

        Raises
        ------
        InputError
            The loop's rate or the output's unit is not the record's.
        """
        if model.has_controller and abs(model.fs_hz / measured.fs_hz - 1) > 1e-6:
            raise InputError(
                "the controller does not run at the record's rate",
                measured.name,
                f"{model.fs_hz:g} and {measured.fs_hz:g} Hz",
                "give the model the fs_hz of the record",
            )
        check_plant_units(model, measured)
        oversampling = oversampling_of(measured, model.has_controller)
        plant = cls(model, input_period(measured, oversampling), measured.fs_hz, oversampling, deadline)
        if has_several_orbits(model):
            plant.c.is_placed = 1
            plant.c.angle, plant.c.rate = measured_state(model, measured)
        return plant

    def run(
        self, values: Sequence[float] | None = None, *, sensitivities: bool = False, patient: bool = True
    ) -> Prediction:
        """Find the periodic steady state (PLT-2).

        The start is the one kept last, or that of the linear part; with stops it is where the axis was
        measured. A plant with stops or backlash can have several periodic steady states; this finds the one
        near the start.

        Parameters
        ----------
        values : (n_free,) array_like, optional
            Values of the free parameters; default the model's.
        sensitivities : bool
            Whether to give dY.
        patient : bool
            Whether to simulate ten more periods and try again when Newton's method does not converge.

        Raises
        ------
        GsidError
            The values are refused, or the response overflows.
        OutOfTime
            The deadline or the bound on the work was reached before the steady state.
        """
        answer = self._answer(sensitivities)
        values = self._in_c(values)
        check_simulation(lib.gsid_steady_run(self._made(), values, patient, answer.c))
        return answer.prediction()

    def run_within(self, deadline: Deadline) -> Prediction:
        """As `run`, with at most the work that a deadline has left, which is taken from it.

        Parameters
        ----------
        deadline : Deadline

        Raises
        ------
        GsidError, OutOfTime
            As `run`.
        """
        self.bound(deadline.moves_left)
        try:
            return self.run()
        finally:
            deadline.spend(self.moves)

    def run_near(self, values: Sequence[float]) -> Prediction:
        """As `run`, at less cost where the plant settles within a period from what was kept.

        Parameters
        ----------
        values : (n_free,) array_like
            Values of the free parameters.

        Raises
        ------
        GsidError, OutOfTime
            As `run`.
        """
        answer = self._answer(sensitivities=False)
        check_simulation(lib.gsid_steady_run_near(self._made(), self._in_c(values), answer.c))
        return answer.prediction()

    def keep(self) -> None:
        """Start the next searches from the last result, so that rejected steps have no influence."""
        check(lib.gsid_steady_keep(self._made()), "keeping a steady state")

    def _made(self) -> Any:
        if self._steady is None:
            made = ffi.new("gsid_steady **")
            check_simulation(lib.gsid_steady_create(self.c, made))
            self._steady = ffi.gc(made[0], lib.gsid_steady_destroy)
        return self._steady

    def _in_c(self, values: Sequence[float] | None) -> Any:
        given = np.array(self._values if values is None else values, np.float64)
        if given.shape != (self.c.plant.n_free,):
            raise ValueError(f"expected {self.c.plant.n_free} values, got {given.size}")
        return ffi.from_buffer("double[]", given)

    def _answer(self, sensitivities: bool) -> Answer:
        return Answer(self.c.n_period, self.c.plant.n_free if sensitivities else None)


class Answer:
    """Memory for the response that the C library finds.

    Parameters
    ----------
    n_period : int
        Samples in a period.
    n_free : int or None
        Sensitivities; None: they are not wanted.

    Attributes
    ----------
    c : gsid_steady_answer *
    """

    def __init__(self, n_period: int, n_free: int | None) -> None:
        self._rows = np.empty((3, n_period))
        self._dy = None if n_free is None else np.empty((n_free, n_period))
        self.c = ffi.new("gsid_steady_answer *")
        self.c.y, self.c.angle, self.c.rate = (ffi.from_buffer("double[]", row) for row in self._rows)
        if n_free:
            self.c.dy = ffi.cast("double *", ffi.from_buffer(self._dy))

    def prediction(self) -> Prediction:
        """Return what was found."""
        y, angle, rate = self._rows
        return Prediction(
            y=y,
            angle=angle,
            rate=rate,
            Y=lines_of(y),
            dY=None if self._dy is None else lines_of(self._dy),
            residual=self.c.residual,
            settled=bool(self.c.is_settled),
        )
