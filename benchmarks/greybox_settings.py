"""Sweep of the numerical settings of the grey-box fit (`gsid.greybox.settings`); tables on stdout.

    .venv/bin/python benchmarks/greybox_settings.py [--axes 6] [--seed 1]

`make settings-study` runs it; docs/explanation/decisions.md has the results.

Random axes with friction (every second one), a structural mode and noise are fitted from starts 10 % off.
Each setting is then changed alone. The first table compares the estimates with those of the default
settings, in standard deviations, and counts iterations. The second table shows which sizes `silent` and
`singular` separate. The third table counts how often the linear start finds the resonance.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gsid.base.errors import GsidError
from gsid.excitation.multisine import Multisine
from gsid.greybox import fit, linear_start, problem, weights
from gsid.greybox.settings import SETTINGS
from gsid.plant.model import PlantModel
from gsid.plant.periodic import PeriodicPlant
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra
from gsid.spectrum.spectra import Spectra

FS_HZ, N, PERIODS, RECORDS = 3000.0, 1500, 4, 2
NOISE = 0.01  # of the output's rms
CHANGES = {
    "settled": (1e-3, 1e-1),
    "noise_floor": (1e-9, 1e-5),
    "decrease": (1e-4, 1.0),
    "damping_start": (1e-5, 1e-1),
    "damping_max": (1e7, 1e13),
    "start_tolerance": (1e-7, 1e-3),
    "start_evaluations_max": (20, 200),
    "silent": (1e-5, 1e-1),
    "singular": (1e-8, 1e-4),
}
STARTS = {
    "scan_spread": (0.05, 0.15, 0.3),
    "scan_step": (0.03, 0.1, 0.3, 1.0, 3.0),
    "response_floor": (1e-4, 1e-3, 1e-2),
    "start_tolerance": (1e-7, 1e-5, 1e-3),
    "start_evaluations_max": (20, 60, 200),
}
OFFSETS = (0.02, 0.05, 0.1, 0.14, 0.2, 0.3)  # of the resonance frequency, relative
MODE = "flexible_mode.f_hz"


@contextlib.contextmanager
def changed(**changes: float) -> Iterator[None]:
    """The settings with some of them changed, in every module of the fit."""
    modules = fit, linear_start, problem, weights
    for module in modules:
        module.SETTINGS = replace(SETTINGS, **changes)
    yield
    for module in modules:
        module.SETTINGS = SETTINGS


def plant(stack: dict[str, dict[str, float]]) -> PlantModel:
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": effects})


def axis(rng: np.random.Generator, *, friction: bool) -> PlantModel:
    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    stack = {
        "rigid_body": {"gain": between(300, 3000)},
        "viscous_friction": {"rate": between(3, 40)},
        "cable_spring": {"stiffness": between(50, 1000)},
        "transport_delay": {"delay_s": between(1e-3, 6e-3)},
        "flexible_mode": {
            "f_hz": between(60, 220),
            "zeta": between(0.005, 0.03),
            "residue": between(0.05, 0.3),
        },
    }
    if friction:
        stack["coulomb_friction"] = {"level": 0.005 * stack["rigid_body"]["gain"]}
    return plant(stack)


def measure(truth: PlantModel, rng: np.random.Generator) -> list[Spectra]:
    several = []
    for _ in range(RECORDS):
        seed = int(rng.integers(1 << 30))
        u = Multisine.design(
            FS_HZ, N, (2, 250), grid="odd", amplitude=0.05, phases="random", seed=seed
        ).table()
        y = np.tile(np.fft.irfft(PeriodicPlant(truth, u, FS_HZ).run().Y * N / 2), PERIODS)
        y = y + NOISE * np.std(y) * rng.standard_normal(len(y))
        several.append(spectra(Record(np.tile(u, PERIODS), y, FS_HZ, N, 0, hold="zoh", y_unit="deg/s")))
    return several


def off(truth: PlantModel, share: float, rng: np.random.Generator) -> PlantModel:
    return truth.with_values(truth.free_values * (1 + share * rng.choice([-1, 1], len(truth.free_values))))


def fitted(start: PlantModel, measured: list[Spectra]) -> fit.PlantFit:
    return fit.fit_plant(linear_start.linear_start(start, measured), measured)


def sweep(jobs: list[tuple[PlantModel, list[Spectra]]]) -> None:
    usual = [fitted(*job) for job in jobs]
    n = [one.n_iterations for one in usual]
    print(
        f"default settings: {sum(n)} iterations in {len(n)} fits, at most {max(n)}; largest cost per degree"
    )
    print(f"of freedom {max(one.cost_per_dof for one in usual):.3f}")
    print("setting                   value  iterations  at most  largest change [std]  not converged")
    for name, values in CHANGES.items():
        for value in values:
            with changed(**{name: value}):
                found = [fitted(*job) for job in jobs]
            moved = max(
                float(
                    np.max(np.abs(a.model.free_values - b.model.free_values) / np.sqrt(np.diag(b.model.cov)))
                )
                for a, b in zip(found, usual, strict=True)
            )
            n, failed = [one.n_iterations for one in found], sum(not one.converged for one in found)
            print(f"{name:24}{value:7g}{sum(n):12}{max(n):9}{moved:22.2g}{failed:15}", flush=True)


def separations(jobs: list[tuple[PlantModel, list[Spectra]]]) -> None:
    """Sizes that `silent` and `singular` separate, with and without parameters that the data lack."""
    lacking = {
        "constant torque": ("torque_bias", {"level": 1.0}),
        "fine quantization": ("drive_quantization", {"step": 1e-9}),
        "fast sensor lag": ("sensor_lag", {"time_constant_s": 1e-9}),
        "spring doubled by gravity": ("mass_unbalance", {"level": 50.0, "angle_deg": 0.0}),
    }
    print("added                        least influence        least singular value (relative)")
    for words, more in ("nothing", None), *lacking.items():
        influence, singular = [], []
        for start, measured in jobs:
            if more is not None and more[0] in [effect.id for effect in start.effects]:
                continue
            with changed(silent=0.0, singular=0.0), contextlib.suppress(GsidError):
                one = fit.fit_plant(start if more is None else start.with_effect(*more), measured, max_iter=1)
                lengths = np.linalg.norm(one.jacobian, axis=0)
                sizes = np.maximum(
                    np.abs(one.model.free_values),
                    [problem.least_size(one.model.parameter(name)) for name in one.model.free_names],
                )
                influence.append(np.min(lengths * sizes))
                s = np.linalg.svd(one.jacobian / np.where(lengths > 0, lengths, 1), compute_uv=False)
                singular.append(s[-1] / s[0])
        ends = [f"{min(values):8.1e} .. {max(values):8.1e}" for values in (influence, singular)]
        print(f"{words:28} {ends[0]}   {ends[1]}")


def starts(jobs: list[tuple[PlantModel, list[Spectra]]], truths: list[PlantModel]) -> None:
    """How often the linear start ends within 1 % of the resonance, by the offset of its start value."""
    print("found of", 2 * len(jobs), " " * 23, "".join(f"{100 * offset:6g} %" for offset in OFFSETS))
    for name, values in STARTS.items():
        for value in values:
            found = []
            for offset in OFFSETS:
                count = 0
                for (start, measured), truth in zip(jobs, truths, strict=True):
                    for sign in (-1, 1):
                        model = start.with_values(start.free_values)
                        model[MODE].value = truth[MODE].value * (1 + sign * offset)
                        with changed(**{name: value}):
                            ended = linear_start.linear_start(model, measured)
                        count += abs(ended[MODE].value / truth[MODE].value - 1) < 0.01
                found.append(count)
            print(f"{name:24}{value:9g}{'':3}", "".join(f"{count:8}" for count in found), flush=True)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--axes", type=int, default=6, help="number of random axes")
    arguments.add_argument("--seed", type=int, default=1, help="random seed")
    chosen = arguments.parse_args()
    print("seed", chosen.seed)
    rng = np.random.default_rng(chosen.seed)
    truths = [axis(rng, friction=bool(i % 2)) for i in range(chosen.axes)]
    jobs = [(off(truth, 0.1, rng), measure(truth, rng)) for truth in truths]
    sweep(jobs)
    separations(jobs)
    starts(jobs, truths)


if __name__ == "__main__":
    main()
