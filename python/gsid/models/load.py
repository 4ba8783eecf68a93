"""Read a model of any kind from its file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gsid.base.model_file import read_model_file
from gsid.models.rational import RationalModel

if TYPE_CHECKING:
    from gsid.models.mimo import MimoModel
    from gsid.models.piecewise import PiecewiseModel
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
        from gsid.plant.model import PlantModel

        return PlantModel.from_dict(data, str(path))
    if isinstance(data, dict) and "common_denominator" in data:
        from gsid.models.mimo import MimoModel

        return MimoModel.from_dict(data, str(path))
    if isinstance(data, dict) and "pieces" in data:
        from gsid.models.piecewise import PiecewiseModel

        return PiecewiseModel.from_dict(data, str(path))
    return RationalModel.from_dict(data, str(path))
