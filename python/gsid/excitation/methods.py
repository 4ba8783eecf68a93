"""Compare excitations for the same measurement time and limits: the uncertainty of the response at each line.

By formula, with v the variance of the noise at a line of one period of N samples, P periods and the line |U|
of the input (EXC-10):

    sigma_G^2 = v / (P |U|^2),    v = 2 fs/N times the density of the noise

With a model the multisine has the same signal-to-noise ratio at all lines. A broadband excitation waits once;
a stepped sine waits before each sine, and has the amplitude of the limit at each of them. The simulation
makes samples of the output with noise and evaluates them as a record.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from gsid._lib import lib
from gsid.base.errors import InputError
from gsid.excitation.generators import Prbs, SteppedSine, Sweep
from gsid.excitation.limits import Model, fit_to_limits, optimise, travel, travel_response
from gsid.excitation.multisine import Multisine
from gsid.excitation.periodic import Limits, Periodic
from gsid.models.rational import RationalModel
from gsid.plant.linear_response import linear_view
from gsid.plant.units import RADIANS
from gsid.records.record import Record
from gsid.response.estimate import frf

METHODS = ("multisine", "stepped-sine", "sweep", "prbs")
N_MIN = 2  # periods: fewer have no variance
HIGH_SNR_DB, LOW_SNR_DB = 40.0, 20.0  # where the thesis separates the methods (section 3.4)
Density = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Method:
    """One excitation within the limits, and what it leaves uncertain.

    Attributes
    ----------
    name : {"multisine", "stepped-sine", "sweep", "prbs"}
    signal : Periodic
        Scaled to the limits.
    n_periods : int
        Periods measured, of each sine for a stepped sine. 0: the time is too short.
    least_s : float
        Shortest time in which the method measures all lines with a variance [s].
    f_hz : (F,) [Hz]
    snr_db : (F,)
        Output over noise at each line of one period [dB]; NaN without a model.
    sigma : (F,)
        Standard deviation of the response by formula; infinite if the time is too short.
    sigma_simulated : (F,) or None
        Rms error of simulated measurements.
    time_for_wanted_s : float
        Time in which each line reaches the wanted relative standard deviation [s]; NaN without a model.
    """

    name: str
    signal: Periodic
    n_periods: int
    least_s: float
    f_hz: np.ndarray
    snr_db: np.ndarray
    sigma: np.ndarray
    sigma_simulated: np.ndarray | None
    time_for_wanted_s: float


@dataclass(frozen=True, eq=False)
class MethodComparison:
    """Excitations compared for the same time and limits.

    Attributes
    ----------
    methods : list of Method
        In the order of `METHODS`; those that the request does not allow are left out.
    time_s, wait_s, wanted : float
        Measurement time, waiting time [s], and wanted standard deviation over gain.
    skipped : dict of str
        Methods that the request does not allow, and why.
    """

    methods: list[Method]
    time_s: float
    wait_s: float
    wanted: float
    skipped: dict[str, str]

    def __getitem__(self, name: str) -> Method:
        """The method of this name."""
        return next(one for one in self.methods if one.name == name)

    @property
    def sentence(self) -> str:
        """Which method leaves the least uncertainty in this time."""
        possible = [one for one in self.methods if one.n_periods >= N_MIN]
        if not possible:
            soonest = min(self.methods, key=lambda one: one.least_s)
            needed = f"{soonest.name} needs {soonest.least_s:g} s"
            return f"No method measures these lines in {self.time_s:g} s: {needed}."
        best = min(possible, key=lambda one: float(np.median(one.sigma)))
        text = f"In {self.time_s:g} s {best.name} leaves the least uncertainty in the median over the lines."
        worst = min(possible, key=lambda one: float(np.max(one.sigma)))
        if worst is not best:
            text += f" At the worst line it is {worst.name}."
        broad = next((one for one in self.methods if one.name == "multisine"), None)
        if broad is not None and np.isfinite(broad.snr_db).all():
            text += f" {_rule(broad)}"
        return text


def _rule(broad: Method) -> str:
    low = broad.f_hz[broad.snr_db < LOW_SNR_DB]
    if not len(low):
        enough = "above 40 dB" if np.min(broad.snr_db) >= HIGH_SNR_DB else "above 20 dB"
        return (
            f"The multisine's signal-to-noise ratio is {enough} at all lines: broadband excitation suffices."
        )
    where = f"{len(low)} lines, {low[0]:.4g} to {low[-1]:.4g} Hz"
    return (
        f"The multisine's signal-to-noise ratio is below 20 dB at {where}: "
        "measure these with a stepped sine, and join the bands (`gsid join`)."
    )


def compare_methods(
    fs_hz: float,
    period_samples: int,
    band_hz: tuple[float, float],
    time_s: float,
    density: Density | float,
    limits: Limits,
    *,
    model: Model | None = None,
    wait_s: float | None = None,
    grid: str = "quasi-log",
    wanted: float = 0.01,
    n_simulated: int = 0,
    seed: int = 0,
) -> MethodComparison:
    """Compare multisine, stepped sine, sweep and binary sequence for the same time and limits.

    Parameters
    ----------
    fs_hz : float
        Sample rate [Hz].
    period_samples : int
        N; the binary sequence has the nearest valid period.
    band_hz : (lo, hi)
        Hz.
    time_s : float
        Measurement time with all waiting times [s].
    density : callable or float
        One-sided density of the output's noise at frequencies (F,) [Hz], unit of y squared per Hz; a
        number is the rms value of white noise.
    limits : Limits
        At least a limit of the command.
    model : RationalModel or PlantModel, optional
        For limits of travel, signal-to-noise ratios and the simulation. A plant is linearised.
    wait_s : float, optional
        Waiting time until transients have decayed [s]; default: one period.
    grid : str
        Lines to measure, as in `Multisine.design`.
    wanted : float
        Standard deviation over gain that each line should reach.
    n_simulated : int
        Simulated measurements of each method; 0: none.
    seed : int
        Random seed of their noise.

    Returns
    -------
    MethodComparison

    Raises
    ------
    ValueError
        An argument is not valid, or a simulation or limit of travel lacks a model.
    """
    if not (math.isfinite(time_s) and time_s > 0):
        raise ValueError(f"the measurement time must be a positive number of seconds, not {time_s}")
    if limits.command is None:
        raise ValueError("the comparison needs a limit of the command")
    if n_simulated and model is None:
        raise ValueError("the simulation needs a model of the axis")
    if not wanted > 0:
        raise ValueError(f"the wanted standard deviation must be positive, not {wanted}")
    wait = round(period_samples if wait_s is None else wait_s * fs_hz)
    noise = density if callable(density) else _white(float(density), fs_hz)
    request = _Request(fs_hz, period_samples, band_hz, grid, wait, limits, model)
    methods, skipped = [], {}
    for name in METHODS:
        try:
            signal = _designed(name, request, noise)
        except ValueError as error:
            if name in ("multisine", "stepped-sine"):
                raise
            skipped[name] = str(error)
            continue
        method = _by_formula(name, signal, time_s, wait, noise, model, wanted)
        if n_simulated and method.n_periods >= N_MIN:
            method = replace(
                method, sigma_simulated=_simulated(method, wait, noise, model, n_simulated, seed)
            )
        methods.append(method)
    return MethodComparison(methods, float(time_s), wait / fs_hz, wanted, skipped)


def _white(rms: float, fs_hz: float) -> Density:
    if not (math.isfinite(rms) and rms > 0):
        raise ValueError(f"the noise must be a positive number, not {rms}")
    return lambda f_hz: np.full(len(f_hz), 2 * rms**2 / fs_hz)


@dataclass(frozen=True)
class _Request:
    """What every method must measure, and within which limits."""

    fs_hz: float
    period: int
    band_hz: tuple[float, float]
    grid: str
    wait: int
    limits: Limits
    model: Model | None


def _designed(name: str, what: _Request, density: Density) -> Periodic:
    """The excitation of a method, as large as the limits allow."""
    fs_hz, limits, model = what.fs_hz, what.limits, what.model
    basic = fs_hz, what.period, what.band_hz
    if name == "stepped-sine":
        signal = SteppedSine.design(*basic, grid=what.grid, settle_samples=what.wait, n_periods=N_MIN)
        return stepped_to_limits(signal, limits, model)
    multisine = Multisine.design(*basic, grid=what.grid)
    if name == "multisine":
        if model is not None:  # the same signal-to-noise ratio at all lines (thesis, section 5.3)
            level = np.sqrt(density(multisine.f_hz)) / np.abs(_response(model, multisine.f_hz, fs_hz))
            multisine = replace(multisine, amplitude=level / np.max(level))
        return fit_to_limits(optimise(multisine, limits, model), limits, model)
    if name == "sweep":
        sweep = Sweep.design(*basic, kind="log" if what.grid == "quasi-log" else "linear")
        return fit_to_limits(replace(sweep, line=multisine.line), limits, model)
    prbs = _nearest_prbs(*basic, max(1, math.floor(fs_hz / (2.5 * what.band_hz[1]))))
    near = np.unique(np.round(multisine.line * (prbs.period_samples / what.period)).astype(int))
    return fit_to_limits(replace(prbs, line=near[near > 0]), limits, model)


def _nearest_prbs(fs_hz: float, period: int, band_hz: tuple[float, float], hold: int) -> Prbs:
    chips = int(lib.gsid_prbs_nearest(lib.GSID_PRBS_QUADRATIC_RESIDUE, max(3, round(period / hold))))
    return Prbs.design(fs_hz, chips * hold, band_hz)


def stepped_to_limits(signal: SteppedSine, limits: Limits, model: Model | None = None) -> SteppedSine:
    """Scale each sine of a stepped sine to the largest amplitude that the limits allow it.

    Parameters
    ----------
    signal : SteppedSine
    limits : Limits
        At least one limit.
    model : RationalModel or PlantModel, optional
        Required for a limit of travel. The travel of the whole sequence is checked too.

    Returns
    -------
    SteppedSine

    Raises
    ------
    ValueError
        No limit is given, or a limit of travel is given without a model.
    """
    amplitude = np.full(len(signal.line), np.inf)
    if limits.command is not None:
        amplitude = np.minimum(amplitude, limits.command)
    if limits.slew is not None:
        amplitude = np.minimum(amplitude, limits.slew / (2 * np.pi * signal.f_hz))
    if limits.travel is not None:
        if model is None:
            raise ValueError("a limit of travel needs a model of the axis")
        angle = np.abs(travel_response(model, signal.f_hz, signal.fs_hz))
        amplitude = np.minimum(amplitude, limits.travel / np.maximum(angle, np.finfo(float).tiny))
    if not np.all(np.isfinite(amplitude)):
        raise ValueError("give at least one limit: command, travel or slew")
    scaled = replace(signal, amplitude=amplitude)
    if limits.travel is not None and isinstance(model, RationalModel):
        scaled = scaled.scaled(min(1.0, limits.travel / max(travel(scaled, model), np.finfo(float).tiny)))
    return scaled


def _by_formula(
    name: str,
    signal: Periodic,
    time_s: float,
    wait: int,
    density: Density,
    model: Model | None,
    wanted: float,
) -> Method:
    """Expected standard deviations.  Eq: EXC-10"""
    fs_hz, f_hz = signal.fs_hz, signal.f_hz
    if isinstance(signal, SteppedSine):
        n_base, n_steps, size = signal.n_base, len(signal.line), np.abs(signal.amplitude)
    else:
        n_base, n_steps = signal.period_samples, 1
        size = np.abs(np.fft.rfft(signal.table())[signal.line]) * 2 / n_base
    n_periods = math.floor((time_s * fs_hz / n_steps - wait) / n_base + 1e-9)
    variance = 2 * fs_hz / n_base * np.asarray(density(f_hz)) / size**2  # of one period
    snr_db, time_for = np.full(len(f_hz), np.nan), math.nan
    if model is not None:
        ratio = np.abs(_response(model, f_hz, fs_hz)) ** 2 / variance
        snr_db = 10 * np.log10(ratio)
        needed = np.maximum(N_MIN, np.ceil(1 / (wanted**2 * ratio)))
        # Each sine may last as long as it needs; a broadband excitation as long as its worst line.
        needed = np.sum(needed) if n_steps > 1 else np.max(needed)
        time_for = float((n_steps * wait + needed * n_base) / fs_hz)
    n_periods = n_periods if n_periods >= N_MIN else 0
    sigma = np.sqrt(variance / n_periods) if n_periods else np.full(len(f_hz), np.inf)
    if isinstance(signal, SteppedSine):
        signal = replace(signal, n_periods=max(n_periods, N_MIN))
    least_s = n_steps * (wait + N_MIN * n_base) / fs_hz
    return Method(name, signal, n_periods, least_s, f_hz, snr_db, sigma, None, time_for)


def _response(model: Model, f_hz: np.ndarray, fs_hz: float) -> np.ndarray:
    if isinstance(model, RationalModel):
        return model.response(f_hz)
    return linear_view(model.stack(), f_hz, fs_hz, radians_per_unit=RADIANS[model.angle_unit]).command


def _simulated(
    method: Method, wait: int, density: Density, model: Model, n_simulated: int, seed: int
) -> np.ndarray:
    """Rms error of the response over simulated measurements, (F,)."""
    signal, fs_hz = method.signal, method.signal.fs_hz
    u, n_settle, meta = signal.table(), 0, {}
    if isinstance(signal, SteppedSine):
        meta = {key: str(value) for key, value in signal.steps.keys().items()}
    y = _periodic_output(u, fs_hz, model)
    if not meta:
        n_settle = -(-wait // len(u)) * len(u)
        u, y = (np.tile(x, method.n_periods + n_settle // len(signal.table())) for x in (u, y))
    truth, total = _response(model, method.f_hz, fs_hz), np.zeros(len(method.f_hz))
    for i in range(n_simulated):
        noisy = y + _samples(density, len(y), fs_hz, np.random.default_rng((seed, i)))
        period = None if meta else signal.period_samples
        record = Record(u, noisy, fs_hz, period, n_settle, hold="zoh", meta=meta)
        with _quiet():
            found = frf(record)
        at = np.argmin(np.abs(found.f_hz[:, None] - method.f_hz), axis=0)
        if np.any(np.abs(found.f_hz[at] - method.f_hz) > 1e-6 * method.f_hz):
            raise InputError("a line is lost in the noise", method.name, None, "increase the command")
        total += np.abs(found.g[at] - truth) ** 2
    return np.sqrt(total / n_simulated)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the messages of single simulated records."""
    logger = logging.getLogger("gsid.response")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)


def _periodic_output(u: np.ndarray, fs_hz: float, model: Model) -> np.ndarray:
    """Output of the linear model to a periodic command, in steady state, without its mean."""
    spectrum = np.fft.rfft(u)
    line = np.flatnonzero(np.abs(spectrum) > 1e-12 * np.abs(spectrum).max())
    line = line[(line > 0) & (2 * line < len(u))]
    output = np.zeros(len(spectrum), complex)
    output[line] = spectrum[line] * _response(model, line * (fs_hz / len(u)), fs_hz)
    return np.fft.irfft(output, len(u))


def _samples(density: Density, n: int, fs_hz: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of this one-sided density, (n,)."""
    f_hz = np.fft.rfftfreq(n, 1 / fs_hz)
    shape = np.sqrt(np.maximum(np.asarray(density(f_hz)), 0) * fs_hz / 2)
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * shape, n)
