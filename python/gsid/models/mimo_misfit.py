"""Test of the errors of several outputs against their joint noise and the uncertainty of a model (CMP-4).

Noise of different outputs is correlated. At a line, the columns x_j, each the mean error of one of E
experiments times the root of its periods, have the same covariance C as the d columns of the scatter, whose
sum of squares is A_0. With A_j = A_(j-1) + x_j x_j^H and L_j its Cholesky factor,

    B_ij = |L_(j-1)[i, i] / L_j[i, i]|^2,   q_ij = -(d + j - i) ln B_ij,   i, j = 0, 1, ...

are independent and exponential with mean 1 for any C: B_ij is Beta(d + j - i, 1), the test of output i given
the outputs before it, whose noise is estimated from the scatter and the experiments before j. The product of
all B_ij is Wilks' determinant det A_0 / det A_E. With one output and one experiment q is that of CMP-1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gsid.models.misfit import Errors, Misfit, misfit
from gsid.spectrum.pooling import averaged, neighbours


@dataclass(frozen=True)
class MimoErrors:
    """Errors of the mean outputs of a model at K lines, in E experiments.

    Attributes
    ----------
    error : (K, n_y, E) complex ndarray
        Mean error of each experiment times the root of the number of its periods.
    scatter : (K, n_y, n_y) complex ndarray
        Sum of squares of `dof` errors of single periods that contain noise only.
    dof : int
    by_model : (K, n_y, E, r) complex ndarray
        Change of `error` for one standard deviation of the model along each of r independent directions.
    """

    error: np.ndarray
    scatter: np.ndarray
    dof: int
    by_model: np.ndarray

    def __getitem__(self, lines: np.ndarray) -> MimoErrors:
        """Errors of a selection of lines."""
        return MimoErrors(self.error[lines], self.scatter[lines], self.dof, self.by_model[lines])

    def of_output(self, i: int) -> MimoErrors:
        """Errors of one output alone."""
        one = slice(i, i + 1)
        return MimoErrors(self.error[:, one], self.scatter[:, one, one], self.dof, self.by_model[:, one])

    @property
    def t(self) -> np.ndarray:
        """(K, n_y, E) |error|^2 over its sample variance, of each output alone."""
        variance = np.einsum("kii->ki", self.scatter).real / self.dof
        return np.abs(self.error) ** 2 / np.maximum(variance, np.finfo(float).tiny)[:, :, None]

    @property
    def scores(self) -> np.ndarray:
        """(K, n_y, E) independent scores q, exponential with mean 1 if only noise remains.  Eq: CMP-4"""
        q = np.empty(self.error.shape)
        before, output = self.scatter, np.arange(self.error.shape[1])
        old = _log_diagonal(before)
        for j in range(self.error.shape[2]):
            x = self.error[:, :, j]
            before = before + x[:, :, None] * x[:, None, :].conj()
            new = _log_diagonal(before)
            q[:, :, j] = 2 * (self.dof + j - output) * (new - old)
            old = new
        return np.maximum(q, 0.0)

    @property
    def half_covariance(self) -> np.ndarray:
        """(K, n_y, n_y) Cholesky factors of the covariance, for weights.

        It is pooled over neighbouring lines, and scaled so that its inverse is unbiased.
        """
        n_lines, n_y, _ = self.error.shape
        half = neighbours(n_lines, float(self.dof))
        covariance = averaged(self.scatter, half) if half else self.scatter
        dof = self.dof * (2 * half + 1)
        covariance = covariance / self.dof * (dof / (dof - n_y) if dof > n_y else 1.0)
        return np.linalg.cholesky(covariance)

    def whitened(self, half: np.ndarray) -> Errors:
        """Errors, and changes by the model, of independent components of variance 1, as lines of their own.

        Parameters
        ----------
        half : (K, n_y, n_y) ndarray
            `half_covariance`.
        """
        n_lines, n_y, n_e = self.error.shape
        columns = np.concatenate([self.by_model.reshape(n_lines, n_y, -1), self.error], axis=2)
        white = np.linalg.solve(half, columns)
        n, r = n_lines * n_y * n_e, self.by_model.shape[3]
        order = self.dof + np.arange(n_e) - np.arange(n_y)[:, None]
        return Errors(
            error=white[:, :, n_e * r :].reshape(n),
            var_mean=np.ones(n),
            dof=np.broadcast_to(order, self.error.shape).reshape(n).astype(float),
            var_weight=np.ones(n),
            real=np.zeros(n, bool),
            by_model=white[:, :, : n_e * r].reshape(n, r),
        )


@dataclass(frozen=True)
class MimoMisfit:
    """Errors that remain after the best change of the model within its uncertainty.

    Attributes
    ----------
    left : MimoErrors
    total : Misfit
        Test of all scores.
    """

    left: MimoErrors
    total: Misfit

    @property
    def excess(self) -> float:
        """Sum of squared errors over their variance, less its mean for a correct model."""
        expected = self.left.dof / (self.left.dof - 1) if self.left.dof > 1 else 1.0
        return float(np.sum(self.left.t - expected)) + self.total.moved / 2


def mimo_misfit(errors: MimoErrors) -> MimoMisfit:
    """Test the errors of several outputs against noise and the uncertainty of the model.  Eq: CMP-4

    Parameters
    ----------
    errors : MimoErrors

    Returns
    -------
    MimoMisfit
    """
    half = errors.half_covariance
    found = misfit(errors.whitened(half))
    left = replace(errors, error=half @ found.left.error.reshape(errors.error.shape))
    return MimoMisfit(left, replace(found, chi2=2 * float(np.sum(left.scores)) + found.moved))


def _log_diagonal(matrices: np.ndarray) -> np.ndarray:
    """ln of the diagonals of the Cholesky factors."""
    return np.log(np.einsum("kii->ki", np.linalg.cholesky(matrices)).real)
