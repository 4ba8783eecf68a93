"""Test whether the output error of a model exceeds the noise and the uncertainty of the model (CMP-1).

Noise: s^2 is the sample variance of the mean error E. For Gaussian noise, T = |E|^2 / s^2 follows F(2, 2 nu)
exactly: P(T > t) = (1 + t/nu)^-nu. Therefore q = nu ln(1 + T/nu) is exponential with mean 1 for any nu >= 1,
and twice the sum of q over n lines is chi-square with 2 n degrees of freedom. The test keeps its false-alarm
rate even with few periods. A test that treats s^2 as the true variance would not. Line 0 is real: T follows
F(1, nu), and q = -ln P(T > t).

Model uncertainty: a model that was fitted to other records has the error J d. d has the covariance C and is
common to all lines of all records. With A = J C^(1/2), the error is noise + A z, where z is standard normal.
For known variances S,

    e' (S + A A')^-1 e = min over z of (e - A z)' S^-1 (e - A z) + z'z,

is also chi-square with 2 n degrees of freedom. The misfit consists of the error that remains after the best
change of the parameters, and of the size of this change in units of its covariance. C may be singular. With
estimated variances, twice the sum of q of the remaining error replaces the first term.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy import linalg, special

from gsid.spectrum.line_test import exponential_score

TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Errors:
    """Errors of the mean output of a model at k lines, and their statistics for a correct model.

    Attributes
    ----------
    error : (k,) complex ndarray
        Measured mean minus model.
    var_mean : (k,) ndarray
        Sample variance of the error.
    dof : (k,) ndarray
        Degrees of freedom of this variance; inf if the variance is known.
    var_weight : (k,) ndarray
        The same variance with less scatter. Its inverse is the weight of the line
        (`gsid.spectrum.pooling.for_weights`).
    real : (k,) bool ndarray
        Lines without imaginary part.
    by_model : (k, p) complex ndarray
        Change of the output for one standard deviation of the model along each of p independent directions.
        A model without uncertainty has no column.
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
        """Errors of a selection of lines."""
        return Errors(*(getattr(self, each.name)[lines] for each in fields(self)))

    @classmethod
    def joined(cls, several: Sequence[Errors]) -> Errors:
        """Concatenate the errors of several records of one model."""
        return cls(*(np.concatenate([getattr(one, each.name) for one in several]) for each in fields(cls)))

    @property
    def squares(self) -> np.ndarray:
        """(k,) |error|^2."""
        return np.abs(self.error) ** 2

    @property
    def var_model(self) -> np.ndarray:
        """(k,) variance of the output caused by the uncertainty of the model."""
        return np.sum(np.abs(self.by_model) ** 2, axis=1)

    @property
    def t(self) -> np.ndarray:
        """(k,) |error|^2 over its sample variance."""
        return self.squares / np.maximum(self.var_mean, TINY)

    @property
    def t_expected(self) -> np.ndarray:
        """(k,) mean of t if only noise remains; set to 1 for one degree of freedom, where it is infinite."""
        return np.where(self.dof > 1, 1 + 1 / np.maximum(self.dof - 1, 1), 1.0)

    @property
    def q(self) -> np.ndarray:
        """(k,) transformed t, exponential with mean 1 if only noise remains."""
        t, dof = self.t, self.dof
        q = exponential_score(t, dof)
        if np.any(self.real):
            tail = special.fdtrc(1, np.minimum(dof[self.real], 1e9), t[self.real])
            q[self.real] = -np.log(np.maximum(tail, TINY))
        return q


@dataclass(frozen=True)
class Misfit:
    """Errors that remain after the best change of the model within its uncertainty.

    Attributes
    ----------
    left : Errors
        Remaining errors.
    moved : float
        z'z: squared change of the model in units of its covariance.
    n_dof : float
        Mean of `chi2` for a correct model.
    """

    left: Errors
    moved: float
    n_dof: float

    @property
    def chi2(self) -> float:
        """Twice the sum of q, plus the squared change of the model."""
        return 2 * float(np.sum(self.left.q)) + self.moved

    @property
    def p_value(self) -> float:
        """Probability of a misfit this large or larger if the model is correct."""
        return self.p_value_of_fit(0)

    def p_value_of_fit(self, n_parameters: float) -> float:
        """The same for a model whose parameters were fitted to these errors.

        Parameters
        ----------
        n_parameters : float
            Number of fitted parameters; each reduces the degrees of freedom by one.

        Returns
        -------
        float
        """
        return float(special.chdtrc(max(self.n_dof - n_parameters, 1), self.chi2))


def misfit(errors: Errors) -> Misfit:
    """Test errors against noise and the uncertainty of the model.  Eq: CMP-1

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
    # With negligible noise, z would be lost to rounding.
    least = max(1e-20 * float(np.max(np.abs(errors.by_model))) ** 2, TINY)
    weight = np.sqrt(np.where(errors.real, 1, 2) / np.maximum(errors.var_weight, least))
    # Least squares of (a; 1) z = (e; 0), both whitened, real parts above imaginary parts.
    whitened = np.column_stack([errors.by_model, errors.error]) * weight[:, None]
    rows = np.concatenate([whitened.real, np.where(errors.real[:, None], 0.0, whitened.imag)])
    q, r = np.linalg.qr(np.concatenate([rows[:, :p], np.eye(p)]))
    q = q[: 2 * n]
    z = linalg.solve_triangular(r, q.T @ rows[:, p])
    left = replace(errors, error=errors.error - errors.by_model @ z)
    # The change of the model removes a share h of the variance of a line. This lowers the mean of 2 q by
    # h nu/(nu + 1). The mean of z'z is the sum of h.
    taken = np.sum(q**2, axis=1).reshape(2, n).sum(axis=0)
    return Misfit(left, float(z @ z), 2.0 * n + float(np.sum(taken / (errors.dof + 1))))
