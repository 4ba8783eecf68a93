"""Neighbours of a structure: one element added or dropped."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsid.structure.elements import Lines, Values, columns, delay_and_lags
from gsid.structure.projection import Data, Fitted
from gsid.structure.settings import StructureSettings

LAG_STARTS = (0.15, 0.6, 2.5)
"""Over 1/w_hi: time constants that a further lag starts from."""


def moved(fitted: Fitted, data: Data, settings: StructureSettings) -> Iterator[Values]:
    """Values from which the neighbours of a fitted structure are refined.

    Parameters
    ----------
    fitted : Fitted
    data : Data
    settings : StructureSettings
    """
    numbers = fitted.values.numbers()
    w = data.lines.w
    modes, lags = numbers["modes"], numbers["lags"]
    yield from simpler(fitted, data)
    if not numbers["residual"]:
        yield Values.of(**{**numbers, "residual": True})
    if len(modes) < settings.modes_max:
        for mode in further_modes(fitted, data, settings):
            yield Values.of(**{**numbers, "modes": [*modes, mode]})
    if len(lags) < settings.lags_max:
        for start in LAG_STARTS:
            tau = start / w[-1]
            later = {"lags": [*lags, tau], "delay_s": max(numbers["delay_s"] - tau, 0.0)}
            yield Values.of(**{**numbers, **later})
    for body in _larger_bodies(numbers["body"], w):
        yield Values.of(**{**numbers, "body": body})


def simpler(fitted: Fitted, data: Data) -> Iterator[Values]:
    """Values with one element fewer.

    Parameters
    ----------
    fitted : Fitted
    data : Data
    """
    numbers = fitted.values.numbers()
    modes, lags, body = numbers["modes"], numbers["lags"], numbers["body"]
    if numbers["residual"]:
        yield Values.of(**{**numbers, "residual": False})
    for i in range(len(modes)):
        yield Values.of(**{**numbers, "modes": modes[:i] + modes[i + 1 :]})
    for i, tau in enumerate(lags):
        later = numbers["delay_s"] + min(tau, 1 / data.lines.w[-1])
        yield Values.of(**{**numbers, "lags": lags[:i] + lags[i + 1 :], "delay_s": later})
    for n in range(len(body)):
        yield Values.of(**{**numbers, "body": body[:n]})


def _larger_bodies(body: tuple[float, ...], w: np.ndarray) -> Iterator[tuple[float, ...]]:
    if len(body) == 0:
        yield (0.3 * w[0],)
        yield (w[0], w[0] ** 2)
    elif len(body) == 1:
        yield body[0], (0.7 * w[0]) ** 2
        yield body[0], (3 * w[0]) ** 2


def further_modes(fitted: Fitted, data: Data, settings: StructureSettings) -> list[tuple[float, float]]:
    """The two modes of a grid that lower the cost most, with all gains free.

    Parameters
    ----------
    fitted : Fitted
    data : Data
    settings : StructureSettings

    Returns
    -------
    list of (w, z)
        rad/s and damping ratio.
    """
    lines, weight = data.lines, data.weight
    lo, hi = settings.near_lo * lines.w[0], settings.near_hi * lines.w[-1]
    common = delay_and_lags(fitted.values, lines) * weight
    present = _stacked(columns(fitted.values, lines) * weight[:, None])
    q, _ = np.linalg.qr(present / np.maximum(np.linalg.norm(present, axis=0), 1e-300))
    rest = _stacked(fitted.error(data))
    rest = rest - q @ (q.T @ rest)
    found = []
    for z in settings.scan_zeta:
        n = min(int(np.log(hi / lo) / z) + 1, settings.n_scan)
        w_grid = np.geomspace(lo, hi, n)
        gain = _gain_of_modes(w_grid, z, lines, common, q, rest)
        found += [(gain[i], w_grid[i], z) for i in _peaks(gain)]
    best = sorted(found, reverse=True)[:4]
    chosen: list[tuple[float, float]] = []
    for _, w, z in best:
        if all(abs(w / other - 1) > 0.05 for other, _ in chosen):
            chosen.append((float(w), float(z)))
    return chosen[:2]


def _gain_of_modes(
    w_grid: np.ndarray, z: float, lines: Lines, common: np.ndarray, q: np.ndarray, rest: np.ndarray
) -> np.ndarray:
    """Decrease of the cost by each mode of a grid."""
    s = lines.s[:, None]
    mode = common[:, None] * s / (s**2 + 2 * z * w_grid * s + w_grid**2)
    mode = _stacked(mode)
    mode /= np.linalg.norm(mode, axis=0)
    free = mode - q @ (q.T @ mode)
    length = np.einsum("kn,kn->n", free, free)
    return np.where(length > 1e-6, (rest @ mode) ** 2 / np.maximum(length, 1e-6), 0.0)


def _peaks(gain: np.ndarray) -> np.ndarray:
    """The two largest local maxima."""
    padded = np.concatenate([[-np.inf], gain, [-np.inf]])
    top = np.flatnonzero((gain >= padded[:-2]) & (gain > padded[2:]))
    return top[np.argsort(gain[top])[::-1][:2]]


def _stacked(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x.real, x.imag])
