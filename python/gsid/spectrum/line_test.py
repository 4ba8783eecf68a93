"""Test of one line's error against its own sample variance (CMP-1)."""

from __future__ import annotations

import numpy as np


def exponential_score(t: np.ndarray, dof: np.ndarray | float) -> np.ndarray:
    """Transform t, |error|^2 over its sample variance, to a score that is exponential with mean 1 for noise.

    q = nu ln(1 + t/nu), since P(T > t) = (1 + t/nu)^-nu for T of F(2, 2 nu).  Eq: CMP-1

    Parameters
    ----------
    t : (k,) ndarray
    dof : (k,) ndarray or float
        Degrees of freedom nu of the variance; inf if it is known.

    Returns
    -------
    (k,) ndarray
        q. Twice the sum over k lines is chi-square with 2 k degrees of freedom.
    """
    known = np.isinf(dof)
    nu = np.where(known, 1.0, dof)
    return np.where(known, t, nu * np.log1p(t / nu))
