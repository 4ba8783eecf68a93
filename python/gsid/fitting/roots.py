"""Roots of a fitted model that the data do not show: cancelling pairs, roots far outside, unresolved damping.

Notes report them, and `select_order` avoids them where distortion makes them significant (EST-16).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from gsid.models.confidence import LEVEL, NORMAL_95

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel

NEAR = 0.5
"""Largest distance of a pole and a zero of a cancelling pair, over the magnitude of the pole."""
WIDTHS = 2.0
"""Largest distance of a small pair [half widths of the resonance]."""
STANDING_OUT, STANDING_OUT_REAL = 0.2, 0.05
"""Least share of a pole pair, and of a real pole, in the sum of magnitudes of the others at its frequency:
friction puts small modes at antiresonances."""
FAR = 30.0
"""A root above this multiple of the band is a delay: at the band's edge its phase is within 2 degrees."""
RESOLVED_LINES = 0.1
"""Least half width of a resonance [line spacings]: narrower ones stand between two lines."""
LEAST_DELAY = -0.55
"""Least delay [samples]: half a sample of an unknown hold, and its uncertainty."""


@dataclass(frozen=True)
class Doubtful:
    """A root, or the delay, that the data do not show.

    Attributes
    ----------
    kind : {"pair", "pole", "zero", "delay"}
    f_hz : float
        Magnitude of the root [Hz]; for a delay, its value [s].
    why : {"indistinct", "cancels", "undetermined", "far", "unresolved", "negative"}
    """

    kind: str
    f_hz: float
    why: str

    @property
    def text(self) -> str:
        """The doubt as a clause."""
        if self.kind == "pair":
            return f"its pole and zero near {self.f_hz:.4g} Hz nearly cancel"
        if self.kind == "delay":
            return f"its delay of {1e3 * self.f_hz:.4g} ms is negative"
        if self.why == "unresolved":
            return f"its resonance at {self.f_hz:.4g} Hz is narrower than the lines resolve"
        return f"its {self.kind} at {self.f_hz:.4g} Hz is far above the band or may be anywhere there"


def doubtful(model: RationalModel, f_hz: np.ndarray, *, small_pairs: bool) -> list[Doubtful]:
    """Roots of a model that the data do not show, and a delay that is too negative.  Eq: EST-16

    Parameters
    ----------
    model : RationalModel
        With covariance and band.
    f_hz : (F,) ndarray
        Fitted lines [Hz].
    small_pairs : bool
        Whether a small pair is doubtful though it is significant: it is where the errors exceed the noise.

    Returns
    -------
    list of Doubtful
    """
    out = [Doubtful("pair", _hz(model, pole), "indistinct") for pole, _ in near_cancelled(model)]
    out += [Doubtful(kind, f, "undetermined") for kind, f in far_out(model)]
    if model.domain == "s" and model.band_hz is not None:
        out += [each for each in _far(model) if not _is_in(each, out, "pole", "zero")]
        out += [each for each in _unresolved(model, f_hz) if not _is_in(each, out, "pair")]
    if model.domain == "s" and small_pairs:
        pairs = [Doubtful("pair", _hz(model, pole), "cancels") for pole in _not_standing_out(model)]
        out += [each for each in pairs if not _is_in(each, out, "pair")]
    if model.free_delay and model.fs_hz and model.delay_s < LEAST_DELAY / model.fs_hz:
        out.append(Doubtful("delay", model.delay_s, "negative"))
    return out


def _is_in(one: Doubtful, several: list[Doubtful], *kinds: str) -> bool:
    return any(each.kind in kinds and np.isclose(each.f_hz, one.f_hz) for each in several)


def _hz(model: RationalModel, root: complex) -> float:
    return abs(np.log(root) * model.fs_hz if model.domain == "z" else root) / (2 * np.pi)


def _far(model: RationalModel) -> Iterator[Doubtful]:
    for kind, roots in (("pole", model.poles), ("zero", model.zeros)):
        for root in roots:
            if root.imag >= 0 and abs(root) > FAR * 2 * np.pi * model.band_hz[1]:
                yield Doubtful(kind, _hz(model, root), "far")


def _unresolved(model: RationalModel, f_hz: np.ndarray) -> Iterator[Doubtful]:
    for pole in model.poles:
        f = abs(pole) / (2 * np.pi)
        if pole.imag <= 0 or not f_hz[0] <= f <= f_hz[-1]:
            continue
        above = int(np.clip(np.searchsorted(f_hz, f), 1, len(f_hz) - 1))
        if abs(pole.real) / (2 * np.pi) <= RESOLVED_LINES * (f_hz[above] - f_hz[above - 1]):
            yield Doubtful("pole", float(f), "unresolved")


def _not_standing_out(model: RationalModel) -> Iterator[complex]:
    """Poles with a zero beside them whose part of the response is small beside the other parts."""
    poles, zeros = model.poles, model.zeros
    slope = np.polyval(np.polyder(model.den), poles)
    if len(poles) == 0 or len(zeros) == 0 or np.any(slope == 0):
        return
    residues = np.polyval(model.num, poles) / slope
    for k, pole in enumerate(poles):
        if pole.imag < 0 or np.min(np.abs(zeros - pole)) > min(NEAR * abs(pole), WIDTHS * abs(pole.real)):
            continue
        s = 1j * abs(pole)
        if np.any(s == poles):
            continue
        parts = residues / (s - poles)
        mine = (poles == pole) | ((poles == np.conj(pole)) if pole.imag > 0 else np.zeros(len(poles), bool))
        whole = np.polyval(model.num, s) / np.polyval(model.den, s)
        direct = abs(whole - parts.sum())  # of a model with as many zeros as poles, or more
        others = np.sum(np.abs(_by_root(poles, parts, ~mine))) + direct
        least = STANDING_OUT if pole.imag > 0 else STANDING_OUT_REAL
        if abs(parts[mine].sum()) < least * others:
            yield complex(poles[k])


def _by_root(poles: np.ndarray, parts: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Parts of the response, conjugate pairs together."""
    found = []
    for k in np.flatnonzero(use & (poles.imag >= 0)):
        pair = poles[k].imag > 0
        twin = np.flatnonzero(use & (poles == np.conj(poles[k]))) if pair else []
        found.append(parts[k] + (parts[twin[0]] if len(twin) else 0))
    return np.array(found)


def near_cancelled(model: RationalModel) -> list[tuple[complex, complex]]:
    """Pole-zero pairs that the data cannot distinguish.

    Parameters
    ----------
    model : RationalModel
        With covariance.

    Returns
    -------
    list of (pole, zero)
        In rad/s, or in z; one of each conjugate pair. Zero lies in the 95 % region of their difference.
    """
    if model.cov is None:
        return []
    pairs = []
    zeros = [z for z in model.zeros if z.imag >= 0]
    poles = [p for p in model.poles if p.imag >= 0]

    def distance(pole: complex) -> float:
        return min((abs(z - pole) for z in zeros), default=np.inf) / max(abs(pole), np.finfo(float).tiny)

    for pole in sorted(poles, key=distance):  # a pole must not take the zero of a nearer one
        near = [z for z in zeros if abs(z - pole) < NEAR * abs(pole) and (z.imag > 0) == (pole.imag > 0)]
        if not near:
            continue
        zero = min(near, key=lambda z: abs(z - pole))
        by = _root_slope(model, pole, True) - _root_slope(model, zero, False)
        parts, d = np.array([by.real, by.imag]), np.array([(pole - zero).real, (pole - zero).imag])
        size = 2 if pole.imag > 0 else 1
        cov = (parts @ model.cov @ parts.T)[:size, :size]
        if d[:size] @ np.linalg.pinv(cov) @ d[:size] < special.chdtri(size, 1 - LEVEL):
            pairs.append((complex(pole), complex(zero)))
            zeros.remove(zero)
    return sorted(pairs, key=lambda pair: poles.index(pair[0]))


def far_out(model: RationalModel) -> list[tuple[str, float]]:
    """Real roots above the band whose position the data do not determine.

    Parameters
    ----------
    model : RationalModel
        Model in s with covariance and band.

    Returns
    -------
    list of ("pole" or "zero", Hz)
        The 95 % interval of such a root includes 0: without it, a model with free delay fits equally well.
    """
    if model.cov is None or model.band_hz is None or model.domain != "s":
        return []
    roots = [("pole", *root) for root in zip(model.poles, model.pole_cov, strict=True)]
    roots += [("zero", *root) for root in zip(model.zeros, model.zero_cov, strict=True)]
    return [
        (kind, abs(root) / (2 * np.pi))
        for kind, root, cov in roots
        if root.imag == 0
        and NORMAL_95 * np.sqrt(max(np.trace(cov), 0.0)) > abs(root) > 2 * np.pi * model.band_hz[1]
    ]


def _root_slope(model: RationalModel, root: complex, is_pole: bool) -> np.ndarray:
    """Derivative of a root with respect to (den[1:], num, delay if free)."""
    coef = model.den if is_pole else model.num
    powers = np.arange(len(coef) - 1, -1, -1)
    by = -(root**powers) / np.polyval(np.polyder(coef), root)
    out = np.zeros(model.n_parameters, complex)
    if is_pole:
        out[: model.n_poles] = by[1:]
    else:
        out[model.n_poles : model.n_poles + len(model.num)] = by
    return out
