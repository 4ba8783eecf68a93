"""Where the axis was at the begin of the measured period: there the search for its periodic orbit begins.

A plant with stops has several periodic orbits, and that of its linear part reaches far beyond the stops.
"""

from __future__ import annotations

import numpy as np
from scipy import optimize

from gsid._lib import check, ffi, lib
from gsid.effects.types import EffectType
from gsid.plant.effect import Effect, Stack
from gsid.plant.linear_response import linear_view
from gsid.plant.units import RADIANS
from gsid.spectrum.lines import period_of
from gsid.spectrum.spectra import Spectra

DOUBLED = 20  # times that the search for the mean angle goes further out: a million times the travel
MARGIN = 1.5  # of the band of the excitation: above it the noise of a derivative counts


def has_several_orbits(model: Stack) -> bool:
    """Whether a law of the angle has edges, such as stops.

    Parameters
    ----------
    model : Stack
    """
    return any(_has_edges(effect.type) for effect in model.effects) and not model.has_controller


def _has_edges(effect: EffectType) -> bool:
    return effect.c.edge != ffi.NULL and bool(effect.c.looks_at_angle)


def measured_state(model: Stack, measured: Spectra) -> tuple[float, float]:
    """Angle and rate of the axis at the first sample of the mean period, from the measured output.

    The output is divided by the response of the sensor, and the part of flexible modes is subtracted. Lines
    have the Wiener weight max(0, 1 - variance / |Y|^2). The mean angle of a rate sensor is that at which
    springs, stops and other laws of the angle hold the constant torque of the model.

    Parameters
    ----------
    model : Stack
    measured : Spectra
    """
    top = min(int(MARGIN * np.flatnonzero(measured.excited)[-1]) + 1, len(measured.line) - 1)
    line = measured.line[1:top]
    y, u = measured.y[1:top], measured.u[1:top]
    stack = {
        label: {name: param.value for name, param in effect.params.items()}
        for label, effect in model.labels()
        if effect.type.linear_part
    }
    is_angle = model.output == "angle"
    how = {"output_angle": is_angle, "radians_per_unit": RADIANS[model.angle_unit]}
    f_hz = line * (measured.fs_hz / measured.period_samples)
    view = linear_view(stack, f_hz, measured.fs_hz, held=measured.hold != "none", **how)
    power = np.abs(y) ** 2
    noise = measured.noise_y[1:top] / measured.n_periods
    wiener = np.maximum(0.0, 1 - noise / np.where(power > 0, power, np.inf))
    beside = view.command - view.drive * view.torque  # what a mode adds to the output
    rate = wiener * (y - beside * u) / (view.direct / view.drive)
    angle = rate / (2j * np.pi * f_hz)
    if is_angle:
        mean = float(measured.y[0].real)
    else:
        lines = np.zeros(len(measured.line), complex)
        lines[line] = angle
        mean = _mean_angle(model, period_of(lines, measured.period_samples))
    return mean + float(np.sum(angle.real)), float(np.sum(rate.real))


def _mean_angle(model: Stack, around_mean: np.ndarray) -> float:
    """Mean angle at which springs, stops and other laws of the angle hold the constant torque; else 0.

    Eq: PLT-6

    Parameters
    ----------
    model : Stack
    around_mean : (n,) ndarray
        Angle of the axis less its mean.
    """
    bias, spring = (
        sum(next(iter(effect.params.values())).value for effect in model.effects if effect.id == id_)
        for id_ in ("torque_bias", "cable_spring")
    )
    laws = [effect for effect in model.effects if _is_of_angle(effect.type)]

    def torque(mean: float) -> float:
        return bias + spring * mean + sum(_mean_torque(law, around_mean + mean, model) for law in laws)

    if torque(0.0) == 0:
        return 0.0
    reach = float(np.abs(around_mean).max()) or 1.0
    for _ in range(DOUBLED):
        if torque(-reach) * torque(reach) < 0:
            return float(optimize.brentq(torque, -reach, reach))
        reach *= 2
    return 0.0


def _is_of_angle(effect: EffectType) -> bool:
    """Whether it is a torque of the angle without states or memory."""
    c = effect.c
    return bool(c.looks_at_angle and c.torque != ffi.NULL and not c.n_states and not c.has_memory)


def _mean_torque(law: Effect, angle: np.ndarray, model: Stack) -> float:
    """Mean torque of a law along angles at which the axis is at rest."""
    n, out, still = len(angle), np.empty(len(angle)), np.zeros(len(angle))
    values = np.zeros((1, lib.GSID_EFFECT_PARAMETERS_MAX))
    values[0, : len(law.params)] = [param.value for param in law.params.values()]
    along, rate, given, torque = (ffi.from_buffer("double[]", x) for x in (angle, still, values, out))
    sizes = {"n": n, "step_s": 1.0, "unit_rad": RADIANS[model.angle_unit]}
    motion = ffi.new("gsid_law_motion *", sizes | {"angle": along, "rate": rate, "side": rate})
    check(lib.gsid_law_torques(law.type.c, law.type.data, motion, 1, given, torque), law.id)
    return float(out.mean())
