"""gsid: measure a servo axis, fit a model, and find out where the two differ.

    record = gsid.read_record("rec.csv")
    response = gsid.frf(record)                       # Frf
    rational = gsid.fit(response, "4/3")              # RationalModel
    matrix = gsid.fit_mimo(gsid.frf_mimo(experiments), "8/8")  # MimoModel: common poles
    found = gsid.start(record)                        # Start: the linear structure of the axis
    plant = gsid.load_model("plant.json")             # PlantModel: a stack of effects
    gsid.compare(plant, [record]).plot()              # Comparison
    found = gsid.diagnose(plant, [record])            # Diagnosis
    better = gsid.add("coulomb_friction", plant, [record]).model

`gsid.effects` makes user-defined effects, for example `gsid.effects.expression(...)`. Each name is loaded
when it is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from gsid.base.errors import GsidError, InputError
from gsid.base.plottable import Plottable as _Plottable

if TYPE_CHECKING:  # the same names for editors and type checkers
    from gsid import effects as effects
    from gsid.comparison import Comparison as Comparison
    from gsid.comparison import compare as compare
    from gsid.comparison_mimo import MimoComparison as MimoComparison
    from gsid.comparison_mimo import compare_mimo as compare_mimo
    from gsid.diagnosis.add import Addition as Addition
    from gsid.diagnosis.add import add as add
    from gsid.diagnosis.from_records.diagnose import diagnose as diagnose
    from gsid.diagnosis.from_records.diagnose import diagnose_records as diagnose_records
    from gsid.diagnosis.from_records.result import Diagnosis as Diagnosis
    from gsid.diagnosis.from_records.result import RankedLaw as RankedLaw
    from gsid.diagnosis.ladder import Ladder as Ladder
    from gsid.diagnosis.ladder import Rung as Rung
    from gsid.diagnosis.ladder import undo as undo
    from gsid.diagnosis.torque_residual import TorqueResidual as TorqueResidual
    from gsid.diagnosis.torque_residual import torque_residual as torque_residual
    from gsid.excitation.multisine import Multisine as Multisine
    from gsid.fitting.mimo import fit_mimo as fit_mimo
    from gsid.fitting.order import OrderChoice as OrderChoice
    from gsid.fitting.order import select_order as select_order
    from gsid.fitting.rational import fit as fit
    from gsid.greybox.fit import PlantFit as PlantFit
    from gsid.greybox.fit import RecordFit as RecordFit
    from gsid.greybox.fit import fit_plant as fit_plant
    from gsid.models.load import load_model as load_model
    from gsid.models.mimo import MimoModel as MimoModel
    from gsid.models.piecewise import PiecewiseModel as PiecewiseModel
    from gsid.models.rational import RationalModel as RationalModel
    from gsid.plant.effect import Effect as Effect
    from gsid.plant.effect import Param as Param
    from gsid.plant.model import PlantModel as PlantModel
    from gsid.plant.periodic import Prediction as Prediction
    from gsid.prediction import PredictedOutput as PredictedOutput
    from gsid.prediction import predict as predict
    from gsid.records.files import read_record as read_record
    from gsid.records.files import write_record as write_record
    from gsid.records.mimo import MimoRecord as MimoRecord
    from gsid.records.mimo import read_mimo_record as read_mimo_record
    from gsid.records.mimo import write_mimo_record as write_mimo_record
    from gsid.records.part import cut as cut
    from gsid.records.position import Position as Position
    from gsid.records.position import position as position
    from gsid.records.record import Record as Record
    from gsid.response.distortion import Distortion as Distortion
    from gsid.response.estimate import frf as frf
    from gsid.response.estimate_distortion import distortion as distortion
    from gsid.response.frf import Frf as Frf
    from gsid.response.mimo import MimoFrf as MimoFrf
    from gsid.response.mimo import frf_mimo as frf_mimo
    from gsid.response.mimo_distortion import MimoDistortion as MimoDistortion
    from gsid.response.mimo_distortion import distortion_mimo as distortion_mimo
    from gsid.spectrum.noise import Noise as Noise
    from gsid.spectrum.noise import noise as noise
    from gsid.spectrum.realisation import spectra as spectra
    from gsid.spectrum.spectra import Spectra as Spectra
    from gsid.structure.start import Start as Start
    from gsid.structure.start import start as start
    from gsid.webpage.notebook import Studio as Studio
    from gsid.webpage.notebook import studio as studio

    __version__: str

_Plottable.drawn_by = "gsid.plots"  # loaded by the first plot(), with matplotlib

# Where each public name is defined.
_HOME = {
    "Addition": "diagnosis.add",
    "Comparison": "comparison",
    "Diagnosis": "diagnosis.from_records.result",
    "Distortion": "response.distortion",
    "Effect": "plant.effect",
    "Frf": "response.frf",
    "Ladder": "diagnosis.ladder",
    "MimoComparison": "comparison_mimo",
    "MimoDistortion": "response.mimo_distortion",
    "MimoFrf": "response.mimo",
    "MimoModel": "models.mimo",
    "MimoRecord": "records.mimo",
    "Multisine": "excitation.multisine",
    "Noise": "spectrum.noise",
    "OrderChoice": "fitting.order",
    "Param": "plant.effect",
    "PiecewiseModel": "models.piecewise",
    "PlantFit": "greybox.fit",
    "PlantModel": "plant.model",
    "Position": "records.position",
    "PredictedOutput": "prediction",
    "Prediction": "plant.periodic",
    "RationalModel": "models.rational",
    "RankedLaw": "diagnosis.from_records.result",
    "Record": "records.record",
    "RecordFit": "greybox.fit",
    "Rung": "diagnosis.ladder",
    "Spectra": "spectrum.spectra",
    "Start": "structure.start",
    "Studio": "webpage.notebook",
    "TorqueResidual": "diagnosis.torque_residual",
    "add": "diagnosis.add",
    "compare": "comparison",
    "compare_mimo": "comparison_mimo",
    "cut": "records.part",
    "diagnose": "diagnosis.from_records.diagnose",
    "diagnose_records": "diagnosis.from_records.diagnose",
    "distortion": "response.estimate_distortion",
    "distortion_mimo": "response.mimo_distortion",
    "fit": "fitting.rational",
    "fit_mimo": "fitting.mimo",
    "fit_plant": "greybox.fit",
    "frf": "response.estimate",
    "frf_mimo": "response.mimo",
    "load_model": "models.load",
    "noise": "spectrum.noise",
    "position": "records.position",
    "predict": "prediction",
    "read_mimo_record": "records.mimo",
    "read_record": "records.files",
    "select_order": "fitting.order",
    "spectra": "spectrum.realisation",
    "start": "structure.start",
    "studio": "webpage.notebook",
    "torque_residual": "diagnosis.torque_residual",
    "undo": "diagnosis.ladder",
    "write_mimo_record": "records.mimo",
    "write_record": "records.files",
}

__all__ = ["GsidError", "InputError", "__version__", "effects", *_HOME]


def __getattr__(name: str) -> Any:
    """Load a name when it is first used.

    `gsid --help` starts quickly, and `gsid doctor` can report why the C library does not load.
    """
    if name == "__version__":
        from gsid._lib import version

        return version()
    if name == "effects":
        return importlib.import_module("gsid.effects")
    if name not in _HOME:
        raise AttributeError(f"module 'gsid' has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(f"gsid.{_HOME[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
