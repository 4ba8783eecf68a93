"""A structure as a stack of effects, with the covariance of its parameters, and as a rational function."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsid.effects.ids import LAGS
from gsid.structure.covariance import Estimate
from gsid.structure.elements import INTEGRATIONS

ABOVE = 4.0
"""Frequency of the mode that stands for all modes above the band, over the highest line."""
ABOVE_ZETA = 0.05


@dataclass(frozen=True, eq=False)
class Stack:
    """Parameters of a stack of effects.

    Attributes
    ----------
    effects : dict
        {effect: {parameter: value}}; a second effect of an id is "id#2".
    names : list of str
        "effect.parameter" of the estimated parameters.
    covariance, noise_only : (n, n) ndarray
        Of these.
    """

    effects: dict[str, dict[str, float]]
    names: list[str]
    covariance: np.ndarray
    noise_only: np.ndarray


def as_stack(estimate: Estimate, f_max_hz: float) -> Stack:
    """Express an estimate in the parameters of the catalogue.

    Parameters
    ----------
    estimate : Estimate
    f_max_hz : float
        Highest line.

    Returns
    -------
    Stack
    """
    fitted = estimate.fitted
    values, gains, structure = fitted.values, fitted.gains, fitted.structure
    n_theta, n_all = len(values.theta), len(values.theta) + len(gains)
    effects: dict[str, dict[str, float]] = {}
    names: list[str] = []
    slopes: list[np.ndarray] = []

    def add(effect: str, parameter: str, value: float, slope: dict[int, float] | None) -> None:
        effects.setdefault(effect, {})[parameter] = float(value)
        if slope is not None:
            row = np.zeros(n_all)
            for index, by in slope.items():
                row[index] = by
            names.append(f"{effect}.{parameter}")
            slopes.append(row)

    def share(i: int) -> tuple[float, dict[int, float]]:
        """Gain i over that of the body."""
        value = gains[i] / gains[0]
        return value, {n_theta + i: 1 / gains[0], n_theta: -value / gains[0]}

    add("rigid_body", "gain", gains[0], {n_theta: 1.0})
    if structure.n_body:
        add("viscous_friction", "rate", values.rate, {0: values.rate})
    if structure.n_body == 2:
        add("cable_spring", "stiffness", values.stiffness, {1: values.stiffness})
    at = structure.n_body
    order = np.argsort(values.modes[:, 0])
    for place, i in enumerate(order, 1):
        label = "flexible_mode" if place == 1 else f"flexible_mode#{place}"
        (w, z), (residue, slope) = values.modes[i], share(1 + i)
        f_hz = w / (2 * np.pi)
        add(label, "f_hz", f_hz, {at + 2 * i: f_hz})
        add(label, "zeta", z, {at + 2 * i + 1: z})
        add(label, "residue", residue, slope)
    if structure.residual:
        place, f_hz = structure.n_modes + 1, ABOVE * f_max_hz
        label = "flexible_mode" if place == 1 else f"flexible_mode#{place}"
        residue, slope = share(len(gains) - 1)
        w2 = (2 * np.pi * f_hz) ** 2
        add(label, "f_hz", f_hz, None)
        add(label, "zeta", ABOVE_ZETA, None)
        add(label, "residue", residue * w2, {index: by * w2 for index, by in slope.items()})
    at += 2 * structure.n_modes
    for j, effect in enumerate(LAGS[: structure.n_lags]):
        add(effect, "time_constant_s", values.lags[j], {at + j: values.lags[j]})
    if values.delay_s > 0:
        add("transport_delay", "delay_s", values.delay_s, {n_theta - 1: 1.0})
    turn = np.array(slopes)
    return Stack(effects, names, turn @ estimate.covariance @ turn.T, turn @ estimate.noise_only @ turn.T)


def as_rational(estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator in s, highest power first."""
    values, gains = estimate.fitted.values, estimate.fitted.gains
    structure, q = values.structure, INTEGRATIONS[values.structure.output]
    sprung = structure.body == "sprung"
    terms = [([1.0, 0.0] if sprung else [1.0], [1.0, values.rate, values.stiffness][: 3 if sprung else 2])]
    terms += [([1.0, 0.0], [1.0, 2 * z * w, w**2]) for w, z in values.modes]
    terms += [([1.0, 0.0], [1.0])] * structure.residual
    num, den = np.zeros(1), np.ones(1)
    for gain, (top, bottom) in zip(gains, terms, strict=True):
        num, den = np.polyadd(np.polymul(num, bottom), gain * np.polymul(top, den)), np.polymul(den, bottom)
    for tau in values.lags:
        den = np.polymul(den, [tau, 1.0])
    if q < 0:
        num = np.polymul(num, [1.0, 0.0])
    elif q > 0:
        num, den = _integrated(num, den)
    if structure.body == "free" and q < 0:
        num, den = _without_origin(num, den)
    return np.trim_zeros(num, "f"), den


def _integrated(num: np.ndarray, den: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Over s: a zero at the origin cancels."""
    if abs(num[-1]) <= 1e-12 * np.abs(num).max():
        return num[:-1], den
    return num, np.polymul(den, [1.0, 0.0])


def _without_origin(num: np.ndarray, den: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return num[:-1], den[:-1]
