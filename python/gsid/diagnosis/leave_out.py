"""Fits with one part of the data left out after the other, linearised at the fit to all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class LeftOut(NamedTuple):
    """What a fit explains where it was not fitted.

    Attributes
    ----------
    kept : float
        Cost of the parts, each predicted by the fit to the others, per number; 1 is noise.
    moves : list of (n,) ndarray
        Change of the error's coefficients that fits each part alone.
    variances : list of (n,) ndarray
        Of these.
    """

    kept: float
    moves: list[np.ndarray]
    variances: list[np.ndarray]


def leave_out(parts: Sequence[tuple[np.ndarray, np.ndarray]], *, rcond: float) -> LeftOut:
    """Leave out one part after the other.

    Parameters
    ----------
    parts : sequence of ((m, n) ndarray, (m,) ndarray)
        Jacobian, with columns of about unit length, and error of each part.
    rcond : float
        Directions whose singular value in a part is below this share of the largest have no variance.
    """
    grams = [rows.T @ rows for rows, _ in parts]
    slopes = [rows.T @ error for rows, error in parts]
    total, right = sum(grams), sum(slopes)
    squares, moves, variances = 0.0, [], []
    for (rows, error), gram, slope in zip(parts, grams, slopes, strict=True):
        moved = -_solve(total - gram, right - slope)
        squares += float(np.sum((error + rows @ moved) ** 2))
        moves.append(-_solve(gram, slope))
        variances.append(np.diag(np.linalg.pinv(gram, rcond=rcond)))
    return LeftOut(squares / sum(len(error) for _, error in parts), moves, variances)


def _solve(gram: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(gram, right, rcond=1e-12)[0]
