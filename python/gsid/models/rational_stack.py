"""A rational response as a stack of effects, so that laws act on it: y = G (u - torque / gain)  (PLT-5).

The motor's lags and the delay are taken out of G. What remains has one more pole than zeros from torque to
rate, and is the response of a body:

    gain / G_rate = s + damping + stiffness / s + sum (b1 s + b0) / (s^2 + a1 s + a0)

The terms of the sum have the zeros of G as poles, in pairs, each an effect `internal_dynamics`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsid.base.errors import InputError
from gsid.models.rational import RationalModel
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.plant.units import angle_unit_of

EQUAL = 1e-6  # relative distance of zeros that count as equal
ZERO = 1e-9  # share of the largest pole below which a spring is none
FAR = 4.0  # sample rates: frequency of the dynamics that stand for a negative damping
NO_DELAY = 0.05  # samples: a fit with a delay that is more negative than this is not causal


def stack_of(model: RationalModel, output: str, where: str = "") -> PlantModel:
    """The stack of effects that has the response of a rational model.

    Parameters
    ----------
    model : RationalModel
    output : {"rate", "angle"}
        What y is.
    where : str
        File name, for messages.

    Returns
    -------
    PlantModel
        All values are free, but for those that make `internal_dynamics` one of first order.

    Raises
    ------
    InputError
        Laws cannot act on this response.
    """
    if model.domain != "s" or not model.fs_hz:
        hint = "fit it in s, to records with a sample rate"
        raise InputError("laws act on a response in s with a sample rate", where, None, hint)
    if model.delay_s * model.fs_hz < -NO_DELAY:
        raise InputError(
            "laws cannot act on a response with a negative delay", where, f"{model.delay_s:.3g} s"
        )
    num, den = np.trim_zeros(model.num, "f"), model.den
    if not len(num):
        raise InputError("laws cannot act on a response that is zero", where)
    lags, den = _without_lags(den, len(den) - len(num) - (1 if output == "rate" else 2), where)
    zeros = np.roots(num)
    gain = float(num[0] * np.prod(lags))
    effects = [_effect("rigid_body", {"gain": gain}), *_body(den, zeros, output, model.fs_hz, where)]
    effects += [_effect("motor_lag", {"time_constant_s": float(lag)}) for lag in lags]
    if model.delay_s > 0:
        effects.append(_effect("transport_delay", {"delay_s": model.delay_s}))
    return PlantModel(
        fs_hz=model.fs_hz,
        effects=effects,
        output=output,
        angle_unit=angle_unit_of(model.y_unit),
        u_unit=model.u_unit,
        y_unit=model.y_unit,
    )


def _effect(name: str, values: Mapping[str, float], fixed: tuple[str, ...] = ()) -> Effect:
    return Effect(name, {key: Param(float(value), key not in fixed) for key, value in values.items()})


def _without_lags(den: np.ndarray, n_lags: int, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Time constants of the fastest real poles, and the denominator without them."""
    poles = np.roots(den)
    real = np.sort(poles[np.abs(poles.imag) <= EQUAL * np.abs(poles)].real)
    if n_lags < 0:
        hint = "fit one zero less: an angle has two poles more than zeros, a rate has one"
        raise InputError("laws cannot act on a response that a torque changes at once", where, None, hint)
    if np.sum(real < 0) < n_lags:
        hint = f"fit {n_lags} zeros more, or one pole less"
        what = "laws cannot act on a response with so few zeros: its poles are no lags of the motor"
        raise InputError(what, where, f"{len(poles)} poles", hint)
    lags = -1 / real[:n_lags]
    for lag in lags:
        den = np.polydiv(den, [1.0, 1 / lag])[0]
    return lags, den


def _body(den: np.ndarray, zeros: np.ndarray, output: str, fs_hz: float, where: str) -> list[Effect]:
    """Damping, spring and internal dynamics of a body from the poles and zeros of its response."""
    of_rate = np.append(zeros, 0.0) if output == "angle" else zeros
    size = np.max(np.abs(np.roots(den)), initial=1.0)
    gaps = np.abs(np.subtract.outer(of_rate, of_rate)) + size * np.eye(len(of_rate))
    if len(of_rate) and np.min(gaps) < EQUAL * size:
        raise InputError("laws cannot act on a response with two equal zeros", where, f"{zeros[0]:.4g} rad/s")
    monic = np.atleast_1d(np.poly(of_rate)).real
    quotient, rest = np.polydiv(den, monic)
    residues = np.polyval(rest, of_rate) / np.polyval(np.polyder(monic), of_rate) if len(of_rate) else of_rate
    effects = [_damping(float(quotient[1]), fs_hz)]
    if output == "angle":
        stiffness, residues = float(residues[-1].real), residues[:-1]
        if stiffness < -ZERO * size**2:
            what = "laws cannot act on a response with a negative spring"
            raise InputError(what, where, f"{stiffness:.4g} /s^2", "fit another order")
        if stiffness > ZERO * size**2:
            effects.append(_effect("cable_spring", {"stiffness": stiffness}))
    return effects + _dynamics(zeros, residues)


def _damping(rate: float, fs_hz: float) -> Effect:
    """Viscous friction, or for a negative one dynamics that are constant far below their frequency."""
    if rate >= 0:
        return _effect("viscous_friction", {"rate": rate})
    w0 = FAR * 2 * np.pi * fs_hz
    a1, a0 = np.sqrt(2) * w0, w0**2
    values = {"b1": rate * a1, "b0": rate * a0, "a1": a1, "a0": a0}
    return _effect("internal_dynamics", values, ("b1", "a1", "a0"))


def _dynamics(zeros: np.ndarray, residues: np.ndarray) -> list[Effect]:
    """Terms residue / (s - zero), two in each effect."""
    upper = zeros.imag > 0
    effects = []
    for z, r in zip(zeros[upper], residues[upper], strict=True):
        values = {"b1": 2 * r.real, "b0": -2 * (r * z.conjugate()).real, "a1": -2 * z.real, "a0": abs(z) ** 2}
        effects.append(_effect("internal_dynamics", values))
    real = np.flatnonzero(zeros.imag == 0)
    real = real[np.argsort(np.abs(zeros[real]))]
    z, r = zeros[real].real, residues[real].real
    for i in range(0, len(z) - 1, 2):
        values = {"b1": r[i] + r[i + 1], "b0": -(r[i] * z[i + 1] + r[i + 1] * z[i])}
        values |= {"a1": -(z[i] + z[i + 1]), "a0": z[i] * z[i + 1]}
        effects.append(_effect("internal_dynamics", values))
    if len(z) % 2:
        values = {"b1": r[-1], "b0": 0.0, "a1": -z[-1], "a0": 0.0}
        effects.append(_effect("internal_dynamics", values, ("b0", "a0")))
    return effects
