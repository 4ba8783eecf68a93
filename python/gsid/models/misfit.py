"""Is an error of a model's output more than noise and the model's own uncertainty? (CMP-1)

Noise of the mean: T = |E|^2 / s^2, s^2 the sample variance of the mean error E, follows F(2, 2 nu) for
Gaussian noise exactly: P(T > t) = (1 + t/nu)^-nu. So q = nu ln(1 + T/nu) is exponential with mean 1 for any
nu >= 1, and twice the sum of q over n lines is chi-square with 2 n degrees of freedom: with few periods,
too, the test keeps its false-alarm rate, where one that takes s^2 for the true variance would not. Line 0
is real: T follows F(1, nu), and q = -ln P(T > t).

A model that was fitted elsewhere is off by J d, d of covariance C, common to all lines of all records. With
A = J C^(1/2) the error is noise + A z, z standard normal, and for known variances S

    e' (S + A A')^-1 e = min over z of (e - A z)' S^-1 (e - A z) + z'z,

chi-square with 2 n degrees of freedom as well. What counts as misfit is what is left beside the best change
of the parameters, and the size of that change in units of its covariance. C need not have an inverse. With
estimated variances twice the sum of q of what is left takes the place of the first term.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy import linalg, special, stats

TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Errors:
    """Errors of a model's mean output at k lines, and what is known of them when the model is right.

    Attributes
    ----------
    error : (k,) complex ndarray
    var_mean : (k,) ndarray
        Sample variance of the error.
    dof : (k,) ndarray
        Its degrees of freedom, inf where the variance is known.
    var_weight : (k,) ndarray
        The same variance, less scattered: 1 over it is the weight of the line
        (`gsid.spectrum.pooling.for_weights`).
    real : (k,) bool ndarray
        Lines without imaginary part.
    by_model : (k, p) complex ndarray
        What one standard deviation of the model along each of p independent directions does to the output;
        no column for a model without uncertainty.
    """

    error: np.ndarray
    var_mean: np.ndarray
    dof: np.ndarray
    var_weight: np.ndarray
    real: np.ndarray
    by_model: np.ndarray

    def __len__(self) -> int:
        return len(self.error)

    def __getitem__(self, lines: np.ndarray) -> Errors:
        """Those of some lines."""
        return Errors(*(getattr(self, each.name)[lines] for each in fields(self)))

    @classmethod
    def joined(cls, several: Sequence[Errors]) -> Errors:
        """Those of several records of one model as one."""
        return cls(*(np.concatenate([getattr(one, each.name) for one in several]) for each in fields(cls)))

    @property
    def squares(self) -> np.ndarray:
        """(k,) |error|^2."""
        return np.abs(self.error) ** 2

    @property
    def var_model(self) -> np.ndarray:
        """(k,) variance of the output by the model's uncertainty."""
        return np.sum(np.abs(self.by_model) ** 2, axis=1)

    @property
    def t(self) -> np.ndarray:
        """(k,) |error|^2 over its sample variance."""
        return self.squares / np.maximum(self.var_mean, TINY)

    @property
    def t_expected(self) -> np.ndarray:
        """(k,) mean of t when only noise is left; 1 with one degree of freedom, where it has none."""
        return np.where(self.dof > 1, 1 + 1 / np.maximum(self.dof - 1, 1), 1.0)

    @property
    def q(self) -> np.ndarray:
        """(k,) exponential with mean 1 when only noise is left."""
        t, dof = self.t, self.dof
        known = np.isinf(dof)
        nu = np.where(known, 1.0, dof)
        q = np.where(known, t, nu * np.log1p(t / nu))
        if np.any(self.real):
            tail = stats.f.sf(t[self.real], 1, np.minimum(dof[self.real], 1e9))
            q[self.real] = -np.log(np.maximum(tail, TINY))
        return q


@dataclass(frozen=True)
class Misfit:
    """What is left of errors beside the best change of the model.

    Attributes
    ----------
    left : Errors
        With the error that is left.
    moved : float
        z'z: the change of the model over its covariance.
    n_dof : float
        Mean of `chi2` when the model is right.
    """

    left: Errors
    moved: float
    n_dof: float

    @property
    def chi2(self) -> float:
        """Twice the sum of q, and the size of the model's change."""
        return 2 * float(np.sum(self.left.q)) + self.moved

    @property
    def p_value(self) -> float:
        """Probability of a misfit this large or larger when the model is right."""
        return float(special.chdtrc(self.n_dof, self.chi2))


def misfit(errors: Errors) -> Misfit:
    """Judge errors with the model's uncertainty allowed for.  Eq: CMP-1

    Parameters
    ----------
    errors : Errors

    Returns
    -------
    Misfit
    """
    n, p = errors.by_model.shape
    if p == 0:
        return Misfit(errors, 0.0, 2.0 * n)
    # Without noise to speak of z, standard normal, would have no figure left to count with.
    least = max(1e-20 * float(np.max(np.abs(errors.by_model))) ** 2, TINY)
    weight = np.sqrt(np.where(errors.real, 1, 2) / np.maximum(errors.var_weight, least))
    # Least squares of (a; 1) z = (e; 0), both whitened, real parts above imaginary parts.
    whitened = np.column_stack([errors.by_model, errors.error]) * weight[:, None]
    rows = np.concatenate([whitened.real, np.where(errors.real[:, None], 0.0, whitened.imag)])
    q, r = np.linalg.qr(np.concatenate([rows[:, :p], np.eye(p)]))
    q = q[: 2 * n]
    z = linalg.solve_triangular(r, q.T @ rows[:, p])
    left = replace(errors, error=errors.error - errors.by_model @ z)
    # The change of the model takes a share h out of a line's variance. That lowers the mean of 2 q by
    # h nu/(nu + 1), while the mean of z'z is the sum of h.
    taken = np.sum(q**2, axis=1).reshape(2, n).sum(axis=0)
    return Misfit(left, float(z @ z), 2.0 * n + float(np.sum(taken / (errors.dof + 1))))
