"""Candidate effects as directions in the space of the measurement: what each would add to the output.

To first order a torque law n(angle, rate) adds -G_tau N to the output, N the lines of the law along the
fitted model's own trajectory, and a law on the command adds G_u times the lines of what it changes (DIA-3).
So a dense grid over the parameters that have no meaning at the null (speeds, lengths, pitches, thresholds)
costs one transform each; threshold laws are taken at a size where they act, never by a derivative at zero.
The few best are then fitted for real, by simulation: these directions only choose and give the starting
values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from gsid.base.cached import cached_property
from gsid.effects.types import Grid, find
from gsid.spectrum.lines import lines_of, period_of

Params = dict[str, float]

SOFTEST_STOP = 10.0  # 1/s^2: what is softer pushes an axis back for seconds, and is a spring


@dataclass(eq=False)
class Trajectory:
    """One record's excitation and the fitted model's answer to it, over one period.

    Parameters
    ----------
    fs_hz : float
    command, angle, rate, output : (N,) ndarrays
        Command as the drive gets it, and the model's angle, rate and output.
    f_hz : (K,) ndarray
        All lines, 0 .. N/2.
    excited : (K,) ndarray of bool
    torque_response, change_response, direct_response : (K,) complex ndarrays
        Of the model's linear part, to the output: from torque / inertia, from a change of the command, and
        from the command past the rigid body (gain, hold, delay, lags).
    radians_per_unit : float
        Of the angle: pi/180 when angles are degrees.
    spare_delay_s : float
        Delay that the model could give up: the larger part of what a lag does looks like one.
    """

    fs_hz: float
    command: np.ndarray
    angle: np.ndarray
    rate: np.ndarray
    output: np.ndarray
    f_hz: np.ndarray
    excited: np.ndarray
    torque_response: np.ndarray
    change_response: np.ndarray
    direct_response: np.ndarray
    radians_per_unit: float
    spare_delay_s: float

    @cached_property
    def spline(self) -> CubicSpline:
        """Output between the samples, over their number."""
        n = len(self.output)
        return CubicSpline(np.arange(n + 1), np.append(self.output, self.output[0]), bc_type="periodic")

    def of_torque(self, law: np.ndarray) -> np.ndarray:
        """(K,) what a torque law along the trajectory adds to the output."""
        return -self.torque_response * lines_of(law)

    def of_command(self, change: np.ndarray) -> np.ndarray:
        """(K,) what a change of the command adds to the output."""
        return self.change_response * lines_of(change)


@dataclass(eq=False)
class Probe:
    """One candidate at one point of its grid.

    Parameters
    ----------
    effect : str
    columns : list of (q, K) complex ndarrays
        What it adds to the output, one entry per trajectory.
    start : callable
        From the coefficients of the columns to starting values of the effect's parameters.
    one_sided : bool
        Only coefficients >= 0 are physical.
    limits : dict of (lo, hi)
        What a shape may become in a fit and still deserve the effect's name with these data: presliding
        within a thousandth of the travel is Coulomb friction, for instance.
    fixed : tuple of str
        Parameters without a derivative: left at their point of the grid.
    less_delay_s : callable
        From the coefficients to how much shorter the model's own delay is when the effect is there.
    """

    effect: str
    columns: list[np.ndarray]
    start: Callable[[np.ndarray], Params]
    one_sided: bool = False
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    fixed: tuple[str, ...] = ()
    less_delay_s: Callable[[np.ndarray], float] = lambda c: 0.0


def probes(trajectories: list[Trajectory], effects: list[str]) -> Iterator[Probe]:
    """Candidates of the effects named, over their grids.

    Parameters
    ----------
    trajectories : list of Trajectory
    effects : list of str
        Catalogue names; those without a direction along the path give nothing (torque_bias,
        gear_backlash).
    """
    for effect in effects:
        make = GRIDS.get(effect)
        if make is not None:
            yield from make(trajectories)


# ---- torque laws -----------------------------------------------------------------------------------------


def _torque(
    effect: str,
    trajectories: list[Trajectory],
    laws: Callable[[Trajectory], list[np.ndarray]],
    start: Callable[[np.ndarray], Params],
    one_sided: bool = False,
    limits: dict[str, tuple[float, float]] | None = None,
) -> Probe:
    columns = [np.array([t.of_torque(law) for law in laws(t)]) for t in trajectories]
    return Probe(effect, columns, start, one_sided, limits or {})


def _single(effect: str, parameter: str, law: Callable[[Trajectory], np.ndarray], one_sided: bool = False):
    """Grid of a law with one parameter, its size."""

    def make(trajectories: list[Trajectory]) -> Iterator[Probe]:
        yield _torque(effect, trajectories, lambda t: [law(t)], lambda c: {parameter: c[0]}, one_sided)

    return make


def _largest(trajectories: list[Trajectory], signal: str) -> float:
    return max(float(np.max(np.abs(getattr(t, signal)))) for t in trajectories)


def _grid(effect: str, parameter: str) -> Grid:
    """Where the search for an effect begins, as its descriptor says."""
    return find(effect)[parameter].grid


def _swing(trajectories: list[Trajectory]) -> float:
    """Largest travel, peak to peak."""
    return max(float(np.ptp(t.angle)) for t in trajectories)


def _stribeck(trajectories: list[Trajectory]) -> Iterator[Probe]:
    velocities = _grid("stribeck_friction", "velocity").at(_largest(trajectories, "rate"))
    for velocity in velocities:
        yield _torque(
            "stribeck_friction",
            trajectories,
            lambda t, v=velocity: [np.sign(t.rate), np.sign(t.rate) * np.exp(-((t.rate / v) ** 2))],
            lambda c, v=velocity: {"level": c[0], "extra": c[1], "velocity": v},
            one_sided=True,
            limits={"velocity": (velocities[0], velocities[-1])},
        )


def dahl_state(angle: np.ndarray, stiffness: float) -> np.ndarray:
    """Presliding state on a periodic path, after a round: dz/dtheta = stiffness (1 - z sign(dtheta)).

    Parameters
    ----------
    angle : (N,) ndarray
    stiffness : float
        Per unit of angle.

    Returns
    -------
    (N,) ndarray, within +-1
    """
    step = np.diff(angle, append=angle[0])
    sign, decay = np.sign(step), np.exp(-stiffness * np.abs(step))
    z, out = 0.0, np.empty(len(angle))
    for _ in range(2):
        for i in range(len(angle)):
            out[i] = z
            z = sign[i] + (z - sign[i]) * decay[i]
    return out


def _presliding(trajectories: list[Trajectory]) -> Iterator[Probe]:
    stiffnesses = _grid("presliding_friction", "stiffness").at(_swing(trajectories))
    for stiffness in stiffnesses:
        yield _torque(
            "presliding_friction",
            trajectories,
            lambda t, s=stiffness: [dahl_state(t.angle, s)],
            lambda c, s=stiffness: {"level": c[0], "stiffness": s},
            one_sided=True,
            limits={"stiffness": (stiffnesses[-1], stiffnesses[0])},
        )


def _unbalance(trajectories: list[Trajectory]) -> Iterator[Probe]:
    def laws(t: Trajectory) -> list[np.ndarray]:
        angle = t.radians_per_unit * t.angle
        return [np.sin(angle), np.cos(angle) - 1]

    def start(c: np.ndarray) -> Params:
        # The even part alone: the odd one is a spring's too, so its size would start far off.
        return {"level": float(np.abs(c[1])), "angle_deg": float(np.copysign(90.0, c[1]))}

    yield _torque("mass_unbalance", trajectories, laws, start)


def _cogging(trajectories: list[Trajectory]) -> Iterator[Probe]:
    swing = _swing(trajectories) * trajectories[0].radians_per_unit
    grid = _grid("motor_cogging", "cycles_per_rev")
    lowest, step = grid.first / swing, grid.step / swing
    for cycles in grid.at(swing):
        yield _torque(
            "motor_cogging",
            trajectories,
            lambda t, c=cycles: [
                np.sin(c * t.radians_per_unit * t.angle),
                np.cos(c * t.radians_per_unit * t.angle),
            ],
            lambda c, n=cycles: {
                "level": float(np.hypot(c[0], c[1])),
                "cycles_per_rev": float(n),
                "phase_rad": float(np.arctan2(c[1], c[0])),
            },
            limits={"cycles_per_rev": (float(max(cycles - 1.5 * step, lowest)), float(cycles + 1.5 * step))},
        )


def _hard_stop(trajectories: list[Trajectory]) -> Iterator[Probe]:
    furthest = _largest(trajectories, "angle")
    stiffest = find("hard_stop")["stiffness"].upper
    for angle in _grid("hard_stop", "angle_deg").at(furthest):
        yield _torque(
            "hard_stop",
            trajectories,
            lambda t, a=angle: [np.sign(t.angle) * np.maximum(np.abs(t.angle) - a, 0)],
            lambda c, a=angle: {"angle_deg": a, "stiffness": c[0]},
            one_sided=True,
            limits={"angle_deg": (0.2 * furthest, furthest), "stiffness": (SOFTEST_STOP, stiffest)},
        )


# ---- laws on the command ---------------------------------------------------------------------------------


def _command(
    effect: str,
    trajectories: list[Trajectory],
    parameter: str,
    sizes: np.ndarray,
    law: Callable[[np.ndarray, float], np.ndarray],
    fixed: tuple[str, ...] = (),
) -> Iterator[Probe]:
    for size in sizes:
        columns = [t.of_command(law(t.command, size) - t.command)[None, :] for t in trajectories]
        yield Probe(effect, columns, lambda c, s=size: {parameter: float(s)}, True, fixed=fixed)


def _rounded(u: np.ndarray, step: float) -> np.ndarray:
    return step * np.round(u / step)


def quantization_at(trajectories: list[Trajectory], steps: np.ndarray) -> Iterator[Probe]:
    """Rounding of the command to the steps given.

    Parameters
    ----------
    trajectories : list of Trajectory
    steps : (k,) ndarray
    """
    yield from _command("drive_quantization", trajectories, "step", steps, _rounded, fixed=("step",))


def quantization_spacing(trajectories: list[Trajectory], step: float) -> float:
    """Distance of neighbours in the grid."""
    return _grid("drive_quantization", "step").gap(_largest(trajectories, "command"), step)


def _quantization(trajectories: list[Trajectory]) -> Iterator[Probe]:
    sizes = _grid("drive_quantization", "step").at(_largest(trajectories, "command"))
    yield from quantization_at(trajectories, sizes)


def _dead_zone(trajectories: list[Trajectory]) -> Iterator[Probe]:
    sizes = _grid("drive_dead_zone", "half_width").at(_largest(trajectories, "command"))
    for probe in _command(
        "drive_dead_zone",
        trajectories,
        "half_width",
        sizes,
        lambda u, s: np.sign(u) * np.maximum(np.abs(u) - s, 0),
    ):
        # What a small dead zone takes away grows with its width: the coefficient says how much wider it is.
        width = probe.start(np.zeros(1))["half_width"]
        probe.start = lambda c, w=width: {"half_width": float(w * np.clip(c[0], 0.2, 5))}
        yield probe


def _saturation(trajectories: list[Trajectory]) -> Iterator[Probe]:
    sizes = _grid("drive_saturation", "limit").at(_largest(trajectories, "command"))
    yield from _command("drive_saturation", trajectories, "limit", sizes, lambda u, s: np.clip(u, -s, s))


# ---- linear dynamics -------------------------------------------------------------------------------------


def _lag(effect: str):
    def make(trajectories: list[Trajectory]) -> Iterator[Probe]:
        spare = trajectories[0].spare_delay_s
        samples = _grid(effect, "time_constant_s").at(1.0)
        for time_constant in samples / trajectories[0].fs_hz:
            less = min(time_constant, spare)
            columns = [_lag_less_delay(t, time_constant, less)[None, :] for t in trajectories]

            # The phase of a short lag, which a delay imitates, grows with T; the gain, which tells, with T^2.
            def longer(c: np.ndarray, T: float = time_constant) -> float:
                return float(T * np.sqrt(np.clip(c[0], 0.04, 25)))

            yield Probe(
                effect,
                columns,
                lambda c, at=longer: {"time_constant_s": at(c)},
                one_sided=True,
                less_delay_s=lambda c, at=longer: min(at(c), spare),
            )

    return make


def _lag_less_delay(t: Trajectory, time_constant: float, less_delay_s: float) -> np.ndarray:
    """(K,) what a lag instead of a part of the delay adds to the output."""
    lag = 1 / (1 + 2j * np.pi * t.f_hz * time_constant)
    return lag * lines_of(_earlier(t, less_delay_s)) - lines_of(t.output)


def _delay(trajectories: list[Trajectory]) -> Iterator[Probe]:
    columns = [(-2j * np.pi * t.f_hz * lines_of(t.output))[None, :] for t in trajectories]
    yield Probe("transport_delay", columns, lambda c: {"delay_s": float(c[0])}, one_sided=True)


def _flexible_mode(trajectories: list[Trajectory]) -> Iterator[Probe]:
    f = trajectories[0].f_hz[trajectories[0].excited]
    band, zetas = _grid("flexible_mode", "f_hz"), _grid("flexible_mode", "zeta").points
    for f_mode in np.geomspace(max(f.min(), f.max() * band.first), f.max() * band.last, band.n):
        for zeta in zetas:
            yield _mode_probe(trajectories, f_mode, zeta)


def _mode_probe(trajectories: list[Trajectory], f_mode: float, zeta: float) -> Probe:
    columns = []
    for t in trajectories:
        s, w0 = 2j * np.pi * t.f_hz, 2 * np.pi * f_mode
        filtered = s / (s**2 + 2 * zeta * w0 * s + w0**2)
        columns.append((t.direct_response * filtered * lines_of(t.command))[None, :])
    return Probe(
        "flexible_mode",
        columns,
        lambda c: {"f_hz": f_mode, "zeta": zeta, "residue": float(c[0])},
        limits={"f_hz": (0.85 * f_mode, 1.15 * f_mode)},
    )


# ---- sampled sensor --------------------------------------------------------------------------------------


def held_output(t: Trajectory, rate_hz: float, less_delay_s: float = 0.0) -> np.ndarray:
    """Output refreshed only rate_hz times a second, from the model's samples by periodic cubic interpolation.

    Parameters
    ----------
    t : Trajectory
    rate_hz : float
    less_delay_s : float
        The output comes so much earlier.

    Returns
    -------
    (N,) ndarray
    """
    n = len(t.output)
    refreshed = np.floor(np.arange(n) * rate_hz / t.fs_hz + 1e-9) / rate_hz
    return t.spline((refreshed + less_delay_s) * t.fs_hz % n)


def _earlier(t: Trajectory, less_delay_s: float) -> np.ndarray:
    return period_of(lines_of(t.output) * np.exp(2j * np.pi * t.f_hz * less_delay_s), len(t.output))


def sample_hold_at(
    trajectories: list[Trajectory], rates: Iterable[float], *, exact: bool = False
) -> Iterator[Probe]:
    """A sensor refreshed at the rates given. A hold looks like a delay of half its time first of all.

    Parameters
    ----------
    trajectories : list of Trajectory
    rates : iterable of float
        Hz.
    exact : bool
        The rate itself, for its images, which a fit could not follow; else start where the droop of the gain
        would be as large as seen.
    """
    spare = trajectories[0].spare_delay_s
    for rate in rates:
        less = min(0.5 / rate, spare)
        columns = [lines_of(held_output(t, rate, less) - t.output)[None, :] for t in trajectories]

        # What is left beside the delay, the droop of the hold's gain, goes with the square of its time.
        def slower(c: np.ndarray, r: float = rate) -> float:
            return float(r if exact else r / np.sqrt(np.clip(c[0], 0.04, 100)))

        yield Probe(
            "sensor_sample_hold",
            columns,
            lambda c, at=slower: {"rate_hz": at(c)},
            one_sided=True,
            fixed=("rate_hz",) if exact else (),
            less_delay_s=lambda c, at=slower: min(0.5 / at(c), spare),
        )


def locked_rates(t: Trajectory) -> np.ndarray:
    """Rates whose refreshes repeat with the period, a 3000th of the sampling rate apart at least.

    Others leave no images in the mean.

    Parameters
    ----------
    t : Trajectory

    Returns
    -------
    (k,) ndarray
        From the slowest of the grid to 0.7 of the sampling rate.
    """
    slowest = _grid("sensor_sample_hold", "rate_hz").first
    once = t.fs_hz / len(t.output)
    every = once * np.ceil(t.fs_hz / 3000 / once)
    return np.arange(np.ceil(slowest * t.fs_hz / every), 0.7 * t.fs_hz / every) * every


def nominal_rates(fs_hz: float) -> list[float]:
    """Usual rates of sensors, for a sampling rate."""
    return _grid("sensor_sample_hold", "rate_hz").at(fs_hz).tolist()


def _sample_hold(trajectories: list[Trajectory]) -> Iterator[Probe]:
    yield from sample_hold_at(trajectories, nominal_rates(trajectories[0].fs_hz))


GRIDS: dict[str, Callable[[list[Trajectory]], Iterator[Probe]]] = {
    "viscous_friction": _single("viscous_friction", "rate", lambda t: t.rate, True),
    "coulomb_friction": _single("coulomb_friction", "level", lambda t: np.sign(t.rate), True),
    "stribeck_friction": _stribeck,
    "presliding_friction": _presliding,
    "quadratic_drag": _single("quadratic_drag", "rate", lambda t: t.rate * np.abs(t.rate), True),
    "cable_spring": _single("cable_spring", "stiffness", lambda t: t.angle),
    "cubic_spring": _single("cubic_spring", "stiffness", lambda t: t.angle**3),
    "mass_unbalance": _unbalance,
    "motor_cogging": _cogging,
    "hard_stop": _hard_stop,
    "drive_quantization": _quantization,
    "drive_dead_zone": _dead_zone,
    "drive_saturation": _saturation,
    "motor_lag": _lag("motor_lag"),
    "sensor_lag": _lag("sensor_lag"),
    "transport_delay": _delay,
    "flexible_mode": _flexible_mode,
    "sensor_sample_hold": _sample_hold,
}
