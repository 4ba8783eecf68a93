"""Pointwise 95 % confidence bounds of measured and modelled values, for figures and tables.

* A measured complex number with error e, E|e|^2 = sigma^2, circular and normal: |e|^2 / sigma^2 is
  exponential with mean 1, so that P(|e| > c sigma) = exp(-c^2) and the 95 % bound is sigma sqrt(-ln 0.05) =
  1.73 sigma. Real and imaginary part have the variance sigma^2 / 2 each.
* With sigma^2 itself estimated from m degrees of freedom (m = periods - realisations), |e|^2 / s^2 follows
  F(2, 2m), whose tail is (1 + x/m)^-m: the bound becomes s sqrt(m (0.05^(-1/m) - 1)), larger for few periods
  and the same in the limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import special

if TYPE_CHECKING:
    from gsid.models.rational import RationalModel

LEVEL = 0.95
NORMAL_95 = 1.959964  # two-sided 95 % of a real normal variable


def complex_bound(sigma, *, n_dof: float | np.ndarray | None = None, level: float = LEVEL):
    """Bound of the error of a complex number for a given probability.

    Parameters
    ----------
    sigma : (F,) array_like, standard deviation of the complex number: sigma^2 = E|e|^2
    n_dof : float or (F,) array_like, optional
        Degrees of freedom of sigma^2 if it is a sample variance (periods - realisations); None if sigma is
        known exactly.
    level : float, probability, 0 .. 1

    Returns
    -------
    (F,) ndarray, in the unit of sigma

    Raises
    ------
    ValueError
        n_dof is less than 1.

    Notes
    -----
    Derived at the top of this module.
    """
    tail = 1.0 - level
    if n_dof is None:
        return np.asarray(sigma) * np.sqrt(-np.log(tail))
    if np.any(np.less(n_dof, 1)):
        raise ValueError(f"a bound needs n_dof of 1 or more (n_dof: {n_dof})")
    return np.asarray(sigma) * np.sqrt(n_dof * np.expm1(-np.log(tail) / n_dof))


def gain_phase_band(g, sigma):
    """95 % half-widths of gain and phase of a complex number with a circular error.

    Parameters
    ----------
    g : (F,) complex
    sigma : (F,) standard deviation of g, E|e|^2 = sigma^2

    Returns
    -------
    low_db, high_db, phase_deg : (F,) ndarrays
        Gain between low and high [dB]; phase within +- phase_deg.

    Notes
    -----
    The error component in the direction of g changes the gain; the perpendicular component changes the phase.
    Each has the standard deviation sigma / sqrt(2). If the error is as large as g, the gain has no lower
    bound and the phase is unknown (+-180 degrees).
    """
    gain = np.maximum(np.abs(g), np.finfo(float).tiny)
    relative = NORMAL_95 * np.asarray(sigma) / (np.sqrt(2.0) * gain)
    low = 20.0 * np.log10(gain * np.maximum(1.0 - relative, 1e-3))
    phase = np.where(relative < 1.0, np.degrees(np.arcsin(np.minimum(relative, 1.0))), 180.0)
    return low, 20.0 * np.log10(gain * (1.0 + relative)), phase


def gain_phase_std(model: RationalModel, f_hz) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations of the gain and phase of a model, from the covariance of its parameters.

    Parameters
    ----------
    model : RationalModel, with covariance
    f_hz : (F,) [Hz]

    Returns
    -------
    gain, phase : (F,) ndarrays
        Of ln|G| (relative, 1) and of the phase [rad].

    Notes
    -----
    First order: d ln G = dG / G. Its real part changes the gain, its imaginary part the phase. The error of a
    model is not circular (a free gain does not change the phase), so that E|dG|^2 alone is not sufficient. A
    hold multiplies G and dG equally and cancels.
    """
    gradient = model.gradient(f_hz)
    g = gradient[:, len(model.den) - 1 :][:, : len(model.num)] @ model.num  # G is linear in its numerator
    relative = gradient / g[:, None]
    gain, phase = (
        np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", part, model.cov, part), 0.0))
        for part in (relative.real, relative.imag)
    )
    return gain, phase


def confidence_ellipse(root: complex, cov, n_points: int = 97) -> np.ndarray:
    """Outline of the 95 % confidence region of a pole or zero.

    Parameters
    ----------
    root : complex
    cov : (2, 2) covariance of (real, imaginary) part

    Returns
    -------
    (n_points,) complex ndarray

    Notes
    -----
    Two jointly normal parts: the region is d' cov^-1 d <= -2 ln 0.05 = 5.99 (chi-square, two degrees of
    freedom). A real root moves along the real axis only, and its region is the interval +- 1.96 sigma.
    """
    values, vectors = np.linalg.eigh(np.asarray(cov, dtype=float))
    values = np.maximum(values, 0.0)
    is_line = values[0] <= 1e-12 * values[1]
    radius = NORMAL_95 if is_line else np.sqrt(-2.0 * np.log(1.0 - LEVEL))
    turn = np.linspace(0.0, 2.0 * np.pi, n_points)
    offset = vectors @ (radius * np.sqrt(values)[:, None] * np.vstack([np.cos(turn), np.sin(turn)]))
    return root + offset[0] + 1j * offset[1]


def unwrapped_phase_deg(f_hz, g, sigma=None) -> np.ndarray:
    """Phase without jumps, anchored at the lowest frequency.

    Parameters
    ----------
    f_hz : (F,) ascending [Hz]
    g : (F,) complex
    sigma : (F,), optional
        Standard deviation of g. If given, noisy lines follow their neighbours and cannot shift the other
        lines by 360 degrees.

    Returns
    -------
    (F,) ndarray [deg], the first reliable line in (-225, 135], so that a double integrator starts at -180.

    Notes
    -----
    A delay changes the phase by more than 180 degrees between distant lines. The delay that gives the
    smallest phase steps between neighbours is removed before unwrapping and added again afterwards.
    """
    f_hz, g = np.asarray(f_hz, dtype=float), np.asarray(g, dtype=complex)
    if len(g) < 2:
        return np.degrees(np.angle(g))
    good = np.abs(g) > 0.0 if sigma is None else np.abs(g) > 3.0 * np.asarray(sigma)
    if good.sum() < 2:
        good = np.ones(len(g), dtype=bool)
    f_good, g_good = f_hz[good], g[good]
    slope = -2.0 * np.pi * _smoothing_delay(f_good, g_good)  # rad per Hz
    phase = np.unwrap(np.angle(g_good * np.exp(-1j * slope * f_good))) + slope * f_good
    phase -= 2.0 * np.pi * np.ceil((phase[0] - 0.75 * np.pi) / (2.0 * np.pi))
    smooth = np.interp(f_hz, f_good, phase)
    nearest = smooth + np.angle(g * np.exp(-1j * smooth))
    return np.degrees(np.where(good, np.interp(f_hz, f_good, phase), nearest))


def _smoothing_delay(f_hz, g) -> float:
    """Delay [s] whose removal gives the smallest phase steps between neighbouring lines.

    The search covers one turn between the closest lines, mostly at positive delays, because plants are
    causal.
    """
    step = np.diff(f_hz)
    turn = np.angle(g[1:] * np.conj(g[:-1]))
    n_delays = min(int(16.0 * step.max() / step.min()), 4096)
    delay = np.linspace(-0.2, 0.8, n_delays) / step.min()
    smoothness = np.cos(turn + 2.0 * np.pi * delay[:, None] * step).sum(axis=1)
    return float(delay[np.argmax(smoothness)])


def excess_bands(f_hz, exceeds, *, window: int = 9, false_alarm: float = 0.01) -> list[tuple[float, float]]:
    """Bands in which more lines exceed their 95 % bound than chance explains.

    Parameters
    ----------
    f_hz : (F,) ascending [Hz]
    exceeds : (F,) bool
    window : int, number of neighbouring lines in one test
    false_alarm : float, probability of at least one band if there is only noise (Bonferroni over the windows)

    Returns
    -------
    list of (low, high) [Hz], from the first to the last line above its bound
    """
    exceeds = np.asarray(exceeds, dtype=bool)
    window = min(window, len(exceeds))
    if window == 0:
        return []
    count = np.convolve(exceeds, np.ones(window, dtype=int), "valid")
    flagged = np.zeros(len(exceeds), dtype=bool)
    for start in np.flatnonzero(special.bdtrc(count - 1, window, 1.0 - LEVEL) < false_alarm / len(count)):
        hit = start + np.flatnonzero(exceeds[start : start + window])
        flagged[hit[0] : hit[-1] + 1] = True
    bands: list[list[int]] = []
    for k in np.flatnonzero(flagged):
        if bands and k - bands[-1][1] <= window:  # closer than the resolution of the test: one band
            bands[-1][1] = k
        else:
            bands.append([k, k])
    return [(float(f_hz[a]), float(f_hz[b])) for a, b in bands]


def root_quantities(root: complex, cov, *, domain: str = "s", fs_hz: float | None = None):
    """Natural frequency and damping of a pole or zero, with standard deviations.

    Parameters
    ----------
    root : complex [rad/s], or z in domain "z"
    cov : (2, 2) covariance of (real, imaginary) part
    domain : "s" or "z"
    fs_hz : float, needed in domain "z" [Hz]

    Returns
    -------
    f_hz, damping, std_f_hz, std_damping : float
        Damping is 1 for a real root in the left half-plane, -1 in the right one. NaN where z = 0.

    Notes
    -----
    First order: with s = r exp(j phi), d|s| is the part of ds along s and |s| dphi the part across it;
    damping = -cos phi. A z is mapped by s = fs ln z, whose derivative fs/z turns and scales the covariance.
    """
    cov = np.asarray(cov, dtype=float)
    if domain == "z":
        if root == 0:
            return np.nan, np.nan, np.nan, np.nan
        slope = fs_hz / root
        turn = np.array([[slope.real, -slope.imag], [slope.imag, slope.real]])
        cov, root = turn @ cov @ turn.T, fs_hz * np.log(complex(root))
    radius = abs(root)
    if radius == 0.0:
        return 0.0, np.nan, float(np.sqrt(max(cov[0, 0], 0.0))) / (2.0 * np.pi), np.nan
    along = np.array([root.real, root.imag]) / radius
    across = np.array([-along[1], along[0]])
    std_f = np.sqrt(max(along @ cov @ along, 0.0)) / (2.0 * np.pi)
    std_phi = np.sqrt(max(across @ cov @ across, 0.0)) / radius
    return radius / (2.0 * np.pi), -along[0], float(std_f), float(abs(along[1]) * std_phi)
