"""Excitations within what the rig allows: command, travel, slew; and how long to measure."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from gsid._lib import check, ffi, lib
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
BISECTIONS = 20  # of the octave of amplitude in which a plant reaches its travel: to a millionth
OCTAVES = 40  # of amplitude in which that one is looked for, up and down
DRIFT = 0.01  # of the travel in each period, before it is reported
DEG = {"deg": 1.0, "rad": 180 / math.pi}


def travel(signal: Periodic, model: Model) -> float:
    """Predict how far the axis travels from the middle, in steady state.

    Where there is none, as nothing brings the axis back, it is the travel within a period, and a warning
    tells by how much it moves on.

    Parameters
    ----------
    signal : Periodic
    model : RationalModel or PlantModel
        A rational model of a rate (its unit ends in /s, or is not given) or of an angle.

    Returns
    -------
    float
        Half of the peak-to-peak angle, degree (the plant's unit where that is none).

    Raises
    ------
    ValueError
        The model has a controller that runs at another rate.
    """
    path, drift = _orbit(signal.table(), signal.fs_hz, model)
    most = float(np.abs(path).max())
    if drift > DRIFT * most:
        _log.warning(
            "the predicted travel of %.3g %s is no steady state: the axis moves on by %.2g %s in each "
            "period; bring it back by a loop or a spring, or measure few periods",
            *(most, travel_unit(model), drift, travel_unit(model)),
        )
    return most


def travel_path(u: np.ndarray, fs_hz: float, model: Model) -> np.ndarray:
    """Predict the angle over one period, in steady state where there is one.

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
        From the middle of the travel, in `travel_unit`.

    Raises
    ------
    ValueError
        The model has a controller that runs at another rate.
    """
    return _orbit(u, fs_hz, model)[0]


def _orbit(u: np.ndarray, fs_hz: float, model: Model) -> tuple[np.ndarray, float]:
    """`travel_path`, and by how much it changes in one more period."""
    drift = 0.0
    if isinstance(model, PlantModel):
        answer, unit = _angle_model(model, fs_hz).simulate(u), DEG.get(model.angle_unit, 1.0)
        angle, drift = answer.angle * unit, answer.residual * unit
    else:
        spectrum = np.fft.rfft(u)
        line = np.flatnonzero(np.abs(spectrum) > 1e-12 * np.abs(spectrum).max())
        line = line[(line > 0) & (2 * line < len(u))]
        lines = np.zeros(len(spectrum), complex)
        lines[line] = spectrum[line] * travel_response(model, line * fs_hz / len(u), fs_hz)
        angle = np.fft.irfft(lines, len(u))
    return angle - (angle.max() + angle.min()) / 2, drift


def travel_unit(model: Model) -> str:
    """Unit of the predicted travel: deg for angles, else that of the model's output or its integral."""
    unit = model.angle_unit if isinstance(model, PlantModel) else (model.y_unit or "deg/s").removesuffix("/s")
    return "deg" if unit in DEG else unit


def travel_response(model: Model, f_hz: np.ndarray, fs_hz: float) -> np.ndarray:
    """Response of the angle to the command, (F,) complex, degree per command; of a plant its linear part."""
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
    """The plant at the rate of the signal, looked at by its angle."""
    if model.has_controller and abs(model.fs_hz / fs_hz - 1) > 1e-6:
        raise ValueError(f"the model's controller runs at {model.fs_hz:g} Hz, the signal at {fs_hz:g} Hz")
    return replace(model, output="angle", fs_hz=fs_hz)


def fit_to_limits(signal: Signal, limits: Limits, model: Model | None = None) -> Signal:
    """Scale a signal to the largest amplitude that the limits allow.

    Parameters
    ----------
    signal : Periodic
    limits : Limits
        One at least.
    model : RationalModel or PlantModel, optional
        Needed for a limit of travel.

    Returns
    -------
    Periodic
        Of the signal's class.

    Raises
    ------
    ValueError
        No limit, or one of travel without a model, or that no amplitude of the excitation meets.
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
        raise ValueError("give a limit: command, travel or slew")
    scaled = signal.scaled(min(factors))
    if limits.travel is not None:
        travel(scaled, model)  # warns where the axis does not stay within it
    return scaled


def _factor_of_travel(signal: Signal, limit: float, model: Model, most: float) -> float:
    def moved(factor: float) -> float:
        return float(np.abs(travel_path(factor * u, signal.fs_hz, model)).max())

    u = signal.table()
    once = moved(1.0)
    if isinstance(model, RationalModel):
        return limit / once
    # friction and springs make the travel more or less than proportional, and friction may hold the axis
    low, high = _octave(moved, limit, min(limit / once if once > 0 else 1.0, most), most)
    for _ in range(BISECTIONS if low < high else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if moved(middle) <= limit else (low, middle)
    return low


def _octave(moved: Callable[[float], float], limit: float, start: float, most: float) -> tuple[float, float]:
    """Two factors, at most an octave apart, between which the limit is reached; both `most` if it is not."""
    factor = start
    if moved(start) > limit:
        for _ in range(OCTAVES):
            factor /= 2
            if moved(factor) <= limit:
                return factor, 2 * factor
        rest = f"without any command the axis travels {moved(0.0):.3g}"
        raise ValueError(f"no amplitude keeps the limit of travel, {limit:g}: {rest}")
    for _ in range(OCTAVES):
        if factor == most:
            return most, most
        wider = min(2 * factor, most)
        if moved(wider) > limit:
            return factor, wider
        factor = wider
    raise ValueError(f"the travel stays within {limit:g} at any command: give a limit of the command too")


def optimise(
    multisine: Multisine, limits: Limits | None = None, model: Model | None = None, *, effort: int = 150
) -> Multisine:
    """Search phases with low peaks (EXC-9), of the command alone or of command and travel together.

    Parameters
    ----------
    multisine : Multisine
        Its phases are the start; the amplitudes stay.
    limits : Limits, optional
        With both command and travel the larger of the two peaks, each over its limit, is made small, so that
        the amplitude that fits both is large.
    model : RationalModel or PlantModel, optional
        Needed for a limit of travel.
    effort : int
        Evaluations in each of the seven stages.

    Returns
    -------
    Multisine

    Raises
    ------
    ValueError
        A limit of travel without a model.
    GsidError
        Built without FFTW or NLopt.
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
        # without a limit of the command its peak counts for nothing
        largest = float(np.sum(np.abs(amplitude)))
        cfg.limit_command = 1e6 * largest if limits.command is None else limits.command
        cfg.limit_travel = limits.travel
    peak = ffi.new("double *")
    status = lib.gsid_optimise_phases(cfg, ffi.from_buffer("double[]", phase_rad), peak)
    check(status, "optimising the phases")
    return replace(multisine, phase_rad=phase_rad, optimised=True)


@dataclass(frozen=True)
class Budget:
    """How long to measure for a wanted uncertainty.

    Attributes
    ----------
    n_periods : int
        Good periods, the settling not counted.
    time_s : float
        Of those periods.
    f_hz : float
        The line that needs most.
    amplitude_factor : float
        What the excitation would have to be multiplied by to reach the same in the periods measured so far.
    """

    n_periods: int
    time_s: float
    f_hz: float
    amplitude_factor: float


def plan_budget(measured: Frf, relative_std: float) -> Budget:
    """Plan how many periods bring the standard deviation of every line below a share of its gain.

    Parameters
    ----------
    measured : Frf
        A short measurement with the excitation planned; its noise is what counts.
    relative_std : float
        Wanted sigma_G / |G|, 0 .. 1.

    Returns
    -------
    Budget
        Noise falls as 1/sqrt(periods); what distortion adds does not (`gsid.distortion`).

    Raises
    ------
    ValueError
        A share that is none, or a measurement without variance.
    """
    if not 0 < relative_std < 1:
        raise ValueError(f"the wanted sigma must be a share of the gain between 0 and 1, not {relative_std}")
    relative_var = measured.var_g / np.abs(measured.g) ** 2 * measured.n_periods  # of one period
    if not np.isfinite(relative_var).all():
        raise ValueError("the measurement has no variance at every line: measure 2 periods at least")
    worst = int(np.argmax(relative_var))
    n_periods = max(2, math.ceil(relative_var[worst] / relative_std**2))
    return Budget(
        n_periods,
        n_periods * measured.period_samples / measured.fs_hz,
        float(measured.f_hz[worst]),
        float(np.sqrt(relative_var[worst] / measured.n_periods) / relative_std),
    )
