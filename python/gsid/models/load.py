"""Read a model of any kind from its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gsid.base.errors import InputError
from gsid.base.model_file import read_model_file
from gsid.models.mimo import MimoModel
from gsid.models.piecewise import PiecewiseModel
from gsid.models.rational import RationalModel
from gsid.models.rational_stack import stack_of
from gsid.plant.model import OUTPUTS, PlantModel
from gsid.plant.units import kind_of_unit


def load_model(path: str | Path) -> RationalModel | PiecewiseModel | MimoModel | PlantModel:
    """Read a model file of any kind: a transfer function, a set or a matrix of them, or a stack of effects.

    Raises
    ------
    InputError
        The file cannot be read, is not JSON, or is not a model.
    """
    data = read_model_file(path)
    if isinstance(data, dict) and "linear" in data:
        return _with_rational(data, str(path))
    if isinstance(data, dict) and "effects" in data:
        return PlantModel.from_dict(data, str(path))
    if isinstance(data, dict) and "common_denominator" in data:
        return MimoModel.from_dict(data, str(path))
    if isinstance(data, dict) and "pieces" in data:
        return PiecewiseModel.from_dict(data, str(path))
    return RationalModel.from_dict(data, str(path))


def load_single(path: str | Path) -> RationalModel | PiecewiseModel | PlantModel:
    """Read a model of one input and one output, of any kind.

    Raises
    ------
    InputError
        The file cannot be read, or the model is a matrix of responses.
    """
    model = load_model(path)
    if isinstance(model, MimoModel):
        what = "a model of one input and one output is required here"
        hint = "fit one pair of channels: gsid fit --u u1 --y y1"
        raise InputError(what, str(path), f"{model.n_y} x {model.n_u} responses", hint)
    return model


def load_plant(path: str | Path) -> PlantModel:
    """Read a model that is a stack of effects, or a transfer function as the stack that has its response.

    Raises
    ------
    InputError
        The file cannot be read, or the model is a matrix or a set of transfer functions, or one whose output
        is not known, or on which laws cannot act.
    """
    model = load_model(path)
    if isinstance(model, RationalModel):
        return stack_of(model, _output_of(model, str(path)), str(path))
    if not isinstance(model, PlantModel):
        hint = "write a model file that lists effects; `gsid effects` shows their names and parameters"
        raise InputError("a set of transfer functions has no physical effects", str(path), None, hint)
    return model


def _output_of(model: RationalModel, where: str) -> str:
    """What y of a fitted transfer function is, by its unit."""
    kind = kind_of_unit(model.y_unit)
    if kind is None or kind not in OUTPUTS:
        hint = 'put its "rational" into "linear": {"rational": ...} and add "output": "rate" or "angle"'
        what = "laws act on a rate or an angle, and the unit of y names neither"
        raise InputError(what, where, model.y_unit or None, hint)
    return kind


def _with_rational(data: dict[str, Any], where: str) -> PlantModel:
    """A model whose linear part is rational, with the laws that it lists."""
    linear, entries = data["linear"], data.get("effects", [])
    if not isinstance(linear, dict) or list(linear) != ["rational"]:
        hint = 'write "linear": {"rational": {"num": [...], "den": [...], ...}}, as `gsid fit` does'
        raise InputError("the linear part is not a rational one", where, None, hint)
    if not isinstance(entries, list):
        raise InputError("effects is not a list", where, None, 'write "effects": [] for none')
    output = data.get("output", "rate")
    if output not in OUTPUTS:
        raise InputError(f"output must be one of {', '.join(OUTPUTS)}", where, output)
    own = ("linear", "effects", "output", "angle_unit")
    common = {key: value for key, value in data.items() if key not in own}
    rational = RationalModel.from_dict(common | {"rational": linear["rational"]}, where)
    known = stack_of(rational, output, where).to_dict()
    if "angle_unit" in data:
        known["angle_unit"] = data["angle_unit"]
    return PlantModel.from_dict(known | {"effects": known["effects"] + entries}, where)
