"""Pool the variances of neighbouring lines if each line has few degrees of freedom."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

DOF_WANTED = 20  # variances with fewer degrees of freedom are pooled over neighbouring lines


def smoothed(variance: np.ndarray, dof: float) -> tuple[np.ndarray, float]:
    """Pool the variances of neighbouring lines if they have fewer than 20 degrees of freedom.

    Parameters
    ----------
    variance : (k,) ndarray
        Sample variances.
    dof : float
        Degrees of freedom of each; inf if the variances are known.

    Returns
    -------
    (k,) ndarray, float
        Pooled variances, and their degrees of freedom.
    """
    if dof >= DOF_WANTED or len(variance) == 0:
        return variance, dof
    half = min(int(np.ceil((DOF_WANTED / dof - 1) / 2)), (len(variance) - 1) // 2)
    return ndimage.uniform_filter1d(variance, 2 * half + 1, mode="reflect"), dof * (2 * half + 1)


def for_weights(variance: np.ndarray, dof: float) -> np.ndarray:
    """Pool the variances of neighbouring lines, scaled so that 1/variance is unbiased.

    Parameters
    ----------
    variance : (k,) ndarray
        Sample variances.
    dof : float
        Degrees of freedom of each; inf if the variances are known.

    Returns
    -------
    (k,) ndarray
    """
    variance, dof = smoothed(variance, dof)
    return variance if np.isinf(dof) or dof <= 1 else variance * dof / (dof - 1)
