"""Units of models against units of records: different units are refused, a missing unit matches any."""

from __future__ import annotations

import math
from typing import Protocol

from gsid.base.errors import InputError
from gsid.effects.types import find
from gsid.plant.effect import Stack
from gsid.spectrum.spectra import Spectra

RADIANS = {"deg": math.pi / 180, "rad": 1.0, "m": 1.0}
# Units of outputs that a plant can have. A record in another unit (counts, V) is accepted.
OUTPUTS = {unit + per for unit in RADIANS for per in ("", "/s")}

TURNING = {"mrad", "urad", "arcmin", "arcsec", "rev", "turn", "turns", "grad", "gon"}
"""Units of angles that a model cannot have: values are in degrees of this unit."""
TRAVELS = {"m", "mm", "um", "nm", "cm", "in"}

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
    return "angle" if unit in {*RADIANS, *TURNING, *TRAVELS} else None


def angle_unit_of(y_unit: str) -> str:
    """Unit of angle of a model whose output has a unit; "m" for an axis that does not turn.

    Parameters
    ----------
    y_unit : str
        Of an angle or travel, of its rate or acceleration, or of something else, such as V; "" is taken for
        degrees.
    """
    unit = y_unit.partition("/")[0]
    if unit in RADIANS:
        return unit
    return "m" if unit and unit not in TURNING else "deg"


TORQUES = {
    "deg/s^2": ("N m", 1),
    "deg/s^2 per command": ("N m per command", 1),
    "1/s": ("N m s/rad", 0),
    "1/s^2": ("N m/rad", 0),
    "1/deg": ("N m s^2/rad^2", -1),
    "1/(s^2 deg)": ("N m/rad^2", -1),
    "1/(s^2 deg^2)": ("N m/rad^3", -2),
}
"""Units of parameters over the inertia: the unit with it, and the power of the unit of angle in rad."""
NOT_OVER_INERTIA = {("presliding_friction", "stiffness"), ("bouc_wen", "unloading"), ("bouc_wen", "loading")}
"""Shapes of hysteresis, in the units of a torque."""


def torque_of(
    effect: str, name: str, value: float, inertia_kg_m2: float, angle_unit: str = "deg"
) -> tuple[float, str] | None:
    """A parameter that is divided by the inertia, multiplied by it.

    Parameters
    ----------
    effect, name : str
        Of the catalogue.
    value : float
        In the catalogue's unit, with `angle_unit` for degrees.
    inertia_kg_m2 : float
        In kg m^2.
    angle_unit : {"deg", "rad"}

    Returns
    -------
    value : float
    unit : str
        In newton metres and radians. None: the parameter is not over the inertia.
    """
    known = find(effect)
    found = TORQUES.get(known[name].unit)
    if known.stage != "torque" or found is None or (effect, name) in NOT_OVER_INERTIA:
        return None
    unit, power = found
    return value * inertia_kg_m2 * RADIANS[angle_unit] ** power, unit


def torque_text(
    effect: str, name: str, value: float, inertia_kg_m2: float | None, angle_unit: str, u_unit: str = ""
) -> str:
    """As `torque_of`, to print; empty: nothing to print.

    Parameters
    ----------
    effect, name, value, inertia_kg_m2, angle_unit
        As of `torque_of`; None: the inertia is not known.
    u_unit : str
    """
    if inertia_kg_m2 is None or angle_unit not in ("deg", "rad"):
        return ""
    found = torque_of(effect, name, value, inertia_kg_m2, angle_unit)
    if found is None:
        return ""
    return f"{found[0]:.5g} {found[1]}".replace("per command", f"per {u_unit or 'command'}")


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
