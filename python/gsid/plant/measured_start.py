"""Where the axis was at the begin of the measured period: there the search for its periodic orbit begins.

A plant with stops has several periodic orbits, and that of its linear part reaches far beyond the stops.
"""

from __future__ import annotations

import numpy as np

from gsid.effects.types import EffectType
from gsid.plant.effect import Stack
from gsid.plant.linear_response import linear_view
from gsid.plant.units import RADIANS
from gsid.spectrum.spectra import Spectra

MARGIN = 1.5  # of the band of the excitation: above it the noise of a derivative counts


def has_several_orbits(model: Stack) -> bool:
    """Whether a law of the angle has edges, such as stops.

    Parameters
    ----------
    model : Stack
    """
    return any(_has_edges(effect.type) for effect in model.effects) and not model.has_controller


def _has_edges(effect: EffectType) -> bool:
    from gsid._lib import ffi

    return effect.c.edge != ffi.NULL and bool(effect.c.looks_at_angle)


def measured_state(model: Stack, measured: Spectra) -> tuple[float, float]:
    """Angle and rate of the axis at the first sample of the mean period, from the measured output.

    The output is divided by the response of the sensor, and the part of flexible modes is subtracted. Lines
    have the Wiener weight max(0, 1 - variance / |Y|^2). The mean angle of a rate sensor is that at which
    springs hold the constant torque of the model.

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
    mean = float(measured.y[0].real) if is_angle else _mean_angle(model)
    return mean + float(np.sum(angle.real)), float(np.sum(rate.real))


def _mean_angle(model: Stack) -> float:
    bias, spring = (
        sum(next(iter(effect.params.values())).value for effect in model.effects if effect.id == id_)
        for id_ in ("torque_bias", "cable_spring")
    )
    return -bias / spring if spring > 0 else 0.0
