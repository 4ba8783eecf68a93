"""A simulated axis from a file: a model, or the parameters that `gsid simulate --truth` wrote."""

from __future__ import annotations

import math
from pathlib import Path

from gsid.base.errors import InputError
from gsid.base.json_files import read_json
from gsid.models.load import load_plant
from gsid.plant.model import PlantModel
from gsid.rig.axis import HIDDEN, parameter_types

LINEAR = {
    "rigid_body": {"gain": "gain"},
    "viscous_friction": {"rate": "viscous_rate"},
    "cable_spring": {"stiffness": "spring_stiffness"},
    "transport_delay": {"delay_s": "delay_s"},
    "flexible_mode": {"f_hz": "mode_f_hz", "zeta": "mode_zeta", "residue": "mode_residue"},
    "sensor_lag": {"time_constant_s": "gyro_lag_s"},
    "motor_lag": {"time_constant_s": "gyro_lag_s"},  # in a linear axis the place of a lag does not matter
}
NOTHING_ELSE = {
    "viscous_rate": 0.0,
    "spring_stiffness": 0.0,
    "delay_s": 0.0,
    "mode_residue": 0.0,
    "gyro_lag_s": 0.0,
    "command_limit": 0.0,  # neither clipped nor rounded
}


def axis_parameters(path: str | Path) -> dict[str, float]:
    """Parameters of the simulated axis in a file.

    Parameters
    ----------
    path : path_like
        A model of a rate in deg/s, or the JSON of `gsid simulate --truth`.

    Returns
    -------
    dict of float
        By their names in `SimulatedAxis`. An axis of a model has its effects only, and the default noise.

    Raises
    ------
    InputError
        It is neither, or the simulated axis lacks an effect of the model.
    """
    found = read_json(path)
    if isinstance(found, dict) and isinstance(found.get("parameters"), dict):
        return _stated(found["parameters"], str(path))
    return parameters_of(load_plant(path), str(path))


def _stated(parameters: dict[str, object], where: str) -> dict[str, float]:
    known, stated = parameter_types(), {}
    for name, value in parameters.items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if name not in known or not is_number:
            hint = "give a file of `gsid simulate --truth`, or a model"
            raise InputError("not a parameter of the simulated axis", f"{where} {name}", value, hint)
        stated[name] = float(value)
    return stated


def parameters_of(model: PlantModel, where: str = "") -> dict[str, float]:
    """Parameters of the simulated axis that give it the effects of a model, and no others.

    Parameters
    ----------
    model : PlantModel
    where : str
        File, for messages.

    Raises
    ------
    InputError
        The output is not a rate in deg/s, or the axis lacks an effect.
    """
    if model.output != "rate" or model.angle_unit != "deg":
        found = f"{model.output}, {model.angle_unit}"
        raise InputError("the simulated axis has a rate in deg/s", where, found, "choose another model")
    fields = LINEAR | HIDDEN
    has_law = any(effect.id in HIDDEN for effect in model.effects)
    values = dict(NOTHING_ELSE) | {"fs_hz": model.fs_hz}
    taken: set[str] = set()
    for label, effect in model.labels():
        is_there = effect.id in fields and not (effect.id == "motor_lag" and has_law)
        names = fields[effect.id] if is_there else {}
        own = {names[name]: one.value for name, one in effect.params.items() if is_there}
        if not is_there or taken & own.keys():
            hint = f"leave it out; the axis has one each of {', '.join(fields)}; motor_lag without a law"
            raise InputError("the simulated axis does not have this effect", where, label, hint)
        taken |= own.keys()
        values |= own
    return values
