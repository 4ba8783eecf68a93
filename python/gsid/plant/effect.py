"""The parts of a plant: effects and the values of their parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gsid.effects.types import EffectType, find


@dataclass
class Param:
    """Value of a parameter; whether a fit may move it; its standard deviation, None when it was not
    estimated and NaN when the data do not determine it; limits of a fit, inside the catalogue's bounds."""

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
    """One effect of a stack: id, all its parameters by name, and its type when it is one of your own."""

    id: str
    params: dict[str, Param]
    own: EffectType | None = None

    @property
    def type(self) -> EffectType:
        """What it is: its entry in the catalogue, or one of your own."""
        return self.own or find(self.id)


class Stack(Protocol):
    """What a simulation needs of a `PlantModel`."""

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
        """The effects with their names, which differ where two are of one id."""
