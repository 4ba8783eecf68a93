"""Score tests of candidate directions against a residual, with nuisance projection.

r is the whitened residual of a fitted model; it is N(0, I) if the model is right. S are the whitened
sensitivities of the free parameters, D those of a candidate at its null value. Dp = D - Q Q'D is the part of
D orthogonal to S, with Q an orthonormal basis of S. LM = |projection of r on Dp|^2 is the predicted drop of
the cost (-2 log likelihood). Under the null hypothesis it is chi-square with as many degrees of freedom as
Dp has columns (DIA-1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Columns of which a smaller share remains after the projection are treated as dependent on the nuisances.
SURVIVAL_LEAST = 1e-3
ROUNDING = 1e-6  # the same for one of several columns


@dataclass(eq=False)
class Score:
    """Score of a candidate direction.

    Parameters
    ----------
    drop : float
        LM: predicted drop of the cost.
    size : (q,) ndarray
        Coefficients of the candidate's columns.
    survival : float
        Length of the columns after the projection over their length before.
    basis : (n, q') ndarray
        Orthonormal basis of the candidate's part orthogonal to the nuisances; empty if that part vanishes.
    """

    drop: float
    size: np.ndarray
    survival: float
    basis: np.ndarray


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the span of columns. They are scaled to unit length; dependent ones are dropped.

    Parameters
    ----------
    columns : (n, p) ndarray

    Returns
    -------
    (n, <= p) ndarray
    """
    length = np.linalg.norm(columns, axis=0)
    scaled = columns[:, length > 0] / length[length > 0]
    if scaled.shape[1] == 0:
        return np.empty((len(columns), 0))
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, s > 1e-9 * s[0]]


def project_out(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Part of the columns orthogonal to an orthonormal basis; projected twice to remove rounding errors."""
    once = columns - basis @ (basis.T @ columns)
    return once - basis @ (basis.T @ once)


def score(
    residual: np.ndarray, nuisance: np.ndarray, columns: np.ndarray, *, one_sided: bool = False
) -> Score:
    """Score one candidate.

    Parameters
    ----------
    residual : (n,) ndarray
        Whitened.
    nuisance : (n, p) ndarray
        Orthonormal basis of the free parameters' sensitivities.
    columns : (n, q) ndarray
        Whitened sensitivities of the candidate.
    one_sided : bool
        Only coefficients >= 0 are physical; columns with a negative coefficient are left out.

    Returns
    -------
    Score
    """
    size = np.zeros(columns.shape[1])
    kept = np.arange(columns.shape[1])
    before = np.linalg.norm(columns, axis=0)
    projected = project_out(nuisance, columns)
    survival = float(np.linalg.norm(projected) / np.linalg.norm(before)) if np.any(before > 0) else 0.0
    if survival < SURVIVAL_LEAST:
        return Score(0.0, size, survival, np.empty((len(residual), 0)))
    while len(kept):
        length = np.linalg.norm(projected[:, kept], axis=0)
        own = length > ROUNDING * before[kept]
        kept, length = kept[own], length[own]
        u, s, vt = np.linalg.svd(projected[:, kept] / length, full_matrices=False)
        good = s > 1e-6 * s[0]
        coefficient = (vt.T[:, good] / s[good]) @ (u.T[good] @ residual) / length
        if not one_sided or np.all(coefficient >= 0):
            size[kept] = coefficient
            basis = u[:, good]
            return Score(float(np.sum((basis.T @ residual) ** 2)), size, survival, basis)
        kept = np.delete(kept, np.argmin(coefficient * length))
    return Score(0.0, size, survival, np.empty((len(residual), 0)))


def columns_by_record(columns: np.ndarray, n_lines: list[int]) -> np.ndarray:
    """Split the sensitivities so that every record has parameters of its own.

    Parameters
    ----------
    columns : (2 m, q) ndarray
        Real parts of all records first, then imaginary parts.
    n_lines : list of int
        Lines of each record; m is their sum.

    Returns
    -------
    (2 m, q times the number of records) ndarray
    """
    owner = np.tile(np.repeat(np.arange(len(n_lines)), n_lines), 2)
    return np.hstack([np.where((owner == i)[:, None], columns, 0.0) for i in range(len(n_lines))])


def family_wise_p(residual: np.ndarray, drawn: np.ndarray, scores: list[Score]) -> np.ndarray:
    """Probability that chance alone gives the best of all candidates a score this high (DIA-2).

    For each residual drawn under a correct model the largest score over all candidates and grid points is
    taken. This accounts for the number of candidates and for their correlations. One-sided candidates whose
    coefficient would be negative are left out, about half of them, and the remaining ones are treated as
    two-sided, which compensates for it. `make blind` measures the resulting false-alarm rate.

    Parameters
    ----------
    residual : (n,) ndarray
        Whitened; only its length is used.
    drawn : (n, draws) ndarray
        Residuals drawn under a correct model; see `random_phases` and `random_periods`.
    scores : list of Score

    Returns
    -------
    (len(scores),) ndarray
    """
    bases = [item.basis for item in scores if item.basis.shape[1]]
    if not bases:
        return np.ones(len(scores))
    along = np.hstack(bases).T @ drawn
    first = np.cumsum([0] + [basis.shape[1] for basis in bases[:-1]])
    largest = np.max(np.add.reduceat(along**2, first, axis=0), axis=0)
    drops = np.array([item.drop for item in scores])
    return (1 + np.sum(largest[None, :] >= drops[:, None], axis=1)) / (drawn.shape[1] + 1)


def random_phases(residual: np.ndarray, draws: int, seed: int) -> np.ndarray:
    """Draw residuals of noise that is independent from line to line: amplitudes kept, phases random.

    Parameters
    ----------
    residual : (2 m,) ndarray
        Real parts first, then imaginary parts.
    draws, seed : int

    Returns
    -------
    (2 m, draws) ndarray
    """
    m = len(residual) // 2
    turned = (residual[:m] + 1j * residual[m:])[:, None]
    turned = turned * np.exp(2j * np.pi * np.random.default_rng(seed).random((m, draws)))
    return np.vstack([turned.real, turned.imag])


def random_periods(deviations: list[np.ndarray], draws: int, seed: int) -> np.ndarray:
    """Draw residuals from the scatter of the periods, with its correlation between lines.

    A fluctuating gain or clock jitter changes all lines of a period together. The mean error is then a smooth
    function of frequency, which would look like an effect if phases were drawn independently.

    Parameters
    ----------
    deviations : list of (P, m_r) complex ndarrays
        For each record, the lines of each period less their mean, whitened like the residual of the mean.
    draws, seed : int

    Returns
    -------
    (2 m, draws) ndarray, m the sum of m_r; real parts first, then imaginary parts
    """
    rng = np.random.default_rng(seed)
    parts = []
    for one in deviations:
        p = len(one)
        # Real weights: a fluctuation moves real and imaginary parts together; complex weights would halve it.
        parts.append((rng.standard_normal((draws, p)) @ one).T / np.sqrt(p * (p - 1)))
    together = np.vstack(parts)
    return np.vstack([together.real, together.imag])
