"""Pictures: one function each, objects in, a matplotlib Figure out (no pyplot, no global state).

Confidence throughout is 95 %, point by point; the bands are those of gsid.models.confidence.
"""

from gsid.plots.candidates import diagnosis
from gsid.plots.compare import comparison, ladder
from gsid.plots.experiment import crest_factors, excitation, periods
from gsid.plots.matrix import bode_matrix
from gsid.plots.methods import estimators
from gsid.plots.noise_spectrum import noise
from gsid.plots.nonlinearity import distortion, superposition
from gsid.plots.response import bode, bode_of_plant, frf, piecewise, residual, residual_of_plant
from gsid.plots.roots import pole_zero, root_text
from gsid.plots.style import STYLE, band_text, delay_text, order_text, with_interval
from gsid.plots.torque import torque_residual

__all__ = [
    "STYLE",
    "band_text",
    "bode",
    "bode_matrix",
    "bode_of_plant",
    "comparison",
    "crest_factors",
    "delay_text",
    "diagnosis",
    "distortion",
    "estimators",
    "excitation",
    "frf",
    "ladder",
    "noise",
    "order_text",
    "periods",
    "piecewise",
    "pole_zero",
    "residual",
    "residual_of_plant",
    "root_text",
    "superposition",
    "torque_residual",
    "with_interval",
]
