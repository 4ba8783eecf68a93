"""Paired test of whether the error falls between two plant models, on the same records (CMP-3).

The difference of the two predictions at a line does not depend on the noise. The difference of the squared
errors is therefore linear in the noise. Its variance follows from the noise of the lines, and Student's t
tests whether its sum over lines and records is positive. The noise common to both errors cancels, so that
the test detects a fall much smaller than the scatter of either error. The predictions must not depend on the
noise of these records: the records must not have been fitted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtr

from gsid.greybox.weights import lines_used
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra

FALL_ALARM = 0.05  # significance level of a fall
ALIKE = 1e-9  # predictions that differ by less, over their largest line, differ by rounding only


def fall_p_value(
    before: PlantModel,
    after: PlantModel,
    records: Sequence[Spectra],
    *,
    band: tuple[float, float] | None = None,
) -> float:
    """Probability of a fall of the error this large if the second model is no nearer to the truth.

    Parameters
    ----------
    before, after : PlantModel
        Models fitted to other periods than those of `records`.
    records : sequence of Spectra
        Each with at least two good periods.
    band : (lo, hi), optional
        Hz; default as in `gsid.fit_plant`.

    Returns
    -------
    float
        0 .. 1; 1 where the predictions are equal.

    Raises
    ------
    GsidError
        A model cannot be simulated.
    """
    parts = []
    for s in records:
        use = lines_used(before, s, band)
        first, second = (model.predict(s).Y[use] for model in (before, after))
        if np.all(np.abs(second - first) <= ALIKE * np.max(np.abs(first), initial=0.0)):
            second = first
        falls = fall_by_line(s.y[use] - first, s.y[use] - second, s.line[use] == 0)
        dof = (s.n_periods - 1) * np.where(s.line[use] == 0, 1, 2)
        parts.append((*falls, s.noise_y[use] / s.n_periods, dof))
    fall, slope, variance, dof = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return p_value_of_sum(fall, slope**2 * variance, dof)


def fall_by_line(first: np.ndarray, second: np.ndarray, real: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reduction of the mean square error at each line, and its sensitivity to the noise.

    Parameters
    ----------
    first, second : (k,) complex ndarrays
        Errors of the mean output.
    real : (k,) bool ndarray
        True for the line at frequency 0.

    Returns
    -------
    fall, slope : (k,) ndarrays
        The standard deviation of `fall` is `slope` times that of the mean output, both of its parts together.
    """
    power = np.where(real, 1.0, 0.5)  # of a line in the mean square
    fall = power * (np.abs(first) ** 2 - np.abs(second) ** 2)
    # Only the part of complex noise in phase with the difference has an effect: half of the variance.
    return fall, 2 * power * np.abs(second - first) * np.where(real, 1.0, np.sqrt(0.5))


def p_value_of_sum(fall: np.ndarray, variance: np.ndarray, dof: np.ndarray) -> float:
    """One-sided p-value of a sum by Student's t; `variance` of each part is an estimate of `dof`, (k,) each.

    The degrees of freedom of the summed variance are Satterthwaite's.
    """
    total = float(np.sum(variance))
    if not total > 0:
        return 0.0 if np.sum(fall) > 0 else 1.0
    return float(stdtr(total**2 / np.sum(variance**2 / dof), -np.sum(fall) / np.sqrt(total)))
