"""Parts of a plant: effects and the values of their parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gsid.effects.types import EffectType, find


@dataclass
class Param:
    """Value of a parameter.

    Parameters
    ----------
    value : float
    free : bool
        Whether a fit may change the value.
    std : float or None
        Standard deviation of the value; None if it was not estimated, NaN if the data do not determine it.
    limits : (lo, hi) or None
        Limits of a fit, inside the catalogue's bounds.
    """

    value: float
    free: bool = True
    std: float | None = None
    limits: tuple[float, float] | None = None

    def __str__(self) -> str:
        if not self.free:
            return f"{self.value:.6g} (fixed)"
        if self.std is None:
            return f"{self.value:.6g}"
        return (
            f"{self.value:.6g} +- {self.std:.2g}"
            if math.isfinite(self.std)
            else f"{self.value:.6g} (undetermined)"
        )


@dataclass
class Effect:
    """One effect of a stack.

    Parameters
    ----------
    id : str
        Id of the catalogue, or of the user-defined effect.
    params : dict of Param
        All its parameters by name.
    own : EffectType or None
        The type of a user-defined effect; None for an effect of the catalogue.
    """

    id: str
    params: dict[str, Param]
    own: EffectType | None = None

    @property
    def type(self) -> EffectType:
        """Its entry in the catalogue, or its own type if it is user-defined."""
        return self.own or find(self.id)


class Stack(Protocol):
    """The part of `PlantModel` that a simulation needs."""

    fs_hz: float
    effects: list[Effect]
    output: str
    angle_unit: str
    u_unit: str
    y_unit: str

    @property
    def has_controller(self) -> bool:
        """Whether the loop is simulated closed."""

    @property
    def free_values(self) -> np.ndarray:
        """(n_free,) values of the free parameters."""

    def labels(self) -> list[tuple[str, Effect]]:
        """The effects with their labels, which differ for two effects of the same id."""
