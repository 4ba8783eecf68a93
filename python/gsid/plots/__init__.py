"""Plots: each function draws result objects and returns a matplotlib Figure, without pyplot or global state.

The method `plot()` of a result calls the function registered here for its type (`gsid.base.plottable`).
All intervals are 95 %, point by point; gsid.models.confidence computes them.
"""

from gsid.base.plottable import figure_of
from gsid.comparison import Comparison
from gsid.diagnosis.from_records.result import Diagnosis
from gsid.diagnosis.ladder import Ladder
from gsid.diagnosis.torque_residual import TorqueResidual
from gsid.excitation.periodic import Periodic
from gsid.fitting.estimators import Estimators
from gsid.greybox.fit import PlantFit
from gsid.models.mimo import MimoModel
from gsid.models.piecewise import PiecewiseModel
from gsid.models.rational import RationalModel
from gsid.plots.compare import comparison, ladder
from gsid.plots.compared_methods import excitation_methods
from gsid.plots.experiment import crest_factors, excitation, periods
from gsid.plots.greybox import plant_fit
from gsid.plots.joined_bands import joined
from gsid.plots.matrix import bode_matrix
from gsid.plots.methods import estimators
from gsid.plots.next_experiment import next_experiments
from gsid.plots.noise_spectrum import noise
from gsid.plots.nonlinearity import distortion, superposition
from gsid.plots.prediction import predicted_output
from gsid.plots.record import one_record
from gsid.plots.response import bode, bode_of_plant, frf, piecewise, residual, residual_of_plant
from gsid.plots.roots import pole_zero, root_text
from gsid.plots.structure import start
from gsid.plots.style import STYLE, band_text, delay_text, narrow, order_text, with_interval
from gsid.plots.torque import missing_torque, torque_residual
from gsid.prediction import PredictedOutput
from gsid.records.record import Record
from gsid.response.distortion import Distortion
from gsid.response.frf import Frf
from gsid.response.join import Joined
from gsid.response.superposition import Superposition
from gsid.spectrum.noise import Noise
from gsid.structure.start import Start

__all__ = [
    "STYLE",
    "band_text",
    "bode",
    "bode_matrix",
    "bode_of_plant",
    "comparison",
    "crest_factors",
    "delay_text",
    "distortion",
    "estimators",
    "excitation",
    "excitation_methods",
    "frf",
    "joined",
    "ladder",
    "missing_torque",
    "narrow",
    "next_experiments",
    "noise",
    "order_text",
    "periods",
    "piecewise",
    "plant_fit",
    "pole_zero",
    "predicted_output",
    "residual",
    "residual_of_plant",
    "root_text",
    "start",
    "superposition",
    "torque_residual",
    "with_interval",
]

_DRAWINGS = {
    Comparison: comparison,
    Diagnosis: missing_torque,
    Distortion: distortion,
    Estimators: estimators,
    Frf: frf,
    Joined: joined,
    Ladder: ladder,
    MimoModel: bode_matrix,
    Noise: noise,
    Periodic: excitation,
    PiecewiseModel: piecewise,
    PlantFit: plant_fit,
    PredictedOutput: predicted_output,
    RationalModel: bode,
    Record: one_record,
    Start: start,
    Superposition: superposition,
    TorqueResidual: torque_residual,
}
for _type, _drawing in _DRAWINGS.items():
    figure_of.register(_type, _drawing)
