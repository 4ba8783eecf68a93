"""How often `gsid.add` reports that the error falls though the model comes no nearer to the truth."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter
from study import Cell, Study

from gsid.diagnosis.add import add
from gsid.diagnosis.error_fall import fall_p_value
from gsid.plant.model import PlantModel
from gsid.records.record import Record

FS_HZ, N = 500.0, 500
LINE = np.arange(1, 41)
GAIN, RATE = 7.4, 11.0  # of the true axis: a rigid body with viscous friction
NOISE = 0.05
DOUBT = 0.02  # how far each model's gain is off, where both are as far


def run(cell: Cell, seed: int) -> float:
    """P-value of the fall in one experiment."""
    rng = cell.rng(seed)
    if "effect" in cell.setting:
        return added(rng, **cell.setting)
    return as_far_off(rng, **cell.setting)


def added(rng: np.random.Generator, effect: str, records: int, periods: int) -> float:
    """Of an effect that the axis does not have, added by `gsid.add`."""
    measured = [record(rng, periods) for _ in range(records)]
    rung = add(effect, plant(GAIN * 1.03, RATE * 0.97), measured).rung
    assert rung.judged_on == ("not_fitted" if records > 2 else "later_periods")
    return rung.fall_p_value if rung.held_out["after"] < rung.held_out["before"] else 1.0


def as_far_off(rng: np.random.Generator, levels: list[float], periods: int, colour: float) -> float:
    """Of two models whose gains are too large and too small by the same: the least favourable null."""
    from gsid.spectrum.realisation import spectra_of

    measured = spectra_of([record(rng, periods, level, colour) for level in levels])
    return fall_p_value(plant(GAIN * (1 + DOUBT), RATE), plant(GAIN * (1 - DOUBT), RATE), measured)


def plant(gain: float, rate: float) -> PlantModel:
    stack = {"rigid_body": {"gain": gain}, "viscous_friction": {"rate": rate}}
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": effects})


def record(rng: np.random.Generator, periods: int, level: float = 1.0, colour: float = 0.0) -> Record:
    """Settled periods of the axis: dw/dt = GAIN u - RATE w, whose answer to a held command is exact."""
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[LINE] = level * N / 2 / 6 * np.exp(2j * np.pi * rng.random(len(LINE)))
    u = np.fft.irfft(spectrum, N)
    pole = np.exp(-RATE / FS_HZ)
    y = lfilter([0.0, GAIN / RATE * (1 - pole)], [1.0, -pole], np.tile(u, periods + 10))[-periods * N :]
    noise = lfilter([1.0], [1.0, -colour], rng.standard_normal(len(y) + N))[N:]
    return Record(np.tile(u, periods), y + NOISE * noise, FS_HZ, N, 0, hold="zoh")


ABOUT = """`gsid add` judges on data that the fit left out, and reports a fall of the error if its p-value
is at most 5 %. "As far off": two models whose gains are 2 % too large and 2 % too small, so that neither is
closer to the truth. "Added": `gsid.add` adds an effect that the axis does not have. On average that
makes the model worse, so the level is a bound. The axis is a rigid body with viscous friction,
filtered by scipy. The noise is white, or has a pole at 0.9 ("coloured")."""

STUDY = Study(
    name="error_falls",
    title="Ladder: a fall of the error on data outside the fit",
    about=ABOUT,
    cells=(
        Cell("as far off, P 2", {"levels": [1.0], "periods": 2, "colour": 0.0}),
        Cell("as far off, P 8", {"levels": [1.0], "periods": 8, "colour": 0.0}),
        Cell("as far off, P 2, two levels, coloured", {"levels": [1.0, 3.0], "periods": 2, "colour": 0.9}),
        Cell("as far off, P 4, coloured", {"levels": [1.0], "periods": 4, "colour": 0.9}),
        Cell(
            "added coulomb_friction, 3 records, P 4",
            {"effect": "coulomb_friction", "records": 3, "periods": 4},
            at_most=True,
        ),
        Cell(
            "added cable_spring, 3 records, P 4",
            {"effect": "cable_spring", "records": 3, "periods": 4},
            at_most=True,
        ),
        Cell(
            "added cable_spring, 1 record, P 8",
            {"effect": "cable_spring", "records": 1, "periods": 8},
            at_most=True,
        ),
    ),
    run=run,
    levels=(0.01, 0.05),
    n_seeds=500,
    n_short=8,
)
