"""Frequency responses of the linear part of a plant, from a small torque or command to the output.

The form of an effect's linear part is given in its descriptor (`EffectType.linear_part`); the forms are those
of include/gsid/effect_facts.h. Nonlinear laws (friction, stops and the like) have no linear part here. The
responses lead a search for starting values (see `gsid.diagnosis.missing_torque`) and need not be exact.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gsid.base.zero_order_hold import hold_factor
from gsid.effects.types import catalogue, linear_part

BACKLASH = next(e.id for e in catalogue().values() if e.linear_part == "backlash")  # between motor and load

TINY = 1e-9  # small beside any divisor off the resonance, and large enough that the response stays finite

Parts = Mapping[str, list[tuple[float, ...]]]  # values of the parameters of each effect, by its linear part
Stack = Mapping[str, Mapping[str, float]]


@dataclass(eq=False)
class LinearView:
    """Responses at the requested frequencies, all with the sensor's filters.

    Parameters
    ----------
    torque : (K,) complex ndarray
        Torque / inertia to output.
    command : (K,) complex ndarray
        Record's input, held over each sample, to output: the command, or a loop's reference.
    change : (K,) complex ndarray
        A disturbance added to the command before the drive, to output. In open loop it equals `command`; in
        closed loop the controller reduces it.
    direct : (K,) complex ndarray
        Command to output past the rigid body: gain, hold, delay and lags only.
    drive : (K,) complex ndarray
        Command to the motor's torque / inertia, without the sensor's filters.
    loop : (K,) complex ndarray
        What a closed loop leaves of a command that is added before the drive; 1 in open loop.
    reference : float
        Record's input to the command of an axis that stands still; 1 in open loop.
    """

    torque: np.ndarray
    command: np.ndarray
    change: np.ndarray
    direct: np.ndarray
    drive: np.ndarray
    loop: np.ndarray
    reference: float = 1.0


def linear_view(
    stack: Stack,
    f_hz: np.ndarray,
    fs_hz: float,
    *,
    output_angle: bool = False,
    radians_per_unit: float = 1.0,
    held: bool = True,
    hold: np.ndarray | None = None,
    sensor_hold: Callable[[float], np.ndarray] | None = None,
) -> LinearView:
    """Responses of a stack's linear part (DIA-4).

    Parameters
    ----------
    stack : mapping
        {effect: {parameter: value}}, as `PlantModel.stack` gives it. The values of several stacks may be
        given as (n, 1) ndarrays, except those of a hold, a loop and a backlash: responses are (n, K) then.
    f_hz : (K,) ndarray
        Hz; a line at 0 is taken just above it.
    fs_hz : float
    output_angle : bool
        Whether the output is the angle rather than the rate.
    radians_per_unit : float
        Radians in a unit of angle, for the slope of laws that contain the sine of an angle.
    held : bool
        Whether the command is held over each sample.
    hold : (K,) complex ndarray, optional
        The response of the hold (`hold_factor`), if it is known.
    sensor_hold : callable, optional
        Gives the response at the frequencies of a sensor that is sampled and held at a rate [Hz]. Default:
        `hold_factor`, that of a sensor whose output is read continuously.

    Returns
    -------
    LinearView
    """
    f = np.where(f_hz == 0, 1e-3 * np.min(f_hz[f_hz > 0]), f_hz)
    s = 2j * np.pi * f
    parts = _parts(stack)
    spring = _sum(parts["spring"])
    pendulum = sum(level * np.cos(np.radians(angle_deg)) for level, angle_deg in parts["pendulum"])
    transmitted, reaction = _gear(parts, s)
    springs = (spring + pendulum * radians_per_unit) / s
    body = 1 / _nonzero(s + _sum(parts["damping"]) + springs + reaction + _dynamics(parts, s))
    actuator = _sum(parts["gain"]) * _lag(parts["lag of the actuator"], s)
    actuator = actuator * np.exp(-s * _sum(parts["delay"]))
    if held:
        actuator = actuator * (hold_factor(f, fs_hz) if hold is None else hold)
    driven = actuator * transmitted
    sensor = _lag(parts["lag of the sensor"], s)
    for (rate_hz,) in parts["hold"]:
        if rate_hz > 0:  # 0: no hold
            sensor = sensor * (sensor_hold(rate_hz) if sensor_hold else hold_factor(f, rate_hz))
    if output_angle:
        sensor = sensor / s
    loop = 1 / (1 + driven * body * _feedback(parts, f, fs_hz))
    change = (driven * body + actuator * _mode(parts, s)) * loop * sensor
    reference = _reference(parts)
    return LinearView(
        torque=body * loop * sensor,
        command=change * reference,
        change=change,
        direct=actuator * sensor,
        drive=actuator,
        loop=loop,
        reference=reference,
    )


def _parts(stack: Stack) -> Parts:
    """Values of the effects that have a linear part; the second of an id is labelled "id#2"."""
    parts: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    for label, params in stack.items():
        known = linear_part(label.partition("#")[0])
        if known is not None:
            part = known.linear_part
            if part == "lag":
                part = f"lag of the {known.stage}"
            parts[part].append(tuple(params.get(p.name, p.null_value) for p in known.parameters))
    return parts


def _sum(values: list[tuple[float, ...]]) -> float | np.ndarray:
    return sum((value for (value,) in values), start=0.0)


def _lag(values: list[tuple[float, ...]], s: np.ndarray) -> np.ndarray | float:
    return 1 / math.prod((1 + s * time_constant for (time_constant,) in values), start=1.0)


def _gear(parts: Parts, s: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
    """Share of the motor torque transmitted to the load, and the motor's reaction per rate (DIA-8)."""
    if not parts["backlash"]:
        return 1.0, 0.0
    _, stiffness, inertia_ratio, damping = parts["backlash"][0]
    spring, motor = stiffness / s + damping, inertia_ratio * s
    return spring / (motor + spring), spring * motor / (motor + spring)


def _dynamics(parts: Parts, s: np.ndarray) -> np.ndarray | float:
    """Torque per rate of the internal dynamics."""
    return sum(
        ((b1 * s + b0) / _nonzero(s**2 + a1 * s + a0) for b1, b0, a1, a0 in parts["dynamics"]), start=0.0
    )


def _mode(parts: Parts, s: np.ndarray) -> np.ndarray | float:
    answer = 0.0
    for f_hz, zeta, residue in parts["mode"]:
        w0 = 2 * np.pi * f_hz
        answer = answer + residue * s / _nonzero(s**2 + 2 * zeta * w0 * s + w0**2)
    return answer


def _nonzero(divisor: np.ndarray) -> np.ndarray:
    """A divisor that is exactly zero, on the frequency of an undamped resonance, replaced by a tiny one."""
    return divisor if np.all(divisor) else np.where(divisor == 0, TINY, divisor)


def _feedback(parts: Parts, f_hz: np.ndarray, fs_hz: float) -> np.ndarray | float:
    """Rate to command through the controller kv (kp (r - angle) - measured rate)."""
    if not parts["loop"]:
        return 0.0
    kp, kv, _, samples = parts["loop"][0]
    # A difference of angles is a mean rate: it has the factor of a hold.
    measured = hold_factor(f_hz, fs_hz / samples) if samples > 0 else 1.0
    return kv * (measured + kp / (2j * np.pi * f_hz))


def _reference(parts: Parts) -> float:
    """Record's input to command: 1 in open loop."""
    if not parts["loop"]:
        return 1.0
    kp, kv, *_ = parts["loop"][0]
    return kv * kp
