"""Candidate effects as directions in the space of the measurement: the change of the output due to each.

To first order a torque law n(angle, rate) adds -G_tau N to the output, where N are the lines of the law along
the simulated trajectory of the fitted model. A law on the command adds G_u times the lines of the change of
the command (DIA-3). One point of a grid over the shape parameters (speeds, lengths, pitches, thresholds)
therefore costs one transform. Threshold laws are evaluated at a finite size, because their derivative at zero
does not exist. The directions only select candidates and give their starting values. The few best candidates
are then fitted by simulation.
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

SOFTEST_STOP = 10.0  # 1/s^2: a softer stop is in contact for seconds and is better modelled as a spring


@dataclass(eq=False)
class Trajectory:
    """One record's excitation and the simulated motion of the fitted model, over one period.

    Parameters
    ----------
    fs_hz : float
    command, angle, rate, output : (N,) ndarrays
        Command at the drive, and the model's angle, rate and output.
    f_hz : (K,) ndarray
        All lines, 0 .. N/2.
    excited : (K,) ndarray of bool
    torque_response, change_response, direct_response : (K,) complex ndarrays
        Responses of the model's linear part to the output: from torque / inertia, from a change of the
        command, and from the command without the rigid body (gain, hold, delay, lags).
    radians_per_unit : float
        Unit of the angle: pi/180 for degrees.
    spare_delay_s : float
        Delay of the model that a lag can replace.
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
        """Output as a function of the sample index, interpolated between samples."""
        n = len(self.output)
        return CubicSpline(np.arange(n + 1), np.append(self.output, self.output[0]), bc_type="periodic")

    def of_torque(self, law: np.ndarray) -> np.ndarray:
        """(K,) change of the output due to a torque law along the trajectory."""
        return -self.torque_response * lines_of(law)

    def of_command(self, change: np.ndarray) -> np.ndarray:
        """(K,) change of the output due to a change of the command."""
        return self.change_response * lines_of(change)


@dataclass(eq=False)
class Probe:
    """One candidate effect at one grid point.

    Parameters
    ----------
    effect : str
    columns : list of (q, K) complex ndarrays
        Changes of the output due to the effect, one entry per trajectory.
    start : callable
        Returns starting values of the effect's parameters for given coefficients of the columns.
    one_sided : bool
        Only coefficients >= 0 are physical.
    limits : dict of (lo, hi)
        Bounds of shape parameters in a fit, within which these data can distinguish the effect from simpler
        ones. Presliding within a thousandth of the travel is Coulomb friction, for instance.
    fixed : tuple of str
        Parameters without a derivative, which are kept at their grid point.
    less_delay_s : callable
        Returns by how much the effect shortens the model's own delay, for given coefficients.
    """

    effect: str
    columns: list[np.ndarray]
    start: Callable[[np.ndarray], Params]
    one_sided: bool = False
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    fixed: tuple[str, ...] = ()
    less_delay_s: Callable[[np.ndarray], float] = lambda c: 0.0


def probes(trajectories: list[Trajectory], effects: list[str]) -> Iterator[Probe]:
    """Candidates of the given effects, over their grids.

    Parameters
    ----------
    trajectories : list of Trajectory
    effects : list of str
        Catalogue names; effects without a direction along the trajectory are skipped (torque_bias,
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
    """Candidates of a law whose only parameter is its size."""

    def make(trajectories: list[Trajectory]) -> Iterator[Probe]:
        yield _torque(effect, trajectories, lambda t: [law(t)], lambda c: {parameter: c[0]}, one_sided)

    return make


def _largest(trajectories: list[Trajectory], signal: str) -> float:
    return max(float(np.max(np.abs(getattr(t, signal)))) for t in trajectories)


def _grid(effect: str, parameter: str) -> Grid:
    """Search grid of a parameter, from the descriptor of the effect."""
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
    """Periodic presliding state along a trajectory: dz/dtheta = stiffness (1 - z sign(dtheta)).

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
        # Only the even part, because the odd part is similar to a spring and its coefficient is unreliable.
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
    """Quantization of the command with the given steps.

    Parameters
    ----------
    trajectories : list of Trajectory
    steps : (k,) ndarray
    """
    yield from _command("drive_quantization", trajectories, "step", steps, _rounded, fixed=("step",))


def quantization_spacing(trajectories: list[Trajectory], step: float) -> float:
    """Distance of neighbouring grid points."""
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
        # The effect of a small dead zone is proportional to its width, so the coefficient scales the width.
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

            # The phase of a short lag grows with T, but a delay imitates it; its gain falls with T^2.
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
    """(K,) change of the output if a lag replaces a part of the delay."""
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
    """Output of a sample and hold at rate_hz, by periodic cubic interpolation of the model's samples.

    Parameters
    ----------
    t : Trajectory
    rate_hz : float
    less_delay_s : float
        Time by which the output is advanced.

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
    """Candidates of a sample and hold at the given rates; half a hold time is subtracted from the delay.

    Parameters
    ----------
    trajectories : list of Trajectory
    rates : iterable of float
        Hz.
    exact : bool
        True: start at the rate itself, to match its images, which a fit cannot track. False: start at the
        rate for which the droop of the gain is as large as measured.
    """
    spare = trajectories[0].spare_delay_s
    for rate in rates:
        less = min(0.5 / rate, spare)
        columns = [lines_of(held_output(t, rate, less) - t.output)[None, :] for t in trajectories]

        # Without the delay, the droop of the gain remains, which is proportional to the hold time squared.
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
    """Rates whose refreshes repeat with the period, spaced by at least 1/3000 of the sampling rate.

    Other rates have no images in the mean period.

    Parameters
    ----------
    t : Trajectory

    Returns
    -------
    (k,) ndarray
        From the lowest rate of the grid to 0.7 of the sampling rate.
    """
    slowest = _grid("sensor_sample_hold", "rate_hz").first
    once = t.fs_hz / len(t.output)
    every = once * np.ceil(t.fs_hz / 3000 / once)
    return np.arange(np.ceil(slowest * t.fs_hz / every), 0.7 * t.fs_hz / every) * every


def nominal_rates(fs_hz: float) -> list[float]:
    """Common sensor rates for a given sampling rate."""
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
