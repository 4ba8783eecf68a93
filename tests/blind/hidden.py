"""What can be hidden in a blind trial: the catalogue's effects in the simulator's words, and foreign ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

FS_HZ = 3000.0  # of the loop

# Catalogue id -> its parameters' names in the simulator, by the catalogue's names.
CATALOGUE: dict[str, dict[str, str]] = {
    "rigid_body": {"gain": "gain"},
    "transport_delay": {"delay_s": "delay_s"},
    "motor_lag": {"time_constant_s": "motor_lag_s"},
    "drive_quantization": {"step": "quantization_step"},
    "drive_dead_zone": {"half_width": "dead_zone_half_width"},
    "drive_saturation": {"limit": "saturation_limit"},
    "viscous_friction": {"rate": "viscous_rate"},
    "coulomb_friction": {"level": "coulomb_level"},
    "stribeck_friction": {
        "level": "coulomb_level",
        "extra": "stribeck_extra",
        "velocity": "stribeck_velocity",
    },
    "presliding_friction": {"level": "presliding_level", "stiffness": "presliding_stiffness"},
    "quadratic_drag": {"rate": "quadratic_drag_rate"},
    "cable_spring": {"stiffness": "spring_stiffness"},
    "cubic_spring": {"stiffness": "cubic_stiffness"},
    "mass_unbalance": {"level": "unbalance_level", "angle_deg": "unbalance_angle_deg"},
    "motor_cogging": {
        "level": "cogging_level",
        "cycles_per_rev": "cogging_cycles",
        "phase_rad": "cogging_phase_rad",
    },
    "hard_stop": {"angle_deg": "stop_angle_deg", "stiffness": "stop_stiffness"},
    "gear_backlash": {
        "gap_deg": "gear_gap_deg",
        "stiffness": "gear_stiffness",
        "inertia_ratio": "gear_inertia_ratio",
        "damping": "gear_damping",
    },
    "flexible_mode": {"f_hz": "mode_hz", "zeta": "mode_zeta", "residue": "mode_residue"},
    "sensor_lag": {"time_constant_s": "sensor_lag_s"},
    "sensor_sample_hold": {"rate_hz": "sample_hold_hz"},
}
BASE = ("rigid_body", "transport_delay", "viscous_friction", "cable_spring", "flexible_mode", "sensor_lag")
# torque_bias only shifts the rest position of a linear axis: alone it leaves no trace in the rate.
PAIRED = (
    "coulomb_friction",
    "cubic_spring",
    "drive_dead_zone",
    "drive_saturation",
    "quadratic_drag",
    "mass_unbalance",
    "motor_cogging",
    "presliding_friction",
)

# Another effect can be exactly these: Stribeck's friction with nothing extra, cogging of one cycle per
# turn; and in an axis that is linear but for what is hidden, lags before and behind it change places.
CONTAINED = ("coulomb_friction", "mass_unbalance", "motor_lag", "sensor_lag")

Params = dict[str, float]
Rng = np.random.Generator


@dataclass
class Hidden:
    """A hidden effect on its way from nothing (size 0) to much; what is not its size is drawn once."""

    params: Callable[[float], Params]
    size: float  # first guess
    size_max: float
    size_min: float = 0.0


@dataclass
class Axis:
    """What a hidden effect may look at when it is drawn."""

    gain: float
    peak_command: float
    peak_angle: float


Hiding = Callable[[Rng, Axis], Hidden]
Draw = Callable[[Rng], float]


def uniform(low: float, high: float) -> Draw:
    return lambda rng: rng.uniform(low, high)


def log_uniform(low: float, high: float) -> Draw:
    return lambda rng: float(np.exp(rng.uniform(np.log(low), np.log(high))))


def signed(low: float, high: float) -> Draw:
    return lambda rng: float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


# ---- effects by the distributions of what is not their size ----------------------------------------


def _plain(name: str, size: float, size_max: float) -> Hiding:
    return lambda rng, axis: Hidden(lambda s: {name: s}, size, size_max)


def stribeck(extra: Draw, velocity: Draw) -> Hiding:
    def hiding(rng: Rng, axis: Axis) -> Hidden:
        share, at = extra(rng), velocity(rng)
        return Hidden(
            lambda s: {"coulomb_level": s, "stribeck_extra": s * share, "stribeck_velocity": at}, 0.1, 50.0
        )

    return hiding


def presliding(stiffness: Draw) -> Hiding:
    def hiding(rng: Rng, axis: Axis) -> Hidden:
        stiff = stiffness(rng)
        return Hidden(lambda s: {"presliding_level": s, "presliding_stiffness": stiff}, 0.1, 50.0)

    return hiding


def unbalance(angle_deg: Draw) -> Hiding:
    def hiding(rng: Rng, axis: Axis) -> Hidden:
        angle = angle_deg(rng)
        return Hidden(lambda s: {"unbalance_level": s, "unbalance_angle_deg": angle}, 1.0, 2000.0)

    return hiding


def cogging(cycles: Draw) -> Hiding:
    def hiding(rng: Rng, axis: Axis) -> Hidden:
        n, phase = cycles(rng), rng.uniform(-np.pi, np.pi)
        return Hidden(
            lambda s: {"cogging_level": s, "cogging_cycles": n, "cogging_phase_rad": phase}, 0.1, 50.0
        )

    return hiding


def stop(stiffness: Draw, size_max: float) -> Hiding:
    def hiding(rng: Rng, axis: Axis) -> Hidden:
        stiff = stiffness(rng)
        return Hidden(
            lambda s: {"stop_angle_deg": axis.peak_angle / (1 + s), "stop_stiffness": stiff}, 0.003, size_max
        )

    return hiding


def mode(f_hz: Draw, zeta: Draw, sign: Draw, size_max: float) -> Hiding:
    def hiding(rng: Rng, axis: Axis) -> Hidden:
        f, z, side = f_hz(rng), zeta(rng), sign(rng)
        return Hidden(lambda s: {"mode_hz": f, "mode_zeta": z, "mode_residue": side * s}, 1e-4, size_max)

    return hiding


def lugre(rng: Rng, axis: Axis) -> Hidden:
    stiffness, extra, velocity = log_uniform(10, 60)(rng), rng.uniform(0.1, 0.4), rng.uniform(0.5, 2.0)
    damping = rng.uniform(0.05, 0.3)
    return Hidden(
        lambda s: {
            "presliding_level": s,
            "presliding_stiffness": stiffness,
            "lugre_extra": extra,
            "lugre_velocity": velocity,
            "lugre_damping": damping * s,
        },
        0.1,
        50.0,
    )


def _backlash(rng: Rng, axis: Axis) -> Hidden:
    """Play of a size that gears have, between motor and load: large or small, it is never a faint effect."""
    ratio, f_hz, zeta = rng.uniform(0.1, 0.6), rng.uniform(100, 350), rng.uniform(0.1, 0.2)
    reduced = ratio / (1 + ratio) ** 2  # inertia of the twist
    rad_s = 2 * np.pi * f_hz
    # With much less than a tenth of critical the play rattles for ever and nothing is periodic.
    gear = {
        "gear_stiffness": rad_s**2 * reduced,
        "gear_inertia_ratio": ratio,
        "gear_damping": 2 * zeta * rad_s * reduced,
    }
    size = log_uniform(0.002, 0.03)(rng)
    return Hidden(lambda s: gear | {"gear_gap_deg": s}, size, size, size)


SINGLE: dict[str, Hiding] = {
    "transport_delay": _plain("delay_s", 1e-5, 0.012),
    "motor_lag": _plain("motor_lag_s", 1e-5, 0.02),
    "drive_quantization": _plain("quantization_step", 0.5, 8.0),
    "drive_dead_zone": _plain("dead_zone_half_width", 0.05, 8.0),
    "drive_saturation": lambda rng, axis: Hidden(
        lambda s: {"saturation_limit": axis.peak_command / (1 + s)}, 0.02, 2.0
    ),
    "viscous_friction": _plain("viscous_rate", 1e-2, 20.0),
    "coulomb_friction": _plain("coulomb_level", 0.1, 50.0),
    "stribeck_friction": stribeck(uniform(0.3, 1.0), uniform(0.5, 3.0)),
    "presliding_friction": presliding(log_uniform(10, 100)),
    "quadratic_drag": _plain("quadratic_drag_rate", 1e-3, 2.0),
    "cable_spring": _plain("spring_stiffness", 1e-1, 60.0),
    "cubic_spring": _plain("cubic_stiffness", 1e-1, 50.0),
    "mass_unbalance": unbalance(signed(20, 80)),
    "motor_cogging": cogging(lambda rng: float(rng.integers(24, 145))),
    # A stiff stop without losses bounces: whether the axis touches or rattles depends on how it got there.
    "hard_stop": stop(log_uniform(100, 1000), 0.6),
    "gear_backlash": _backlash,
    "flexible_mode": mode(uniform(60, 185), uniform(0.01, 0.03), lambda rng: 1.0, 2.0),
    "sensor_lag": _plain("sensor_lag_s", 1e-5, 0.02),
    # A rate whose refreshes repeat with the period, 2000 Hz at most: near the loop's own there is no hold.
    "sensor_sample_hold": lambda rng, axis: Hidden(
        lambda s: {"sample_hold_hz": float(np.round(FS_HZ / (1 + s)))}, 3.0, 14.0, 0.5
    ),
}


def _snap(rng: Rng, axis: Axis) -> Hidden:
    angle, width = signed(0, 1)(rng), rng.uniform(0.1, 0.4)
    return Hidden(lambda s: {"snap_level": s, "snap_angle_deg": angle, "snap_width_deg": width}, 0.1, 100.0)


def _creep(rng: Rng, axis: Axis) -> Hidden:
    time_s = rng.uniform(0.1, 1.0)
    return Hidden(lambda s: {"creep_stiffness": s, "creep_time_s": time_s}, 0.1, 60.0)


def _friction_of_angle(rng: Rng, axis: Axis) -> Hidden:
    cycles, phase = rng.uniform(60, 200), rng.uniform(-np.pi, np.pi)
    return Hidden(
        lambda s: {
            "coulomb_level": s,
            "friction_ripple": 0.95,
            "friction_ripple_cycles": cycles,
            "friction_ripple_phase_rad": phase,
        },
        0.1,
        50.0,
    )


FOREIGN: dict[str, Hiding] = {
    "magnetic_snap": _snap,
    "eddy_brake_by_command": _plain("eddy_rate", 1e-3, 1.0),
    "creep": _creep,
    # From the largest step of the command down.
    "command_rate_limit": lambda rng, axis: Hidden(
        lambda s: {"command_rate_limit": axis.peak_command / (1 + s)}, 0.05, 20.0
    ),
    "friction_of_angle": _friction_of_angle,
    "command_even_gain": _plain("command_even", 1e-5, 3e-3),
    "gyro_cubic": _plain("gyro_cubic", 1e-6, 1e-3),
}


def shapes_of_the_catalogue(axis: Axis) -> Iterator[tuple[str, list[Params]]]:
    """What the catalogue's effects can look like, coarsely: id, and a span of one or two small effects."""
    small = 0.01
    for effect in ("quadratic_drag", "cubic_spring", "coulomb_friction"):
        (name,) = CATALOGUE[effect].values()
        yield effect, [{name: small}]
    yield "motor_lag", [{"motor_lag_s": 1e-4}]
    for velocity in (0.3, 1.0, 3.0):
        only_extra = {"stribeck_extra": small, "stribeck_velocity": velocity}
        yield "stribeck_friction", [{"coulomb_level": small}, only_extra]
    for stiffness in (5.0, 12.0, 30.0, 75.0, 200.0):
        yield "presliding_friction", [{"presliding_level": small, "presliding_stiffness": stiffness}]
    yield "mass_unbalance", [{"unbalance_level": 1.0, "unbalance_angle_deg": a} for a in (0.0, 90.0)]
    for cycles in (1.0, 2.5, *np.geomspace(5, 250, 18)):  # with 1 it is an unbalance
        waves = [
            {"cogging_level": small, "cogging_cycles": cycles, "cogging_phase_rad": phase}
            for phase in (0.0, np.pi / 2)
        ]
        yield "motor_cogging", waves
    for size in (0.03, 0.2, 1.0):
        yield "drive_dead_zone", [{"dead_zone_half_width": size}]
        yield "drive_saturation", [{"saturation_limit": axis.peak_command / (1 + size)}]
        stop_angle = axis.peak_angle / (1 + 0.3 * size)
        yield "hard_stop", [{"stop_angle_deg": stop_angle, "stop_stiffness": 300.0}]
    for rate_hz in (300.0, 400.0, 600.0, 1000.0):
        yield "sensor_sample_hold", [{"sample_hold_hz": rate_hz}]


# Locked to the period: unlisted effects of the kind "dirty".
LOCKED: dict[str, Params] = {
    "command_cubic": {"command_cubic": 1e-6},
    "gyro_even": {"gyro_even": 1e-4},
    "gyro_cubic": {"gyro_cubic": 1e-5},
    "gain_ripple": {"gain_ripple": 1e-3, "gain_ripple_cycles": 90.0},
}
