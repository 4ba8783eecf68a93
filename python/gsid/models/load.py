"""Read a model of any kind from its file."""

from __future__ import annotations

from pathlib import Path

from gsid.base.errors import InputError
from gsid.base.model_file import read_model_file
from gsid.models.mimo import MimoModel
from gsid.models.piecewise import PiecewiseModel
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel


def load_model(path: str | Path) -> RationalModel | PiecewiseModel | MimoModel | PlantModel:
    """Read a model file of any kind: a transfer function, a set or a matrix of them, or a stack of effects.

    Raises
    ------
    InputError
        The file cannot be read, is not JSON, or is not a model.
    """
    data = read_model_file(path)
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
    """Read a model that is a stack of effects.

    Raises
    ------
    InputError
        The file cannot be read, or the model is a fitted transfer function.
    """
    model = load_model(path)
    if not isinstance(model, PlantModel):
        hint = "write a model file that lists effects; `gsid effects` shows their names and parameters"
        raise InputError("a fitted transfer function has no physical effects", str(path), None, hint)
    return model
