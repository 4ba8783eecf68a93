"""Frequency responses of the linear part of a plant: what a small torque or command does to the output.

Laws that are not linear are left out: friction, stops and the like bend the response only where they act, and
these responses only have to point the search in the right direction (see `gsid.probes`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

JOINT = "gear_backlash"  # the effect that puts motor and load apart

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
    spring = _sum(stack, "cable_spring", "stiffness")
    unbalance = sum(p["level"] * np.cos(np.radians(p["angle_deg"])) for p in _every(stack, "mass_unbalance"))
    taken_up, motor_felt = _joint(stack, s)
    springs = (spring + unbalance * radians_per_unit) / s
    body = 1 / (s + _sum(stack, "viscous_friction", "rate") + springs + motor_felt)
    actuator = _sum(stack, "rigid_body", "gain") * _lag(stack, "motor_lag", s)
    actuator = actuator * np.exp(-s * _sum(stack, "transport_delay", "delay_s"))
    actuator = actuator * (_held(s, fs_hz) if held else 1.0)
    driven = actuator * taken_up
    sensor = _lag(stack, "sensor_lag", s)
    for sampler in _every(stack, "sensor_sample_hold"):
        if sampler["rate_hz"] > 0:  # 0: it follows at once
            sensor = sensor * _held(s, sampler["rate_hz"])
    if output_angle:
        sensor = sensor / s
    loop = 1 / (1 + driven * body * _feedback(stack, s, fs_hz))
    change = (driven * body + actuator * _mode(stack, s)) * loop * sensor
    return LinearView(
        torque=body * loop * sensor,
        command=change * _reference(stack),
        change=change,
        direct=actuator * sensor,
        drive=actuator,
    )


def _every(stack: Stack, effect: str) -> list[Mapping[str, float]]:
    """Parameters of all effects of one id: the second is labelled "id#2"."""
    return [params for label, params in stack.items() if label.partition("#")[0] == effect]


def _sum(stack: Stack, effect: str, parameter: str) -> float:
    return float(sum(params[parameter] for params in _every(stack, effect)))


def _lag(stack: Stack, effect: str, s: np.ndarray) -> np.ndarray | float:
    return 1 / math.prod((1 + s * params["time_constant_s"] for params in _every(stack, effect)), start=1.0)


def _held(s: np.ndarray, rate_hz: float) -> np.ndarray:
    """Zero-order hold: (1 - exp(-s T)) / (s T)."""
    return -np.expm1(-s / rate_hz) * rate_hz / s


def _joint(stack: Stack, s: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
    """Share of the motor's torque that reaches the load, and what the load feels of the motor (DIA-8)."""
    if JOINT not in stack:
        return 1.0, 0.0
    gear = stack[JOINT]
    spring, motor = gear["stiffness"] / s + gear["damping"], gear["inertia_ratio"] * s
    return spring / (motor + spring), spring * motor / (motor + spring)


def _mode(stack: Stack, s: np.ndarray) -> np.ndarray | float:
    answer = 0.0
    for mode in _every(stack, "flexible_mode"):
        w0 = 2 * np.pi * mode["f_hz"]
        answer = answer + mode["residue"] * s / (s**2 + 2 * mode["zeta"] * w0 * s + w0**2)
    return answer


def _feedback(stack: Stack, s: np.ndarray, fs_hz: float) -> np.ndarray | float:
    """Rate to command through the controller kv (kp (r - angle) - rate seen)."""
    if "position_velocity_loop" not in stack:
        return 0.0
    loop = stack["position_velocity_loop"]
    samples = loop.get("rate_samples", 0.0)
    seen = _held(s, fs_hz / samples) if samples > 0 else 1.0  # the angle's change is the rate's mean
    return loop["kv"] * (seen + loop["kp"] / s)


def _reference(stack: Stack) -> float:
    """Record's input to command: 1 in open loop."""
    if "position_velocity_loop" not in stack:
        return 1.0
    loop = stack["position_velocity_loop"]
    return loop["kv"] * loop["kp"]
