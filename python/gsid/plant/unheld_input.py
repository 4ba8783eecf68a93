"""Error of the simulation of an input that is not held (PLT-3)."""

from __future__ import annotations

import numpy as np

from gsid.plant.linear_response import linear_view
from gsid.plant.model import PlantModel
from gsid.plant.periodic import oversampling_of
from gsid.plant.units import RADIANS
from gsid.spectrum.spectra import Spectra

IMAGES = 10  # on each side: further ones are below 1 % of the error


def unheld_error(measured: Spectra, model: PlantModel) -> np.ndarray:
    """By how much simulated lines of the output are too large, by the linear part; 0 of a held input.

    Parameters
    ----------
    measured : Spectra
    model : PlantModel

    Returns
    -------
    (K,) complex ndarray
        Lines 0 .. N/2, in the unit of y.
    """
    n_steps = oversampling_of(measured, model.has_controller)
    lines = np.zeros(len(measured.f_hz), complex)
    if n_steps == 1:
        return lines
    step_hz = n_steps * measured.fs_hz
    share = measured.f_hz[1:] / step_hz
    image = np.delete(np.arange(-IMAGES, IMAGES + 1), IMAGES)[:, None]
    at_hz = (share + image) * step_hz
    how = {"output_angle": model.output == "angle", "radians_per_unit": RADIANS[model.angle_unit]}
    view = linear_view(model.stack(), np.abs(at_hz).ravel(), measured.fs_hz, held=False, **how)
    answer = view.command.reshape(at_hz.shape)
    answer = np.where(at_hz < 0, answer.conj(), answer)
    lines[1:] = measured.u[1:] * np.sum((share / (share + image)) ** 2 * answer, axis=0)
    return lines
