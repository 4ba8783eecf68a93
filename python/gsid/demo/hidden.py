"""Effect of the simulated axis that a random seed chooses, and the hash of the answer.

The answer is hashed before the search: the SHA-256 of its file is printed before the measurement. At the end,
`sha256sum` shows that the answer was not changed after the search.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Rng = np.random.Generator


@dataclass(frozen=True)
class Hidden:
    """The hidden effect.

    Attributes
    ----------
    effect : str
        Id of the catalogue.
    params : dict of float
        Parameters, with the names and units of the catalogue.
    seed : int
        Seed by which the effect was drawn.
    """

    effect: str
    params: dict[str, float]
    seed: int

    @property
    def answer(self) -> str:
        """Text of the file that is hashed. A salt prevents testing a guess by its hash."""
        salt = hashlib.sha256(f"gsid demo, hidden effect of seed {self.seed}".encode()).hexdigest()
        data = {"effect": self.effect, "params": self.params, "seed": self.seed, "salt": salt}
        return json.dumps(data, indent=1) + "\n"

    @property
    def sha256(self) -> str:
        """SHA-256 of the answer, in hexadecimal digits."""
        return hashlib.sha256(self.answer.encode()).hexdigest()


def _stribeck(rng: Rng) -> dict[str, float]:
    level = _between(rng, 2, 10)
    return {"level": level, "extra": level * rng.uniform(0.3, 1.0), "velocity": _between(rng, 0.3, 3)}


def _unbalance(rng: Rng) -> dict[str, float]:
    return {"level": _between(rng, 700, 1500), "angle_deg": rng.choice([-1, 1]) * rng.uniform(45, 80)}


def _cogging(rng: Rng) -> dict[str, float]:
    cycles = float(rng.integers(36, 253))
    return {"level": _between(rng, 3, 20), "cycles_per_rev": cycles, "phase_rad": rng.uniform(-3.1, 3.1)}


def _between(rng: Rng, low: float, high: float) -> float:
    """Uniform on a logarithmic scale."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


# Sizes that may remain unnoticed in a gimbal with 7.4 deg/s^2 per command and a travel of +-3 deg.
SIZES: dict[str, Callable[[Rng], dict[str, float]]] = {
    "drive_dead_zone": lambda rng: {"half_width": _between(rng, 0.3, 3)},
    "drive_saturation": lambda rng: {"limit": rng.uniform(60, 90)},
    "coulomb_friction": lambda rng: {"level": _between(rng, 1, 15)},
    "stribeck_friction": _stribeck,
    "quadratic_drag": lambda rng: {"rate": _between(rng, 0.01, 0.2)},
    "cubic_spring": lambda rng: {"stiffness": _between(rng, 1, 15)},
    "mass_unbalance": _unbalance,
    "motor_cogging": _cogging,
    "sensor_sample_hold": lambda rng: {"rate_hz": float(rng.choice([250, 300, 375, 400, 500, 600]))},
}


def draw(seed: int) -> Hidden:
    """Draw an effect and its size.

    Parameters
    ----------
    seed : int
        >= 0.

    Returns
    -------
    Hidden
    """
    rng = np.random.default_rng(seed)
    effect = str(rng.choice(list(SIZES)))
    return Hidden(effect, {name: float(f"{value:.4g}") for name, value in SIZES[effect](rng).items()}, seed)
