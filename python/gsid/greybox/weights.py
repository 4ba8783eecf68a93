"""Lines of a record, and their variances, that fits of a plant and comparisons use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsid.base.bands import in_band
from gsid.base.errors import InputError
from gsid.greybox.settings import SETTINGS
from gsid.plant.model import PlantModel
from gsid.spectrum.pooling import smoothed
from gsid.spectrum.spectra import Spectra


def pooled_variance(measured: Sequence[Spectra], *, drift: bool = False) -> list[tuple[np.ndarray, float]]:
    """Pool the variance of the output lines of one period (GBX-3).

    Records with the same period, sample rate and input level (within 5 %) are pooled. If that leaves fewer
    than 20 degrees of freedom, neighbouring lines are pooled too.

    Parameters
    ----------
    measured : sequence of Spectra
    drift : bool
        Whether the fit estimates a ramp. A ramp that is equal in all periods then does not count as noise.

    Returns
    -------
    list of ((K,) ndarray, float)
        For each record, the variance of lines 0 .. N/2 and its degrees of freedom.

    Raises
    ------
    InputError
        The records together have too few periods.
    """
    groups: list[list[Spectra]] = []
    for one in measured:
        for group in groups:
            if _alike(one, group[0]):
                group.append(one)
                break
        else:
            groups.append([one])
    pooled = [(group, _pool(group, drift)) for group in groups]
    return [
        next(found for group, found in pooled if any(one is other for other in group)) for one in measured
    ]


def same_level(a: Spectra, b: Spectra) -> bool:
    """Whether the rms inputs of two records agree within 5 %."""
    ratio = np.linalg.norm(a.u[a.excited]) / np.linalg.norm(b.u[b.excited])
    return bool(1 / SETTINGS.same_level < ratio < SETTINGS.same_level)


def _alike(a: Spectra, b: Spectra) -> bool:
    return a.period_samples == b.period_samples and a.fs_hz == b.fs_hz and same_level(a, b)


def _pool(group: list[Spectra], drift: bool) -> tuple[np.ndarray, float]:
    dof = float(sum(one.n_periods - 1 for one in group))
    each = [one.var_y if drift else one.noise_y for one in group]
    variance = sum((one.n_periods - 1) * own for one, own in zip(group, each, strict=True)) / dof
    # The first and last line are real: their variances are not comparable with their neighbours.
    variance[1:-1], dof = smoothed(variance[1:-1], dof)
    if dof <= 2:
        hint = "measure at least 3 periods in total, or longer periods"
        raise InputError(
            "too few periods and lines to estimate a variance",
            group[0].name,
            f"{dof:g} degrees of freedom",
            hint,
        )
    return variance, dof


def has_common_zero(model: PlantModel) -> bool:
    """Whether input and output have a common zero, so that the mean of the output is meaningful.

    Reference and angle of a position loop have one. A gyro has an offset; the zero of an angle is arbitrary.

    Parameters
    ----------
    model : PlantModel
    """
    return model.output == "angle" and model.has_controller


def lines_used(model: PlantModel, s: Spectra, band: tuple[float, float] | None) -> np.ndarray:
    """Select the lines of a record that a fit of a plant or a comparison uses, (K,) bool.

    Parameters
    ----------
    model : PlantModel
    s : Spectra
    band : (lo, hi) or None
        Band [Hz]; None: the default of `fit_plant`.

    Raises
    ------
    ValueError
        The band contains no line.
    """
    if band is None:
        f_excited = s.f_hz[s.excited]
        band = (0.0 if has_common_zero(model) else f_excited[0], f_excited[-1])
    use = in_band(s.f_hz, band)
    use &= 2 * s.line < s.period_samples
    if s.left_out is not None:
        use &= ~s.left_out
    if model.output == "angle" and not model.looks_at_angle:
        use[0] = False  # the zero of the angle is arbitrary
    if not np.any(use):
        raise ValueError("the band contains no line between 0 and half the sample rate")
    return use


def whiten(lines: np.ndarray, weight: np.ndarray, real: np.ndarray) -> np.ndarray:
    """Weight lines, and stack their real and imaginary parts.

    Parameters
    ----------
    lines : (..., k) complex ndarray
    weight : (k,) ndarray
    real : (k,) bool ndarray
        Lines without imaginary part.

    Returns
    -------
    (..., 2 k) ndarray
        [Re; Im]. The imaginary part of a real line is 0.
    """
    weighted = lines * weight
    return np.concatenate([weighted.real, np.where(real, 0.0, weighted.imag)], axis=-1)
