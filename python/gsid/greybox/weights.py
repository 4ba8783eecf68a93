"""Which lines of a record count when a plant is fitted to it or compared with it, and with which variance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsid.base.bands import in_band
from gsid.base.errors import InputError
from gsid.plant.model import PlantModel
from gsid.spectrum.pooling import smoothed
from gsid.spectrum.spectra import Spectra

UNSETTLED = 0.1  # what may change in a period, over the mean's noise, before it is reported
SAME_LEVEL = 1.05  # records whose inputs' rms differ by less are of one level


def pooled_variance(measured: Sequence[Spectra], *, drift: bool = False) -> list[tuple[np.ndarray, float]]:
    """Variance of one period's output lines, pooled (GBX-3).

    Over records of one period, sample rate and level of the input (5 %), and where that leaves fewer than
    20 degrees of freedom over neighbouring lines too.

    Parameters
    ----------
    measured : sequence of Spectra
    drift : bool
        Whether a ramp is taken out of the means: alike in all periods, it then counts as no noise.

    Returns
    -------
    list of ((K,) ndarray, float)
        For each record: variance of lines 0 .. N/2, and its degrees of freedom.

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
    """Whether the inputs of two records are of one size, within 5 %."""
    ratio = np.linalg.norm(a.u[a.excited]) / np.linalg.norm(b.u[b.excited])
    return bool(1 / SAME_LEVEL < ratio < SAME_LEVEL)


def _alike(a: Spectra, b: Spectra) -> bool:
    return a.period_samples == b.period_samples and a.fs_hz == b.fs_hz and same_level(a, b)


def _pool(group: list[Spectra], drift: bool) -> tuple[np.ndarray, float]:
    dof = float(sum(one.n_periods - 1 for one in group))
    each = [one.var_y if drift else one.noise_y for one in group]
    variance = sum((one.n_periods - 1) * own for one, own in zip(group, each, strict=True)) / dof
    # The ends, real lines, have variances of their own size.
    variance[1:-1], dof = smoothed(variance[1:-1], dof)
    if dof <= 2:
        hint = "measure more periods: at least 3 in all, or longer ones"
        raise InputError(
            "too few periods and lines for a variance", group[0].name, f"{dof:g} degrees of freedom", hint
        )
    return variance, dof


def lines_used(model: PlantModel, s: Spectra, band: tuple[float, float] | None) -> np.ndarray:
    """(K,) which lines of a record count in a fit of a plant and in a comparison with it.

    Parameters
    ----------
    model : PlantModel
    s : Spectra
    band : (lo, hi) or None
        Hz; None: see `fit_plant`.

    Raises
    ------
    ValueError
        None does.
    """
    if band is None:
        f_excited = s.f_hz[s.excited]
        # A position loop and its reference have one zero: there the mean angle says something.
        common_zero = model.output == "angle" and model.has_controller
        band = (0.0 if common_zero else f_excited[0], f_excited[-1])
    use = in_band(s.f_hz, band)
    use &= 2 * s.line < s.period_samples
    if model.output == "angle" and not model.looks_at_angle:
        use[0] = False  # nothing says where the axis stands
    if not np.any(use):
        raise ValueError("no line between 0 and half the sample rate lies in the band")
    return use
