"""Pool the variances of neighbouring lines if each line has few degrees of freedom."""

from __future__ import annotations

import numpy as np

from gsid._lib import check, ffi, lib

DOF_WANTED = 20  # variances with fewer degrees of freedom are pooled over neighbouring lines


def neighbours(n_lines: int, dof: float, wanted: float = DOF_WANTED) -> int:
    """Number of lines on each side over which variances are pooled.  Eq: GBX-3

    Parameters
    ----------
    n_lines : int
    dof : float
        Degrees of freedom of the variance of one line; inf if it is known.
    wanted : float
        Degrees of freedom of a pooled variance.

    Returns
    -------
    int
    """
    return int(lib.gsid_pool_neighbours(n_lines, dof, wanted))


def averaged(x: np.ndarray, half: int, *, shortened: bool = False) -> np.ndarray:
    """Average over `half` lines on each side.  Eq: GBX-3

    Parameters
    ----------
    x : (k, ...) ndarray
        Real or complex.
    half : int
    shortened : bool
        At the first and last lines, whether to average over fewer lines; otherwise the lines are reflected.

    Returns
    -------
    (k, ...) ndarray
    """
    x = np.ascontiguousarray(x, complex if np.iscomplexobj(x) else float)
    pooled = np.empty_like(x)
    edges = lib.GSID_EDGES_SHORTENED if shortened else lib.GSID_EDGES_REFLECTED
    rows = [ffi.from_buffer("double[]", each) for each in (x, pooled)]
    n_columns = x.size // max(len(x), 1) * (2 if np.iscomplexobj(x) else 1)
    check(lib.gsid_pool_lines(len(x), n_columns, half, edges, *rows), "pooling lines")
    return pooled


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
    half = neighbours(len(variance), dof)
    return averaged(variance, half) if half else variance, dof * (2 * half + 1)


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
