"""Scale excitations to the limits of a rig (command, travel, slew), and plan the measurement time."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.excitation.expected import Errors, periods_for
from gsid.excitation.multisine import Multisine
from gsid.excitation.periodic import Periodic
from gsid.models.rational import RationalModel
from gsid.plant.linear_response import linear_view
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS
from gsid.response.frf import Frf

if TYPE_CHECKING:
    from gsid.excitation.periodic import Limits

_log = logging.getLogger(__name__)

Model = RationalModel | PlantModel
Signal = TypeVar("Signal", bound=Periodic)
BISECTIONS = 20  # of the octave of amplitude that contains the limit of travel: accuracy 1e-6
STAGES = 7  # of the search for phases
OCTAVES = 40  # of amplitude searched for that octave, upwards and downwards
DRIFT = 0.01  # smallest drift per period that is reported, relative to the travel
DEG = {"deg": 1.0, "rad": 180 / math.pi}


def travel(signal: Periodic, model: Model) -> float:
    """Predict the travel of the axis from its middle position, in steady state.

    If the axis drifts because nothing returns it, the result is the travel within one period, and the drift
    per period is logged as a warning.

    Parameters
    ----------
    signal : Periodic
    model : RationalModel or PlantModel
        A rational model of a rate or of an angle. A unit that ends in /s, or a missing unit, means a rate.

    Returns
    -------
    float
        Half of the peak-to-peak angle, in degrees for angles, else in the unit of the model.

    Raises
    ------
    ValueError
        The model has a controller that runs at another rate.
    """
    path, drift = _orbit(signal.table(), signal.fs_hz, model)
    most = float(np.abs(path).max())
    if drift > DRIFT * most:
        _log.warning(
            "the predicted travel of %.3g %s is not a steady state: the axis drifts by %.2g %s in each "
            "period; add a position loop or a spring, or measure few periods",
            *(most, travel_unit(model), drift, travel_unit(model)),
        )
    return most


def travel_path(u: np.ndarray, fs_hz: float, model: Model) -> np.ndarray:
    """Predict the angle over one period, in steady state if there is one.

    Parameters
    ----------
    u : (N,) float
        One period of the command.
    fs_hz : float
        Sample rate [Hz].
    model : RationalModel or PlantModel
        As for `travel`.

    Returns
    -------
    (N,) float
        Angle from the middle of the travel, in `travel_unit`.

    Raises
    ------
    ValueError
        The model has a controller that runs at another rate.
    """
    return _orbit(u, fs_hz, model)[0]


def _orbit(u: np.ndarray, fs_hz: float, model: Model) -> tuple[np.ndarray, float]:
    """`travel_path`, and its change per period."""
    drift = 0.0
    if isinstance(model, PlantModel):
        answer, unit = _angle_model(model, fs_hz).simulate(u), DEG.get(model.angle_unit, 1.0)
        turn = 0.0 if model.looks_at_angle else abs(float(answer.rate.mean())) * len(u) / fs_hz
        angle, drift = answer.angle * unit, max(answer.residual, turn) * unit
    else:
        spectrum = np.fft.rfft(u)
        line = np.flatnonzero(np.abs(spectrum) > 1e-12 * np.abs(spectrum).max())
        line = line[(line > 0) & (2 * line < len(u))]
        lines = np.zeros(len(spectrum), complex)
        lines[line] = spectrum[line] * travel_response(model, line * fs_hz / len(u), fs_hz)
        angle = np.fft.irfft(lines, len(u))
    return angle - (angle.max() + angle.min()) / 2, drift


def travel_unit(model: Model) -> str:
    """Unit of the predicted travel: deg for angles, else the unit of the model's output or its integral."""
    unit = model.angle_unit if isinstance(model, PlantModel) else (model.y_unit or "deg/s").removesuffix("/s")
    return "deg" if unit in DEG else unit


def travel_response(model: Model, f_hz: np.ndarray, fs_hz: float) -> np.ndarray:
    """Response from command to angle, (F,) complex, degree per command unit. A plant is linearised."""
    if isinstance(model, PlantModel):
        unit_rad = RADIANS[model.angle_unit]
        g = linear_view(model.stack(), f_hz, fs_hz, output_angle=True, radians_per_unit=unit_rad).command
        return g * DEG.get(model.angle_unit, 1.0)
    unit = model.y_unit or "deg/s"
    g = model.response(f_hz)
    if unit.endswith("/s"):
        g = g / (2j * np.pi * f_hz)
    return g * DEG.get(unit.removesuffix("/s"), 1.0)


def _angle_model(model: PlantModel, fs_hz: float) -> PlantModel:
    """The plant with the angle as output, at the sample rate of the signal."""
    if model.has_controller and abs(model.fs_hz / fs_hz - 1) > 1e-6:
        raise ValueError(f"the model's controller runs at {model.fs_hz:g} Hz, the signal at {fs_hz:g} Hz")
    return replace(model, output="angle", fs_hz=fs_hz)


def fit_to_limits(signal: Signal, limits: Limits, model: Model | None = None) -> Signal:
    """Scale a signal to the largest amplitude that the limits allow.

    Parameters
    ----------
    signal : Periodic
    limits : Limits
        At least one limit.
    model : RationalModel or PlantModel, optional
        Required for a limit of travel.

    Returns
    -------
    Periodic
        Scaled signal of the same class.

    Raises
    ------
    ValueError
        No limit is given, a limit of travel is given without a model, or no amplitude meets the limit.
    """
    factors = []
    if limits.command is not None:
        factors.append(limits.command / signal.peak)
    if limits.slew is not None:
        factors.append(limits.slew / signal.slew)
    if limits.travel is not None:
        if model is None:
            raise ValueError("a limit of travel needs a model of the axis")
        most = min(factors, default=math.inf)
        factors.append(_factor_of_travel(signal, limits.travel, model, most))
    if not factors:
        raise ValueError("give at least one limit: command, travel or slew")
    scaled = signal.scaled(min(factors))
    if limits.travel is not None:
        travel(scaled, model)  # logs a warning if the axis drifts
    return scaled


def _factor_of_travel(signal: Signal, limit: float, model: Model, most: float) -> float:
    def moved(factor: float) -> float:
        return float(np.abs(travel_path(factor * u, signal.fs_hz, model)).max())

    u = signal.table()
    once = moved(1.0)
    if isinstance(model, RationalModel):
        return limit / once
    # With friction or springs the travel is not proportional to the command; friction may hold the axis.
    low, high = _octave(moved, limit, min(limit / once if once > 0 else 1.0, most), most)
    for _ in range(BISECTIONS if low < high else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if moved(middle) <= limit else (low, middle)
    return low


def _octave(moved: Callable[[float], float], limit: float, start: float, most: float) -> tuple[float, float]:
    """Two factors, at most an octave apart, that bracket the limit; both `most` if it is not reached."""
    factor = start
    if moved(start) > limit:
        for _ in range(OCTAVES):
            factor /= 2
            if moved(factor) <= limit:
                return factor, 2 * factor
        at_rest = f"without a command the axis travels {moved(0.0):.3g}"
        raise ValueError(f"no amplitude meets the limit of travel, {limit:g}: {at_rest}")
    for _ in range(OCTAVES):
        if factor == most:
            return most, most
        wider = min(2 * factor, most)
        if moved(wider) > limit:
            return factor, wider
        factor = wider
    raise ValueError(f"the travel stays below {limit:g} at any amplitude: give a limit of the command too")


def optimise(
    multisine: Multisine, limits: Limits | None = None, model: Model | None = None, *, effort: int = 150
) -> Multisine:
    """Search for phases with low peaks of the command, or of command and travel together (EXC-9).

    Parameters
    ----------
    multisine : Multisine
        Its phases are the starting values. The amplitudes are not changed.
    limits : Limits, optional
        With limits of command and travel, the larger of the two peaks, each divided by its limit, is
        minimised. This allows the largest amplitude within both limits.
    model : RationalModel or PlantModel, optional
        Required for a limit of travel.
    effort : int
        Number of evaluations in each of the seven stages.

    Returns
    -------
    Multisine

    Raises
    ------
    ValueError
        A limit of travel is given without a model.
    GsidError
        The library was built without FFTW or NLopt.
    """
    cfg = ffi.new("gsid_optimise_cfg *")
    line = np.ascontiguousarray(multisine.line, np.uint32)
    amplitude = np.ascontiguousarray(multisine.amplitude, float)
    phase_rad = np.array(multisine.phase_rad, float)
    cfg.n_lines, cfg.n_per_stage = len(line), effort
    cfg.line, cfg.amplitude = ffi.from_buffer("uint32_t[]", line), ffi.from_buffer("double[]", amplitude)
    if limits is not None and limits.travel is not None:
        if model is None:
            raise ValueError("a limit of travel needs a model of the axis")
        response = travel_response(model, multisine.f_hz, multisine.fs_hz)
        response = np.ascontiguousarray(response, complex)
        cfg.travel = ffi.from_buffer("gsid_cplx[]", response)
        # Without a limit of the command, its peak is ignored.
        largest = float(np.sum(np.abs(amplitude)))
        cfg.limit_command = 1e6 * largest if limits.command is None else limits.command
        cfg.limit_travel = limits.travel
    peak = ffi.new("double *")
    status = lib.gsid_optimise_phases(cfg, ffi.from_buffer("double[]", phase_rad), peak)
    check(status, "optimising the phases")
    return replace(multisine, phase_rad=phase_rad, optimised=True)


@dataclass(frozen=True, eq=False)
class Search:
    """Results of the search for phases with more and more evaluations.

    Attributes
    ----------
    evaluations : (n,) int
        Of the cost, from 0: the starting phases.
    crest_factor : (n,) float64
        Between the samples too.
    travel : (n,) float64
        Travel to each side of its middle; NaN without a model.
    best : Multisine
        Result of the last one.
    """

    evaluations: np.ndarray
    crest_factor: np.ndarray
    travel: np.ndarray
    best: Multisine


def search_course(
    multisine: Multisine,
    limits: Limits | None = None,
    model: Model | None = None,
    *,
    efforts: Sequence[int] = (1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 90, 150),
) -> Search:
    """Repeat the search of `optimise` with rising effort (thesis, figure 3.13).

    Parameters
    ----------
    multisine, limits, model
        As of `optimise`.
    efforts : sequence of int
        Evaluations in each of the stages, rising.

    Returns
    -------
    Search
        Each search starts anew: later stages approximate the peak better, so that the course need not fall at
        every step.

    Raises
    ------
    ValueError, GsidError
        As of `optimise`.
    """
    found = [multisine, *(optimise(multisine, limits, model, effort=effort) for effort in efforts)]
    moved = [travel(one, model) if model is not None else math.nan for one in found]
    return Search(
        np.array([0, *(STAGES * effort for effort in efforts)]),
        np.array([one.crest_factor_fine for one in found]),
        np.array(moved),
        found[-1],
    )


@dataclass(frozen=True)
class Budget:
    """Measurement time that a required uncertainty needs.

    Attributes
    ----------
    n_periods : int
        Number of good periods, without settling.
    time_s : float
        Duration of these periods [s].
    f_hz : float
        Frequency of the line that needs the most periods [Hz].
    amplitude_factor : float
        Factor on the excitation that reaches the same uncertainty in the number of periods measured so far.
    """

    n_periods: int
    time_s: float
    f_hz: float
    amplitude_factor: float


def plan_budget(measured: Frf, relative_std: float) -> Budget:
    """Plan the number of periods that brings the standard deviation of every line below a share of its gain.

    Parameters
    ----------
    measured : Frf
        Response from a short measurement with the planned excitation. It provides the noise level.
    relative_std : float
        Required sigma_G / |G|, 0 .. 1.

    Returns
    -------
    Budget
        Assumes that the noise falls as 1/sqrt(periods). Distortion does not fall (`gsid.distortion`).

    Raises
    ------
    ValueError
        relative_std is not between 0 and 1, or the measurement has no variance.
    """
    if not 0 < relative_std < 1:
        raise ValueError(f"the relative standard deviation must be between 0 and 1, not {relative_std}")
    errors = Errors.of(measured)
    relative_var = errors.noise / np.abs(measured.u * measured.g) ** 2  # of one period
    worst = int(np.argmax(relative_var))
    n_periods = periods_for(relative_var, np.full(len(relative_var), relative_std**2))
    return Budget(
        n_periods,
        n_periods * measured.period_samples / measured.fs_hz,
        float(measured.f_hz[worst]),
        float(np.sqrt(relative_var[worst] / measured.n_periods) / relative_std),
    )
