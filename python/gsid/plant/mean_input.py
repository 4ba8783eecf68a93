"""Records whose input differs between the periods, as records of their mean input.

What the input of a period has beside the mean is noise of its measurement, or it moves the axis too, as the
noise that a controller feeds back. The error of a model contains the response to it in the first case, and
lacks it in the second. Without this response the output has the mean that it had, and its variance is that of
the error of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gsid.plant.linear_response import linear_view
from gsid.plant.model import PlantModel
from gsid.plant.units import RADIANS
from gsid.spectrum.lines import bins_of_record, lines_of, phase_factors
from gsid.spectrum.spectra import Spectra


def with_mean_input(measured: Sequence[Spectra], model: PlantModel) -> list[Spectra]:
    """The records with the mean input in each period; those whose input repeats stay as they are (GBX-3).

    Parameters
    ----------
    measured : sequence of Spectra
    model : PlantModel
        Its linear part gives the response.
    """
    return [one if one.input_repeats else _with_mean(one, model) for one in measured]


def _with_mean(one: Spectra, model: PlantModel) -> Spectra:
    """The response is that over the whole record: a period's input moves the axis in the next one too."""
    n = one.period_samples
    bins = bins_of_record(one.U - one.u, n, one.settle_samples)[: n * one.n_periods // 2 + 1]
    f_hz = np.arange(1, len(bins)) * (one.fs_hz / (n * one.n_periods))
    view = linear_view(
        model.stack(),
        f_hz,
        one.fs_hz,
        output_angle=model.output == "angle",
        radians_per_unit=RADIANS[model.angle_unit],
        held=one.hold == "zoh" or model.has_controller,
    )
    bins[1:] *= view.command
    samples = np.fft.irfft(bins, n * one.n_periods).reshape(one.n_periods, n)
    part = lines_of(samples) * phase_factors(one.line, one.settle_samples, n)
    mean = np.tile(one.u, (one.n_periods, 1))
    return replace(one, Y=one.Y - part, U=mean)
