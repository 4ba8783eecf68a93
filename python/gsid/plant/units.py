"""Units of models against units of records: different units are refused, a missing unit matches any."""

from __future__ import annotations

import math
from typing import Protocol

from gsid.base.errors import InputError
from gsid.plant.effect import Stack
from gsid.spectrum.spectra import Spectra

RADIANS = {"deg": math.pi / 180, "rad": 1.0, "m": 1.0}
# Units of outputs that a plant can have. A record in another unit (counts, V) is accepted.
OUTPUTS = {unit + per for unit in RADIANS for per in ("", "/s")}

KIND_OF_UNIT = (("/s^2", "acceleration"), ("/s2", "acceleration"), ("/s", "rate"))
"""Endings of units of y that name what it is."""


def kind_of_unit(unit: str) -> str | None:
    """What y is by its unit; None where the unit does not tell.

    Parameters
    ----------
    unit : str
    """
    for ending, kind in KIND_OF_UNIT:
        if unit.endswith(ending):
            return kind
    return "angle" if unit in {*RADIANS, "mm", "um", "mrad"} else None


class WithUnits(Protocol):
    """A model that names the units of its input and output."""

    u_unit: str
    y_unit: str


def check_units(model: WithUnits, measured: Spectra) -> None:
    """Refuse a record whose units differ from those of the model. A missing unit matches any.

    Parameters
    ----------
    model : PlantModel or RationalModel
    measured : Spectra

    Raises
    ------
    InputError
    """
    for what in ("u_unit", "y_unit"):
        own, other = getattr(model, what), getattr(measured, what)
        if own and other and own != other:
            hint = f'measure or convert to the model\'s unit, or correct "{what}" of the model'
            raise InputError(
                f"{what} of the record is not the model's", measured.name, f"{other} and {own}", hint
            )


def check_plant_units(model: Stack, measured: Spectra) -> None:
    """As :func:`check_units`; also check that the output and the tables are in the plant's unit of angle.

    Parameters
    ----------
    model : PlantModel
    measured : Spectra

    Raises
    ------
    InputError
    """
    check_units(model, measured)
    unit = model.angle_unit + ("/s" if model.output == "rate" else "")
    if measured.y_unit in OUTPUTS and measured.y_unit != unit:
        hint = 'set "output" and "angle_unit" of the model to what was measured'
        both = f"{measured.y_unit} and {unit}"
        raise InputError("the record's unit is not the model's", measured.name, both, hint)
    units = {"w": f"{model.angle_unit}/s", "theta": model.angle_unit, "u": model.u_unit or measured.u_unit}
    for label, effect in model.labels():
        own, wanted = (effect.type.definition.get(key) for key in ("unit", "variable"))
        wanted = units.get(wanted)
        if own and wanted and own != wanted:
            hint = "convert its columns, or correct the unit that the table states"
            raise InputError("the unit of the table is not the model's", label, f"{own} and {wanted}", hint)
