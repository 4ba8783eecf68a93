"""The demo's second half: a seed hides an effect in the simulated axis; it is looked for, added, and revealed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid.compare import Comparison, compare
from gsid.diagnose import Diagnosis, diagnose
from gsid.excitation import Multisine
from gsid.frf import Spectra
from gsid.hidden import Hidden
from gsid.ladder import Ladder, add, ladder
from gsid.plant import Effect, Param, PlantModel
from gsid.report import Report, Truth
from gsid.simulate import SimulatedAxis

LEVELS = (8.0, 25.0)  # command of the first line; the larger one moves the axis by 2 deg
SHAPE_DB = -10.0  # per decade: springs and gravity only show where the axis travels, below 2 Hz
REALISATIONS = 3  # of each level; the last one is kept out of every fit
BAND_HZ = (0.5, 194.5)  # below the fastest gyro's half rate
WRONG_BY = 0.05  # every value that is believed
FLOOR_RATIO = 1.1  # held-out error over noise

# What is believed of the axis: parameters of the catalogue, and what the simulated axis calls them.
BELIEVED = {
    "rigid_body": {"gain": "gain"},
    "viscous_friction": {"rate": "viscous_rate"},
    "cable_spring": {"stiffness": "spring_stiffness"},
    "transport_delay": {"delay_s": "delay_s"},
    "flexible_mode": {"f_hz": "mode_f_hz", "zeta": "mode_zeta", "residue": "mode_residue"},
    "sensor_lag": {"time_constant_s": "gyro_lag_s"},
}


@dataclass(eq=False)
class Search:
    """What was found in the records of an axis with something hidden in it.

    Attributes
    ----------
    comparison : Comparison
        Of what is believed, its parameters fitted, on the records fitted.
    diagnosis : Diagnosis
    model : PlantModel
        With the effects found.
    """

    comparison: Comparison
    diagnosis: Diagnosis
    model: PlantModel

    @property
    def ladder(self) -> Ladder:
        """From what was believed to the model."""
        return ladder(self.model)


def excitations(fs_hz: float, period: int, seed: int) -> list[Multisine]:
    """Odd random-phase multisines, low level first."""
    return [
        Multisine.design(
            fs_hz,
            period,
            BAND_HZ,
            grid="odd",
            phases="random",
            seed=seed + i * REALISATIONS + j,
            amplitude=level,
            shape_db_per_decade=SHAPE_DB,
        )
        for i, level in enumerate(LEVELS)
        for j in range(REALISATIONS)
    ]


def believed(fs_hz: float, seed: int) -> PlantModel:
    """The axis without anything hidden, each value off by 5 %, up or down as the seed has it."""
    rng = np.random.default_rng(seed)
    true = SimulatedAxis().parameters
    return PlantModel(
        fs_hz,
        [
            Effect(effect, {p: Param(true[of] * (1 + WRONG_BY * rng.choice([-1, 1]))) for p, of in names.items()})
            for effect, names in BELIEVED.items()
        ],
        u_unit="command",
        y_unit="deg/s",
    )


def search(
    model: PlantModel, fitted: Sequence[Spectra], kept_out: Sequence[Spectra], on_step: Callable[[str], None]
) -> Search:
    """Compare, diagnose, and add what is found; the records kept out only judge.

    Parameters
    ----------
    model : PlantModel
        What is believed.
    fitted, kept_out : sequence of Spectra
    on_step : callable
        Told in words what comes next.
    """
    diagnosis = diagnose(model, fitted, on_step=on_step)
    comparison = compare(diagnosis.steps[0].fit.model, fitted)
    for group in diagnosis.found:
        model = add(group.effects[0], model, fitted, held_out=kept_out, on_step=on_step).model
    return Search(comparison, diagnosis, model)
