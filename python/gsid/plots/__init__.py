"""Pictures: one function each, objects in, a matplotlib Figure out (no pyplot, no global state).

Confidence throughout is 95 %, point by point; the bands are those of gsid.confidence.
"""

from gsid.plots.compare import comparison, ladder
from gsid.plots.diagnosis import diagnosis
from gsid.plots.distortion import distortion, superposition
from gsid.plots.estimators import estimators
from gsid.plots.experiment import crest_factors, excitation, periods
from gsid.plots.matrix import bode_matrix
from gsid.plots.noise import noise
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
