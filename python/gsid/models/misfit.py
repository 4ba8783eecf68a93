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

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from gsid._lib import check, ffi, lib

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

    def as_c(self) -> tuple[Any, list[Any]]:
        """The lines as `gsid_misfit_lines`, and the memory they point to."""
        columns = {
            "error": ("gsid_cplx *", complex),
            "variance": ("double *", float),
            "dof": ("double *", float),
            "var_weight": ("double *", float),
            "is_real": ("uint8_t *", np.uint8),
            "by_model": ("gsid_cplx *", complex),
        }
        values = (self.error, self.var_mean, self.dof, self.var_weight, self.real, self.by_model)
        lines, kept = ffi.new("gsid_misfit_lines *"), []
        for (name, (kind, dtype)), value in zip(columns.items(), values, strict=True):
            kept.append(ffi.from_buffer(np.ascontiguousarray(value, dtype)))
            setattr(lines, name, ffi.cast(kind, kept[-1]))
        lines.n_lines, lines.n_directions = self.by_model.shape
        return lines, kept


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
    chi2 : float
        Twice the sum of q, plus the squared change of the model.
    """

    left: Errors
    moved: float
    n_dof: float
    chi2: float

    @property
    def p_value(self) -> float:
        """Probability of a misfit this large or larger if the model is correct."""
        return self.p_value_of_fit(0)

    def p_value_of_fit(self, n_parameters: float) -> float:
        """The same for a model whose parameters were fitted to these errors.

        Parameters
        ----------
        n_parameters : float
            Number of fitted parameters; each reduces the degrees of freedom by `taken`.

        Returns
        -------
        float
        """
        return float(self._tail(n_parameters).upper)

    @property
    def log10_p_value(self) -> float:
        """Decimal logarithm of `p_value`, which remains finite where that is 0."""
        return float(self._tail(0).log_upper) / math.log(10)

    @property
    def taken(self) -> float:
        """Degrees of freedom that a fitted parameter takes: 1 if the variances are known."""
        dof = np.ascontiguousarray(self.left.dof, float)
        return float(lib.gsid_misfit_taken(len(dof), ffi.from_buffer("double[]", dof)))

    def _tail(self, n_parameters: float) -> Any:
        found = ffi.new("gsid_misfit *", {"n_dof": self.n_dof, "chi2": self.chi2})
        tail = ffi.new("gsid_tail *")
        check(lib.gsid_misfit_tail(found, n_parameters * self.taken, tail), "testing errors")
        return tail


def misfit(errors: Errors) -> Misfit:
    """Test errors against noise and the uncertainty of the model.  Eq: CMP-1

    Parameters
    ----------
    errors : Errors

    Returns
    -------
    Misfit
    """
    lines, _kept = errors.as_c()
    left, found = np.empty(len(errors), complex), ffi.new("gsid_misfit *")
    rest = ffi.cast("gsid_cplx *", ffi.from_buffer(left))
    check(lib.gsid_misfit_test(lines, rest, ffi.NULL, found), "testing errors")
    return Misfit(replace(errors, error=left), found.moved, found.n_dof, found.chi2)
