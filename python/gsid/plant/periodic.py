"""Periodic steady-state response of a plant to one period of its input, with its sensitivities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

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

SETTLE_PERIODS = 2  # before the first Newton step
SETTLE_LONGER = 10  # periods, if the steady state was not reached
NEWTON_STEPS = 8
MOVES_MOST = 2**63  # no bound: moves of ten thousand years
SETTLED = 1e-7  # largest change in a period, relative to the output's rms


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
        Whether `residual` is below 1e-7 of the output's rms, or below the requested tolerance.
    """

    y: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    Y: np.ndarray
    dY: np.ndarray | None
    residual: float
    settled: bool


def input_period(measured: Spectra, oversampling: int) -> np.ndarray:
    """One period of a record's mean input, held over each 1/oversampling of a sample (PLT-3).

    With oversampling 1 the samples are returned unchanged. Otherwise the input has no lines above half the
    sample rate, and the held input is given the same lines: each is divided by the response of the hold over
    1/oversampling of a sample.

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
    fine[: len(below)] = below / hold_factor(np.arange(len(below)), n * oversampling)
    return period_of(fine, n * oversampling)


def _oversampling(measured: Spectra, closed_loop: bool) -> int:
    return 1 if measured.hold == "zoh" or closed_loop else OVERSAMPLING


def longest_delay_s(measured: Spectra, closed_loop: bool) -> float:
    """Longest delay of the command that a simulation of a record can have [s].

    Parameters
    ----------
    measured : Spectra
    closed_loop : bool
    """
    step_s = 1 / (measured.fs_hz * _oversampling(measured, closed_loop))
    return (lib.GSID_PLANT_DELAY_MAX - 1) * step_s


def _check(status: int) -> None:
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
        One period of the input, held over each step.
    fs_hz : float
        Output samples per second [Hz].
    oversampling : int
        Steps of the input in one sample of the output.
    deadline : Deadline, optional
        Time at which a running simulation ends.

    Attributes
    ----------
    tolerance : float
        Largest change of y in a period for it to count as settled, if that is more than 1e-7 of its rms.
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
        self._m = oversampling
        self.tolerance = 0.0
        self._values = model.free_values
        self._items = ffi.new("gsid_plant_item[]", len(model.effects))
        self._free = []
        self._types = [effect.type for effect in model.effects]  # whose memory the items point to
        for i, effect in enumerate(model.effects):
            self._items[i].effect, self._items[i].data = effect.type.c, effect.type.data
            for j, param in enumerate(effect.params.values()):
                self._items[i].value[j] = param.value
                if param.free:
                    self._free.append((i, j))
        self._free_c = ffi.new("gsid_plant_free[]", self._free or 1)
        self._cfg = ffi.new("gsid_plant_cfg *")
        self._cfg.fs_hz, self._cfg.output_angle = fs_hz * oversampling, model.output == "angle"
        self._cfg.n_items, self._cfg.item = len(model.effects), self._items
        self._cfg.n_free, self._cfg.free_parameter = len(self._free), self._free_c
        self._cfg.unit_rad = RADIANS[model.angle_unit]
        if deadline is not None:
            self._stop = ffi.from_buffer("int[]", deadline.flag)
            self._cfg.stop = self._stop
        self._moves_left = ffi.new("uint64_t *")
        self._cfg.moves_left = self._moves_left
        self.bound(math.inf)
        self._begin: tuple[float, float] | None = None  # angle and rate
        self._kept: np.ndarray | None = None

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
        oversampling = _oversampling(measured, model.has_controller)
        plant = cls(model, input_period(measured, oversampling), measured.fs_hz, oversampling, deadline)
        if has_several_orbits(model):
            plant._begin = measured_state(model, measured)
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
        self._enter(values)
        answer = self._run(SETTLE_PERIODS if self._kept is None else 0, sensitivities)
        return answer if answer.settled or not patient else self._run(SETTLE_LONGER, sensitivities)

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
        if self._kept is None:
            return self.run(values)
        self._enter(values)
        try:
            answer = self._run(1, False, newton_steps=0)
        except SimulationError:  # far from what was kept: `run` takes one step of Newton's method first
            return self.run(values)
        return answer if answer.settled else self.run(values)

    def _enter(self, values: Sequence[float] | None) -> None:
        """Put the values in, and the state at the start."""
        for (i, j), value in zip(self._free, self._values if values is None else values, strict=True):
            self._items[i].value[j] = value
        if self._kept is None:
            self._lay_out()
        else:
            self._memory[:] = self._kept
            _check(lib.gsid_plant_update(self._plant))

    def keep(self) -> None:
        """Start the next searches from the last result, so that rejected steps have no influence."""
        self._kept = self._memory.copy()

    def _lay_out(self) -> None:
        size = lib.gsid_plant_mem_size(self._cfg)
        self._memory = np.zeros(max(size, 1) // 16 + 1, dtype=complex)
        plant = ffi.new("gsid_plant *")
        memory = ffi.from_buffer(self._memory)
        _check(lib.gsid_plant_init(plant, self._cfg, memory, size))
        self._plant = plant
        start = lib.gsid_plant_start_linear(plant, len(self._u), ffi.from_buffer("double[]", self._u))
        if start != lib.GSID_E_NONFINITE:  # then it starts at rest
            _check(start)
        if self._begin is not None:
            _check(lib.gsid_plant_place(self._plant, *self._begin))

    def _run(self, settle: int, sensitivities: bool, newton_steps: int = NEWTON_STEPS) -> Prediction:
        n = len(self._u)
        out = np.empty((3, n))
        dy = np.empty((len(self._free), n)) if sensitivities and self._free else None
        residual = ffi.new("gsid_real *")
        pointers = [ffi.from_buffer("double[]", row) for row in (self._u, *out)]
        dy_c = ffi.NULL if dy is None else ffi.cast("double *", ffi.from_buffer(dy))
        u, y, angle, rate = pointers
        status = lib.gsid_plant_periodic(
            self._plant, n, u, settle, newton_steps, y, dy_c, angle, rate, residual
        )
        _check(status)
        sampled = out[:, :: self._m]
        if dy is None:
            dY = np.empty((0, sampled.shape[1] // 2 + 1), complex) if sensitivities else None
        else:
            dY = lines_of(dy[:, :: self._m])
        rms = float(np.sqrt(np.mean(sampled[0] ** 2)))
        return Prediction(
            y=sampled[0],
            angle=sampled[1],
            rate=sampled[2],
            Y=lines_of(sampled[0]),
            dY=dY,
            residual=residual[0],
            settled=status == lib.GSID_OK or residual[0] <= max(SETTLED * rms, self.tolerance),
        )
