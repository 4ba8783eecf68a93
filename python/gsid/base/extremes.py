"""Few points that show a long signal as all of its samples would."""

from __future__ import annotations

import numpy as np

MOST_POINTS = 20_000  # of a signal; more are drawn as their extremes


def extremes(values: np.ndarray, most: int = MOST_POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Samples and values to draw: of long signals the extremes and the first gap of each piece.

    Parameters
    ----------
    values : (n,) ndarray
        A gap is NaN.
    most : int
        Number of points, about.

    Returns
    -------
    place : (k,) ndarray of int
    values : (k,) ndarray
    """
    n = len(values)
    if n <= most:
        return np.arange(n), values
    size = -(-3 * n // most)
    pieces = values[: n - n % size].reshape(-1, size)
    lost = np.isnan(pieces)
    lowest = np.where(lost, np.inf, pieces).argmin(axis=1)
    highest = np.where(lost, -np.inf, pieces).argmax(axis=1)
    gap = np.where(lost.any(axis=1), lost.argmax(axis=1), lowest)
    columns = np.column_stack([lowest, highest, gap]) + size * np.arange(len(pieces))[:, None]
    place = np.unique(np.append(columns, np.arange(n - n % size, n)))
    return place, values[place]
