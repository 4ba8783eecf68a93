"""How often `gsid compare` rejects a right, fitted model on a record that its fit has not seen."""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import signal
from study import Cell, Study

sys.path.append(str(Path(__file__).resolve().parents[1] / "blind"))

import trials
import truth

from gsid.comparison import compare
from gsid.fitting.rational import fit
from gsid.greybox.fit import fit_plant
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.spectrum.realisation import spectra
from gsid.spectrum.spectra import Spectra

FS_HZ, N = 3000.0, 1500
LINES = np.arange(1, 96, 2)  # 2 to 190 Hz, odd: those between show what is not linear
RMS = 10.0
N_AXES = 40
EVERY = 10  # of so many seeds one serves to see that a wrong model is rejected
FRICTION = "coulomb_friction"
# Catalogue id -> its parameters' names in the simulator, by the catalogue's names.
STACK = {
    "rigid_body": {"gain": "gain"},
    "transport_delay": {"delay_s": "delay_s"},
    "viscous_friction": {"rate": "viscous_rate"},
    FRICTION: {"level": "coulomb_level"},
    "flexible_mode": {"f_hz": "mode_hz", "zeta": "mode_zeta", "residue": "mode_residue"},
}

Periods = tuple[np.ndarray, np.ndarray]


def multisine(rng: np.random.Generator, lines: np.ndarray, n: int) -> np.ndarray:
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    u = np.fft.irfft(spectrum, n)
    return u * RMS / np.std(u)


@functools.cache
def axis(number: int) -> tuple[dict[str, float], list[Periods]]:
    """An axis with friction, and its answers to two realisations, by the blind trials' own simulator."""
    rng = np.random.default_rng([number, 20261122])
    params = {
        "fs_hz": FS_HZ,
        "gain": rng.uniform(5, 20),
        "delay_s": rng.uniform(1e-3, 6e-3),
        "viscous_rate": rng.uniform(2, 8),
        "coulomb_level": rng.uniform(2, 8),
        "mode_hz": rng.uniform(110, 150),
        "mode_zeta": rng.uniform(0.01, 0.03),
        "mode_residue": rng.uniform(0.1, 0.4),
    }
    commands = [multisine(rng, LINES, N) for _ in range(2)]
    return params, [(u, truth.steady(params, u, tolerance=1e-6)[0]) for u in commands]


def stack(params: dict[str, float], without: str = "") -> PlantModel:
    effects = [
        {"effect": effect, "params": {name: params[ours] for name, ours in names.items()}}
        for effect, names in STACK.items()
        if effect != without
    ]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "y_unit": "deg/s", "effects": effects})


def noise(rng: np.random.Generator) -> trials.Noise:
    """Coloured gyro noise, its steps, and a rough part of unlisted origin; no sine, which is no noise."""
    return dataclasses.replace(trials.Noise.drawn(rng), fan=None)


def measured(rng: np.random.Generator, period: Periods, n_periods: int, gyro: trials.Noise) -> Spectra:
    u, y = period
    y = gyro.measured(rng, y, n_periods)
    return spectra(Record(np.tile(u, n_periods), y, FS_HZ, len(u), 0, hold="zoh", y_unit="deg/s"))


def beside(
    model: PlantModel | RationalModel, wrong: PlantModel | RationalModel, new: Spectra
) -> dict[str, bool]:
    """Whether the right model is rejected if its uncertainty is left out, and whether a wrong one is."""
    known_exactly = dataclasses.replace(model, cov=None)
    return {
        "rejected_if_its_uncertainty_is_left_out": not compare(known_exactly, new).adequate,
        "wrong_model_rejected": not compare(wrong, new).adequate,
    }


def plant(cell: Cell, seed: int) -> dict[str, float | bool]:
    """A stack of effects, as it is simulated, fitted from values that are up to 5 % off."""
    rng, (n_fit, n_new) = cell.rng(seed), cell.setting[1:]
    params, (first, second) = axis(seed % N_AXES)
    gyro = noise(rng)
    ours, new = measured(rng, first, n_fit, gyro), measured(rng, second, n_new, gyro)
    start = {name: value * rng.uniform(0.95, 1.05) for name, value in params.items()}
    model = fit_plant(stack(start), ours).model
    outcome = {"p_value": compare(model, new).p_value}
    if seed % EVERY == 1:
        outcome |= beside(model, fit_plant(stack(start, without=FRICTION), ours).model, new)
    return outcome


def rational_system(rng: np.random.Generator) -> Callable[[int], Spectra]:
    """Measure a held second-order system with a zero (scipy), output noise white or coloured, for periods."""
    n, lines, fs_hz = 500, np.arange(1, 61), 1000.0
    w0, zeta, gain = 2 * np.pi * rng.uniform(10, 30), rng.uniform(0.05, 0.3), rng.uniform(1, 5)
    system = [3 * gain * w0, gain * w0**2], [1, 2 * zeta * w0, w0**2]
    num, den, _ = signal.cont2discrete(system, 1 / fs_hz, "zoh")
    response = signal.freqz(num.ravel(), den, 2 * np.pi * np.arange(n // 2 + 1) / n)[1]
    colour = rng.uniform(0, 0.9)

    def answer(n_periods: int) -> Spectra:
        u = multisine(rng, lines, n)
        y = np.tile(np.fft.irfft(response * np.fft.rfft(u), n), n_periods)
        white = 10 * rng.standard_normal(len(y) + 300)
        y = y + signal.lfilter([1 - colour], [1, -colour], white)[300:]
        return spectra(Record(np.tile(u, n_periods), y, fs_hz, n, 0, hold="zoh"))

    return answer


def rational(cell: Cell, seed: int) -> dict[str, float | bool]:
    """A rational system; `gsid.fit`."""
    rng, (n_fit, n_new) = cell.rng(seed), cell.setting[1:]
    answer = rational_system(rng)
    ours, new = answer(n_fit), answer(n_new)
    response_of_ours = frf(ours)
    model = fit(response_of_ours, "2/1", delay="none")
    outcome = {"p_value": compare(model, new).p_value}
    if seed % EVERY == 1:
        outcome |= beside(model, fit(response_of_ours, "2/0", delay="none"), new)
    return outcome


def run(cell: Cell, seed: int) -> dict[str, float | bool]:
    return cell.setting[0](cell, seed)


STUDY = Study(
    name="compare_unseen",
    title="A correct, fitted model on a record outside its fit",
    about=(
        "A model of the correct form is fitted to one record and compared (`gsid compare`) with another "
        "realisation. Stacks of effects: a rigid body with viscous and Coulomb friction, a delay and "
        f"a mode, {N_AXES} axes drawn at random, simulated by the simulator of the blind trials, with "
        "coloured gyro noise, quantization, and an irregular part at -50 dB of the response. The fit "
        "starts up to 5 % off. Rejections after a wrong minimum are counted too. "
        "Rational models: a held second-order system with a zero, by scipy, with output noise from "
        "white to strongly coloured. One seed of ten also shows how often the same model is rejected "
        "if its uncertainty is left out, and how often a wrong model is rejected, without the Coulomb "
        "friction or without the zero."
    ),
    cells=tuple(
        Cell(f"{words}, {n_fit} periods fitted, {n_new} compared", (kind, n_fit, n_new))
        for words, kind in (("stack", plant), ("rational", rational))
        for n_fit, n_new in ((8, 8), (4, 16), (4, 40))
    ),
    run=run,
    levels=(0.05,),
    n_seeds=2000,
    n_short=12,
    confidence=0.99,
    window=(0.7, 1.3),
)
