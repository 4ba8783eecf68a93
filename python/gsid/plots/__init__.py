"""Plots: each function draws result objects and returns a matplotlib Figure, without pyplot or global state.

The method `plot()` of a result calls the function that is named here for its type (`gsid.base.plottable`).
Each function is loaded when it is first used: together, with the types that they draw, they take a second.
All intervals are 95 %, point by point; gsid.models.confidence computes them.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the same names for editors and type checkers
    from gsid.plots.compare import comparison as comparison
    from gsid.plots.compare import ladder as ladder
    from gsid.plots.compared_methods import excitation_methods as excitation_methods
    from gsid.plots.experiment import crest_factors as crest_factors
    from gsid.plots.experiment import excitation as excitation
    from gsid.plots.experiment import periods as periods
    from gsid.plots.greybox import plant_fit as plant_fit
    from gsid.plots.joined_bands import joined as joined
    from gsid.plots.matrix import bode_matrix as bode_matrix
    from gsid.plots.methods import estimators as estimators
    from gsid.plots.next_experiment import next_experiments as next_experiments
    from gsid.plots.noise_spectrum import noise as noise
    from gsid.plots.nonlinearity import distortion as distortion
    from gsid.plots.nonlinearity import superposition as superposition
    from gsid.plots.prediction import predicted_output as predicted_output
    from gsid.plots.record import one_record as one_record
    from gsid.plots.response import bode as bode
    from gsid.plots.response import bode_of_plant as bode_of_plant
    from gsid.plots.response import frf as frf
    from gsid.plots.response import piecewise as piecewise
    from gsid.plots.response import residual as residual
    from gsid.plots.response import residual_of_plant as residual_of_plant
    from gsid.plots.roots import pole_zero as pole_zero
    from gsid.plots.roots import root_text as root_text
    from gsid.plots.structure import start as start
    from gsid.plots.style import STYLE as STYLE
    from gsid.plots.style import band_text as band_text
    from gsid.plots.style import delay_text as delay_text
    from gsid.plots.style import narrow as narrow
    from gsid.plots.style import order_text as order_text
    from gsid.plots.style import with_interval as with_interval
    from gsid.plots.torque import missing_torque as missing_torque
    from gsid.plots.torque import torque_residual as torque_residual

# The module of each function.
_HOME = {
    "STYLE": "style",
    "band_text": "style",
    "bode": "response",
    "bode_matrix": "matrix",
    "bode_of_plant": "response",
    "comparison": "compare",
    "crest_factors": "experiment",
    "delay_text": "style",
    "distortion": "nonlinearity",
    "estimators": "methods",
    "excitation": "experiment",
    "excitation_methods": "compared_methods",
    "frf": "response",
    "joined": "joined_bands",
    "ladder": "compare",
    "missing_torque": "torque",
    "narrow": "style",
    "next_experiments": "next_experiment",
    "noise": "noise_spectrum",
    "one_record": "record",
    "order_text": "style",
    "periods": "experiment",
    "piecewise": "response",
    "plant_fit": "greybox",
    "pole_zero": "roots",
    "predicted_output": "prediction",
    "residual": "response",
    "residual_of_plant": "response",
    "root_text": "roots",
    "start": "structure",
    "superposition": "nonlinearity",
    "torque_residual": "torque",
    "with_interval": "style",
}

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

# What draws each type.
DRAWINGS = {
    "gsid.comparison.Comparison": "comparison",
    "gsid.diagnosis.from_records.result.Diagnosis": "missing_torque",
    "gsid.response.distortion.Distortion": "distortion",
    "gsid.fitting.estimators.Estimators": "estimators",
    "gsid.response.frf.Frf": "frf",
    "gsid.response.join.Joined": "joined",
    "gsid.diagnosis.ladder.Ladder": "ladder",
    "gsid.models.mimo.MimoModel": "bode_matrix",
    "gsid.spectrum.noise.Noise": "noise",
    "gsid.excitation.periodic.Periodic": "excitation",
    "gsid.models.piecewise.PiecewiseModel": "piecewise",
    "gsid.greybox.fit.PlantFit": "plant_fit",
    "gsid.prediction.PredictedOutput": "predicted_output",
    "gsid.models.rational.RationalModel": "bode",
    "gsid.records.record.Record": "one_record",
    "gsid.structure.start.Start": "start",
    "gsid.response.superposition.Superposition": "superposition",
    "gsid.diagnosis.torque_residual.TorqueResidual": "torque_residual",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"gsid.plots.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
