"""Conversions of rational models: poles and zeros, state space, sampling with a hold, .mat files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import io, linalg, signal

from gsid.base.files import write_atomically
from gsid.models.rational import RationalModel

if TYPE_CHECKING:
    from numpy import ndarray

WHOLE = 1e-9  # samples: delays that differ less from a whole number of samples are rounded to it


def to_zpk(model: RationalModel) -> tuple[ndarray, ndarray, float]:
    """Zeros, poles and gain, without the delay.

    Parameters
    ----------
    model : RationalModel

    Returns
    -------
    zeros, poles : (m,), (n,) complex ndarrays
        rad/s in domain "s", z in domain "z". Domain "z": those of z^max(n, m) num and den.
    gain : float
        Of the product of (s - zero) over that of (s - pole), or of z.
    """
    num, den = _descending(model)
    leading = np.trim_zeros(num, "f")
    return np.roots(leading), np.roots(den), float(leading[0] / den[0]) if len(leading) else 0.0


def from_zpk(
    zeros: ndarray, poles: ndarray, gain: float, delay_s: float = 0.0, *, fs_hz: float | None = None
) -> RationalModel:
    """Make a model from zeros, poles and gain.

    Parameters
    ----------
    zeros, poles : (m,), (n,) array_like
        rad/s, or z with `fs_hz`; complex ones in conjugate pairs.
    gain : float
    delay_s : float
        s.
    fs_hz : float, optional
        Sampling frequency [Hz] of a model in z. Such a model may not have more zeros than poles.

    Returns
    -------
    RationalModel

    Raises
    ------
    ValueError
        Complex roots lack their conjugates, or a model in z has more zeros than poles.
    """
    num, den = gain * np.atleast_1d(np.poly(zeros)), np.atleast_1d(np.poly(poles))
    if np.iscomplexobj(num) or np.iscomplexobj(den):
        raise ValueError("complex zeros and poles must come in conjugate pairs")
    if fs_hz is None:
        return RationalModel(num, den, delay_s)
    if len(num) > len(den):
        raise ValueError(f"in z give at most as many zeros as poles, got {len(num) - 1} and {len(den) - 1}")
    return RationalModel(np.concatenate([np.zeros(len(den) - len(num)), num]), den, delay_s, "z", fs_hz)


def to_state_space(model: RationalModel) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    """Matrices A, B, C, D in the controllable form, without the delay.

    Parameters
    ----------
    model : RationalModel

    Returns
    -------
    A : (n, n), B : (n, 1), C : (1, n), D : (1, 1) ndarrays
        Of dx/dt = A x + B u in domain "s", of x[k + 1] = A x[k] + B u[k] in domain "z"; y = C x + D u.

    Raises
    ------
    ValueError
        More zeros than poles in domain "s".
    """
    num, den = _descending(model)
    num = np.trim_zeros(num, "f")
    if len(num) > len(den):
        raise ValueError(f"a state space needs no more zeros than poles, got {model.n_poles}/{model.n_zeros}")
    return signal.tf2ss(num if len(num) else [0.0], den)


def sampled(model: RationalModel, fs_hz: float) -> RationalModel:
    """Convert a continuous model with held input to z. The result is exact for any delay (MOD-2).

    Parameters
    ----------
    model : RationalModel
        Model in domain "s" with at most as many zeros as poles and a delay of 0 or more.
    fs_hz : float
        Sampling frequency [Hz].

    Returns
    -------
    RationalModel
        Model in domain "z" with n poles and up to n + 1 zeros. Its delay is the integer part of the delay
        in samples. A direct term is delayed by one sample: y is sampled just before the new u is applied.

    Raises
    ------
    ValueError
        The model is in z, has more zeros than poles, or has a negative delay.
    """
    if model.domain != "s" or model.delay_s < 0 or not fs_hz > 0:
        raise ValueError(
            "only a continuous model with a delay of 0 or more can be sampled, at a rate above 0"
        )
    a, b, c, d = to_state_space(model)
    n = len(a)
    whole, part = split_delay(model.delay_s * fs_hz)
    step, early, late = held_step(a, b[:, 0], part, 1 / fs_hz)
    den = np.atleast_1d(np.poly(step))
    num = np.zeros(n + 2)
    if n:
        num[: n + 1] += signal.ss2tf(step, late[:, None], c, np.zeros((1, 1)))[0][0]
        num[1:] += signal.ss2tf(step, early[:, None], c, np.zeros((1, 1)))[0][0]
    num[1:] += d[0, 0] * den
    num = num[: max(np.flatnonzero(num), default=0) + 1]
    return RationalModel(num, den, whole / fs_hz, "z", fs_hz, u_unit=model.u_unit, y_unit=model.y_unit)


def save_mat(model: RationalModel, path: str | Path) -> None:
    """Write a MATLAB file (version 5): num, den, delay_s, zeros, poles, gain, A, B, C, D and the covariance.

    Parameters
    ----------
    model : RationalModel
        In domain "z", num and den are polynomials in z^-1; the matrices are those of z.
    path : path-like
        File to write. An existing file is replaced atomically.
    """
    write_atomically(path, lambda part: io.savemat(part, mat_values(model), appendmat=False))


def mat_values(model: RationalModel) -> dict[str, object]:
    """Return the variables that `save_mat` writes, by name."""
    zeros, poles, gain = to_zpk(model)
    values = {"num": model.num, "den": model.den, "delay_s": model.delay_s, "domain": model.domain}
    values |= {"hold": model.hold, "hold_assumed": model.hold_assumed}
    values |= {"fs_hz": np.nan if model.fs_hz is None else model.fs_hz}
    values |= {"zeros": zeros, "poles": poles, "gain": gain, "u_unit": model.u_unit, "y_unit": model.y_unit}
    if len(zeros) <= len(poles):
        values |= dict(zip("ABCD", to_state_space(model), strict=True))
    if model.cov is not None:
        values["covariance"] = model.cov
    return values


def _descending(model: RationalModel) -> tuple[ndarray, ndarray]:
    """num and den in descending powers of s or z."""
    if model.domain == "s":
        return model.num, model.den
    degree = max(model.n_poles, model.n_zeros)
    return tuple(np.concatenate([x, np.zeros(degree + 1 - len(x))]) for x in (model.num, model.den))


def split_delay(samples: float) -> tuple[int, float]:
    """Integer part of a delay [samples], and the rest, 0 <= rest < 1."""
    whole = int(np.floor(samples + WHOLE))
    rest = samples - whole
    return whole, rest if rest >= WHOLE else 0.0


def held_step(a: ndarray, b: ndarray, part: float, sample_s: float) -> tuple[ndarray, ndarray, ndarray]:
    """Discretise dx/dt = A x + B u for an input that is held over each sample (MOD-2).

    The matrix exponential is that of scipy, for any number of states.

    Parameters
    ----------
    a : (n, n) ndarray
    b : (n,) ndarray
    part : float
        Share of a sample by which the input is delayed, 0 <= part < 1.
    sample_s : float
        Sample time [s].

    Returns
    -------
    state : (n, n) ndarray
        Phi of x[k + 1] = Phi x[k] + early u[k - 1] + late u[k].
    early, late : (n,) ndarray
        Effects of the previous and of the present input.
    """
    n = len(a)

    def over(samples: float) -> tuple[ndarray, ndarray]:
        with_input = np.zeros((n + 1, n + 1))  # the held input is a state too
        with_input[:n, :n], with_input[:n, n] = a, b
        moved = linalg.expm(with_input * samples * sample_s)
        return moved[:n, :n], moved[:n, n]

    (_, early), (rest, late) = over(part), over(1 - part)
    return over(1.0)[0], rest @ early, late
