"""Expected variance of a response for another amplitude, number of periods and number of realisations.

With n the variance of the noise at a line of one period, s^2 that of the distortion of one realisation, A the
amplitude, P periods in each of M realisations (EXC-11):

    var G = n / (A^2 P M) + s^2 / M
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gsid.response.frf import Frf
from gsid.spectrum.pooling import for_weights

P_MIN = 2  # periods: fewer do not show the noise


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of a response, pooled over neighbouring lines if each line has few degrees of freedom.

    Attributes
    ----------
    noise : (F,)
        Variance by the noise of one period at unit amplitude.
    distortion : (F,)
        Variance by the distortion of one realisation.
    """

    noise: np.ndarray
    distortion: np.ndarray

    @classmethod
    def of(cls, response: Frf) -> Errors:
        """Errors that a measured response shows.

        Parameters
        ----------
        response : Frf
            With `var_total` if distortion was measured.
        """
        if not np.all(np.isfinite(response.var_g)) or not np.all(response.var_g > 0):
            raise ValueError("the measurement lacks a variance at some lines: measure at least 2 periods")
        dof = float(response.n_dof)
        noise = for_weights(response.var_g * response.n_periods * np.abs(response.u) ** 2, dof)
        beside = np.zeros(len(noise)) if response.var_total is None else response.var_total - response.var_g
        return cls(noise, np.maximum(beside, 0) * response.n_realisations)

    def variance(self, amplitude: np.ndarray, n_periods: int, n_realisations: int) -> np.ndarray:
        """Expected variance of the response.  Eq: EXC-11"""
        return self.noise / (amplitude**2 * n_periods * n_realisations) + self.distortion / n_realisations


def periods_for(noise: np.ndarray, wanted: np.ndarray) -> int:
    """Least number of periods that brings the variance `noise` of one period below `wanted` at all lines.

    Parameters
    ----------
    noise, wanted : (F,) ndarray

    Returns
    -------
    int
        At least 2.
    """
    return max(P_MIN, math.ceil(float(np.max(noise / wanted)) * (1 - 1e-12)))
