"""Frequency responses of the linear part of a plant: what a small torque or command does to the output.

The form of an effect's linear part stands in its descriptor (`EffectType.linear_part`); the forms are those
of include/gsid/effect_facts.h. Laws that are not linear have none: friction, stops and the like bend the
response only where they act, and these responses only have to point the search in the right direction (see
`gsid.diagnosis.probes`).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsid.effects.types import catalogue, linear_part

JOINT = next(e.id for e in catalogue().values() if e.linear_part == "joint")  # puts motor and load apart

Parts = Mapping[str, list[tuple[float, ...]]]  # values of the parameters of each effect, by its linear part
Stack = Mapping[str, Mapping[str, float]]


@dataclass(eq=False)
class LinearView:
    """Responses at the frequencies asked for, all with the sensor's filters.

    Parameters
    ----------
    torque : (K,) complex ndarray
        Torque / inertia to output.
    command : (K,) complex ndarray
        Record's input, held over each sample, to output: the command, or a loop's reference.
    change : (K,) complex ndarray
        A change of the command on its way to the drive, to output: in open loop the same as `command`, in a
        closed one what the controller leaves of it.
    direct : (K,) complex ndarray
        Command to output past the rigid body: gain, hold, delay and lags only.
    drive : (K,) complex ndarray
        Command to the motor's torque / inertia, without the sensor's filters.
    """

    torque: np.ndarray
    command: np.ndarray
    change: np.ndarray
    direct: np.ndarray
    drive: np.ndarray


def linear_view(
    stack: Stack,
    f_hz: np.ndarray,
    fs_hz: float,
    *,
    output_angle: bool = False,
    radians_per_unit: float = 1.0,
    held: bool = True,
) -> LinearView:
    """Responses of a stack's linear part (DIA-4).

    Parameters
    ----------
    stack : mapping
        {effect: {parameter: value}}, as `PlantModel.stack` gives it.
    f_hz : (K,) ndarray
        Hz; a line at 0 is taken just above it.
    fs_hz : float
    output_angle : bool
        Whether the output is the angle rather than the rate.
    radians_per_unit : float
        Of the angle, for the slope of laws that hold an angle inside a sine.
    held : bool
        Whether the command is held over each sample.

    Returns
    -------
    LinearView
    """
    f = np.where(f_hz == 0, 1e-3 * np.min(f_hz[f_hz > 0]), f_hz)
    s = 2j * np.pi * f
    parts = _parts(stack)
    spring = _sum(parts["spring"])
    pendulum = sum(level * np.cos(np.radians(angle_deg)) for level, angle_deg in parts["pendulum"])
    taken_up, motor_felt = _joint(parts, s)
    springs = (spring + pendulum * radians_per_unit) / s
    body = 1 / (s + _sum(parts["damping"]) + springs + motor_felt)
    actuator = _sum(parts["gain"]) * _lag(parts["lag of the actuator"], s)
    actuator = actuator * np.exp(-s * _sum(parts["delay"]))
    actuator = actuator * (_held(s, fs_hz) if held else 1.0)
    driven = actuator * taken_up
    sensor = _lag(parts["lag of the sensor"], s)
    for (rate_hz,) in parts["hold"]:
        if rate_hz > 0:  # 0: it follows at once
            sensor = sensor * _held(s, rate_hz)
    if output_angle:
        sensor = sensor / s
    loop = 1 / (1 + driven * body * _feedback(parts, s, fs_hz))
    change = (driven * body + actuator * _mode(parts, s)) * loop * sensor
    return LinearView(
        torque=body * loop * sensor,
        command=change * _reference(parts),
        change=change,
        direct=actuator * sensor,
        drive=actuator,
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


def _sum(values: list[tuple[float, ...]]) -> float:
    return float(sum(value for (value,) in values))


def _lag(values: list[tuple[float, ...]], s: np.ndarray) -> np.ndarray | float:
    return 1 / math.prod((1 + s * time_constant for (time_constant,) in values), start=1.0)


def _held(s: np.ndarray, rate_hz: float) -> np.ndarray:
    """Zero-order hold: (1 - exp(-s T)) / (s T)."""
    return -np.expm1(-s / rate_hz) * rate_hz / s


def _joint(parts: Parts, s: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
    """Share of the motor's torque that reaches the load, and what the load feels of the motor (DIA-8)."""
    if not parts["joint"]:
        return 1.0, 0.0
    _, stiffness, inertia_ratio, damping = parts["joint"][0]
    spring, motor = stiffness / s + damping, inertia_ratio * s
    return spring / (motor + spring), spring * motor / (motor + spring)


def _mode(parts: Parts, s: np.ndarray) -> np.ndarray | float:
    answer = 0.0
    for f_hz, zeta, residue in parts["mode"]:
        w0 = 2 * np.pi * f_hz
        answer = answer + residue * s / (s**2 + 2 * zeta * w0 * s + w0**2)
    return answer


def _feedback(parts: Parts, s: np.ndarray, fs_hz: float) -> np.ndarray | float:
    """Rate to command through the controller kv (kp (r - angle) - rate seen)."""
    if not parts["loop"]:
        return 0.0
    kp, kv, _, samples = parts["loop"][0]
    seen = _held(s, fs_hz / samples) if samples > 0 else 1.0  # the angle's change is the rate's mean
    return kv * (seen + kp / s)


def _reference(parts: Parts) -> float:
    """Record's input to command: 1 in open loop."""
    if not parts["loop"]:
        return 1.0
    kp, kv, *_ = parts["loop"][0]
    return kv * kp
