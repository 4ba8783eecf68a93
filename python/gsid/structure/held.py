"""Exact response of sampled poles behind a zero-order hold with delay (STR-2).

The command is held over each sample. A pole p answers with its images around every multiple of the sample
rate. For a strictly proper function with distinct poles the sum over all images has a closed form: with the
delay T = (d + f) / fs, 0 <= f < 1, z = exp(j w / fs) and h = 1/fs,

    1/(s - p)  ->  z^-d (b_old / z + b_new) / (z - exp(p h)),
    b_new = (exp(p (1 - f) h) - 1) / p,   b_old = exp(p (1 - f) h) (exp(p f h) - 1) / p.
"""

from __future__ import annotations

import numpy as np

APART = 1e-4
"""Least distance of two poles over their size, or over the lowest frequency: equal ones are moved apart.
The closed form needs distinct poles, and only its ratio to the sum's first term is used."""


def image_factors(
    shared: list[complex],
    own: list[list[complex]],
    n_zeros: list[int],
    delay_s: float,
    w: np.ndarray,
    sample_s: float,
) -> np.ndarray:
    """Sampled response of several functions over its first term, for H = s^n_zeros / prod(s - p).

    Parameters
    ----------
    shared : list of complex
        Poles of all functions [rad/s].
    own : list of lists of complex
        Further poles of each. Several may be equal, or 0.
    n_zeros : list of int
        Zeros of each at s = 0.
    delay_s, sample_s : float
    w : (F,) [rad/s]

    Returns
    -------
    (F, n) complex
        1 where H is not strictly proper: a step that passes through has no unique value at the sample.
    """
    p = _apart(np.array([*shared, *(pole for poles in own for pole in poles)], complex), float(w[0]))
    samples = delay_s / sample_s
    whole = np.floor(samples)
    late, early = (samples - whole) * sample_s, (1 - samples + whole) * sample_s
    b_new = _expm1_over(p, early)
    b_old = np.exp(p * early) * _expm1_over(p, late)
    s = 1j * w
    z = np.exp(s * sample_s)
    exact = (b_old / z[:, None] + b_new) / (z[:, None] - np.exp(p * sample_s))
    first = 1 / (s[:, None] - p)
    turn = z**-whole / (np.exp(-s * delay_s) * hold_response(w, sample_s))
    factors = np.ones((len(w), len(own)), complex)
    begin = len(shared)
    for i, (poles, zeros) in enumerate(zip(own, n_zeros, strict=True)):
        which = np.concatenate([np.arange(len(shared)), np.arange(begin, begin + len(poles))]).astype(int)
        begin += len(poles)
        if zeros < len(which):
            residue = _residues(p[which], zeros)
            factors[:, i] = turn * (exact[:, which] @ residue) / (first[:, which] @ residue)
    return factors


def _residues(p: np.ndarray, n_zeros: int) -> np.ndarray:
    """Of s^n_zeros / prod(s - p) at its distinct poles."""
    difference = p[:, None] - p
    np.fill_diagonal(difference, 1.0)
    return p**n_zeros / np.prod(difference, axis=1)


def hold_response(w: np.ndarray, sample_s: float) -> np.ndarray:
    """Zero-order hold: (1 - exp(-s h)) / (s h), (F,)."""
    return -np.expm1(-1j * w * sample_s) / (1j * w * sample_s)


def _expm1_over(p: np.ndarray, t: float) -> np.ndarray:
    """(exp(p t) - 1) / p, and its limit t at p = 0."""
    safe = np.where(np.abs(p) * t < 1e-9, 1.0, p)
    return np.where(np.abs(p) * t < 1e-9, t * (1 + p * t / 2), np.expm1(safe * t) / safe)


def _apart(poles: np.ndarray, w_lo: float) -> np.ndarray:
    """The poles, equal ones moved apart."""
    p = np.array(poles, complex)
    for i in range(1, len(p)):
        while np.min(np.abs(p[:i] - p[i])) < APART * max(abs(p[i]), w_lo):
            p[i] -= 1.5 * APART * max(abs(p[i]), w_lo)
    return p
