"""gsid: measure a servo axis, fit a model, and see where the two differ.

    record = gsid.read_record("rec.csv")
    response = gsid.frf(record)                       # Frf
    rational = gsid.fit(response, "4/3")              # RationalModel
    matrix = gsid.fit_mimo(gsid.frf_mimo(experiments), "8/8")  # MimoModel: common poles
    plant = gsid.load_model("plant.json")             # PlantModel: a stack of effects
    gsid.compare(plant, [record]).plot()              # Comparison
    found = gsid.diagnose(plant, [record])            # Diagnosis
    better = gsid.add("coulomb_friction", plant, [record]).model

Names are loaded when they are first used. compare, diagnose, distortion, fit, frf, noise and spectra are
modules, too: `from gsid.compare import Comparison`. effects is one that has them all:
`gsid.effects.expression(...)`.
"""

import importlib
from typing import Any

from gsid.errors import GsidError, InputError

# Where the other public names live; a module of its own name can be called itself (gsid._callable).
_HOME = {
    "MimoRecord": "mimo",
    "Multisine": "excitation",
    "PlantModel": "plant",
    "RationalModel": "model",
    "Record": "record",
    "add": "ladder",
    "compare": None,
    "diagnose": None,
    "distortion": None,
    "effects": None,
    "fit": None,
    "fit_mimo": "mimo_fit",
    "fit_plant": "greybox",
    "frf": None,
    "frf_mimo": "mimo",
    "load_model": "model",
    "noise": None,
    "read_mimo_record": "mimo",
    "read_record": "io",
    "select_order": "order",
    "spectra": None,
    "torque_residual": "torque",
    "undo": "ladder",
    "write_record": "io",
}

__all__ = ["GsidError", "InputError", "__version__", *_HOME]


def __getattr__(name: str) -> Any:
    """Load what is asked for when it is first needed, so that `gsid --help` is quick and `gsid doctor` can
    say why the C library does not load."""
    if name == "__version__":
        from gsid._lib import version

        return version()
    if name not in _HOME:
        raise AttributeError(f"module 'gsid' has no attribute {name!r}")
    home = _HOME[name]
    module = importlib.import_module(f"gsid.{home or name}")
    return getattr(module, name) if home else module


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
