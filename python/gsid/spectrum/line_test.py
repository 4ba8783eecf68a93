"""Test of one line's error against its own sample variance (CMP-1)."""

from __future__ import annotations

import numpy as np

from gsid._lib import check, ffi, lib


def exponential_score(t: np.ndarray, dof: np.ndarray | float, real: np.ndarray | None = None) -> np.ndarray:
    """Transform t, |error|^2 over its sample variance, to a score that is exponential with mean 1 for noise.

    q = nu ln(1 + t/nu), since P(T > t) = (1 + t/nu)^-nu for T of F(2, 2 nu); at a real line -ln P(T > t) for
    T of F(1, nu).  Eq: CMP-1

    Parameters
    ----------
    t : (k,) ndarray
    dof : (k,) ndarray or float
        Degrees of freedom nu of the variance; inf if it is known.
    real : (k,) bool ndarray, optional
        Lines without imaginary part; default none.

    Returns
    -------
    (k,) ndarray
        q. Twice the sum over k lines is chi-square with 2 k degrees of freedom.
    """
    t = np.ascontiguousarray(t, float)
    dof = np.ascontiguousarray(np.broadcast_to(dof, t.shape), float)
    q = np.empty_like(t)
    rows = [ffi.from_buffer("double[]", each) for each in (t, dof, q)]
    flags = ffi.NULL if real is None else ffi.from_buffer("uint8_t[]", np.ascontiguousarray(real, np.uint8))
    check(lib.gsid_misfit_scores(t.size, *rows[:2], flags, rows[2]), "scoring lines")
    return q
