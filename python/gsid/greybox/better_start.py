"""The fit of a model from the measured response, or from its own values if these are better."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gsid.greybox.fit import CANNOT_FIT, PlantFit, fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra


def fit_from_better_start(model: PlantModel, measured: Sequence[Spectra], **options: Any) -> PlantFit:
    """Fit a model from the measured response, and from its own values if these cost less than that fit.

    A response that noise in the input or a law has bent may lead far from values that are nearly right.

    Parameters
    ----------
    model : PlantModel
    measured : sequence of Spectra
    **options
        Of `gsid.fit_plant`.

    Returns
    -------
    PlantFit

    Raises
    ------
    ValueError, InputError, GsidError
        As `gsid.fit_plant`.
    """
    begin = linear_start(model, measured)
    fit = fit_plant(begin, measured, **options)
    if begin is model or not _costs_less(model, fit):
        return fit
    again = fit_plant(model, measured, **options)
    return again if again.cost < fit.cost else fit


def _costs_less(model: PlantModel, fit: PlantFit) -> bool:
    """Whether the values of a model cost less than a fit, with its lines and weights."""
    try:
        return sum(one.cost_of(model) for one in fit.records) < fit.cost
    except CANNOT_FIT:
        return False
