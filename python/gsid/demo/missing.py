"""Second half of the demo: hide an effect in the axis, search for it, add it, and show the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid.base.files import write_atomically
from gsid.comparison import Comparison, compare
from gsid.demo.axis import FS_HZ, PERIOD, Bench
from gsid.demo.hidden import Hidden, draw
from gsid.diagnosis.add import add
from gsid.diagnosis.from_records.diagnose import diagnose
from gsid.diagnosis.from_records.result import Diagnosis
from gsid.diagnosis.ladder import Ladder, ladder
from gsid.excitation.multisine import Multisine
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.report import Report, Truth
from gsid.rig.axis import SimulatedAxis
from gsid.spectrum.realisation import spectra
from gsid.spectrum.spectra import Spectra

LEVELS = (15.0, 45.0)  # command of the first line; the larger one moves the axis by 3 deg
SHAPE_DB = -15.0  # per decade: springs and gravity only show where the axis travels, below 2 Hz
BAND_HZ = (0.5, 194.5)
PERIODS = 8  # not a multiple of 5, as in the first half
FITTED, KEPT_OUT = 2, 2  # realisations of each level; the error on four kept out scatters by 4 % of the noise
PARAMETER_ERROR = 0.05  # relative error of each parameter of the initial model
FLOOR_RATIO = 1.1  # largest error on the records kept out, relative to noise alone

# Initial model of the axis: parameters of the catalogue, and their names in the simulated axis.
INITIAL_MODEL = {
    "rigid_body": {"gain": "gain"},
    "viscous_friction": {"rate": "viscous_rate"},
    "cable_spring": {"stiffness": "spring_stiffness"},
    "transport_delay": {"delay_s": "delay_s"},
    "flexible_mode": {"f_hz": "mode_f_hz", "zeta": "mode_zeta", "residue": "mode_residue"},
    "sensor_lag": {"time_constant_s": "gyro_lag_s"},
}
TURNS = {"phase_rad": 2 * np.pi, "angle_deg": 360.0}  # parameters that repeat


@dataclass(eq=False)
class Search:
    """Result of the search in the records of an axis with a hidden effect.

    Attributes
    ----------
    hidden : Hidden
        The answer, which the search did not use.
    fitted : list of Spectra
    comparison : Comparison
        Comparison of the initial model, its parameters fitted, with the fitted records.
    diagnosis : Diagnosis
    model : PlantModel
        Model with the effects found.
    """

    hidden: Hidden
    fitted: list[Spectra]
    comparison: Comparison
    diagnosis: Diagnosis
    model: PlantModel

    @property
    def ladder(self) -> Ladder:
        """Steps from the initial model to the final one."""
        return ladder(self.model)

    @property
    def named(self) -> bool:
        """Whether the hidden effect is in the first group found."""
        return bool(self.diagnosis.found) and self.hidden.effect in self.diagnosis.found[0]

    @property
    def over_floor(self) -> float:
        """Error of the model on the records kept out, relative to noise alone."""
        if not self.ladder.rungs:
            return np.inf
        last = self.ladder.rungs[-1]
        return last.held_out["after"] / last.noise_floor_rms

    @property
    def answer_sentence(self) -> str:
        """The answer, and whether it was found, as a sentence."""
        hidden = Effect(
            self.hidden.effect, {name: Param(value) for name, value in self.hidden.params.items()}
        )
        params = ", ".join(
            f"{name} {p.value:g} {self.model.unit_of(hidden, name)}".rstrip()
            for name, p in hidden.params.items()
        )
        if not self.named:
            found = " and ".join(" or ".join(effects) for effects in self.diagnosis.found) or "nothing"
            end = f"it was NOT named; {found} was named"
        else:
            rivals = [effect for effect in self.diagnosis.found[0] if effect != self.hidden.effect]
            tied = (
                f", together with {' and '.join(rivals)}, which these data cannot distinguish from it"
                if rivals
                else ""
            )
            end = f"it was named{tied}"
        return f"The hidden effect was {self.hidden.effect} ({params}): {end}."

    def compared_with_truth(self) -> list[Truth]:
        """True and estimated parameters of the hidden effect; empty if it was not added to the model."""
        rows = []
        for effect in self.model.effects:
            if effect.id != self.hidden.effect:
                continue
            for name, true in self.hidden.params.items():
                p, turn = effect.params[name], TURNS.get(name, np.inf)
                value = p.value if np.isinf(turn) else p.value + turn * np.round((true - p.value) / turn)
                std = np.nan if p.std is None else p.std
                rows.append(Truth(f"{effect.id}.{name}", self.model.unit_of(effect, name), true, value, std))
        return rows

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid demo --json`."""
        return {
            "sha256": self.hidden.sha256,
            "effect": self.hidden.effect,
            "params": self.hidden.params,
            "named": self.named,
            "held_out_over_noise": self.over_floor,
            "compare": self.comparison.to_dict(),
            "diagnosis": self.diagnosis.to_dict(),
            "ladder": [rung.to_dict() for rung in self.ladder.rungs],
        }


def find_hidden_effect(bench: Bench, seed: int) -> Search:
    """Hide an effect, measure, search, and write the file with the answer at the end."""
    hidden = draw(seed)
    answer = bench.folder / "hidden.json"
    answer.unlink(missing_ok=True)
    bench.on_step(f"hidden: an effect drawn by seed {seed}; SHA-256 of the answer {hidden.sha256}")
    measured = []
    seeds = np.random.SeedSequence(seed).generate_state(len(LEVELS) * (FITTED + KEPT_OUT))
    for i, excitation in enumerate(excitations(seeds), 1):
        bench.on_step(f"hidden: exciting the axis over the serial line, realisation {i} of {len(seeds)}")
        record = bench.measure(
            f"hidden{i}",
            excitation,
            PERIODS,
            seed=int(seeds[i - 1]),
            effect=hidden.effect,
            params=hidden.params,
        )
        measured.append(spectra(record))
    each = FITTED + KEPT_OUT
    fitted = [one for i, one in enumerate(measured) if i % each < FITTED]
    kept_out = [one for i, one in enumerate(measured) if i % each >= FITTED]
    model = initial_model(seed)
    model.save(bench.folder / "initial_model.json")
    found = search(model, fitted, kept_out, bench.on_step)
    found[-1].save(bench.folder / "found.json")
    write_atomically(answer, lambda part: part.write_text(hidden.answer, encoding="utf-8"))
    return Search(hidden, fitted, *found)


def excitations(seeds: Sequence[int]) -> list[Multisine]:
    """Odd random-phase multisines, one of each seed, low level first."""
    levels = np.repeat(LEVELS, len(seeds) // len(LEVELS))
    return [
        Multisine.design(
            FS_HZ,
            PERIOD,
            BAND_HZ,
            grid="odd",
            phases="random",
            seed=int(seed),
            amplitude=level,
            shape_db_per_decade=SHAPE_DB,
        )
        for seed, level in zip(seeds, levels, strict=True)
    ]


def initial_model(seed: int) -> PlantModel:
    """Model of the axis without the hidden effect, each parameter wrong by 5 %, with a random sign."""
    rng = np.random.default_rng(seed)
    true = SimulatedAxis().parameters
    return PlantModel(
        FS_HZ,
        [
            Effect(
                id,
                {
                    name: Param(true[of] * (1 + PARAMETER_ERROR * rng.choice([-1, 1])))
                    for name, of in names.items()
                },
            )
            for id, names in INITIAL_MODEL.items()
        ],
        u_unit="command",
        y_unit="deg/s",
    )


def search(
    model: PlantModel, fitted: list[Spectra], kept_out: list[Spectra], on_step: Callable[[str], None]
) -> tuple[Comparison, Diagnosis, PlantModel]:
    """Compare, diagnose, and add the effects found; the records kept out are used for validation only."""
    diagnosis = diagnose(model, fitted, on_step=lambda text: on_step(f"hidden: {text}"))
    comparison = compare(diagnosis.linear, fitted, fitted=True)
    for effect, *_ in diagnosis.found:
        on_step(f"hidden: adding {effect}")
        model = add(effect, model, fitted, held_out=kept_out).model
    return comparison, diagnosis, model


def add_to(page: Report, found: Search) -> None:
    """Add the search to the page."""
    story = (
        f"One effect of the catalogue, chosen by seed {found.hidden.seed}, was hidden in the axis. The "
        f"answer was hashed before the measurement (SHA-256 {found.hidden.sha256} of the file hidden.json) "
        "and is shown at the end of this page. The initial model has the linear parts of the axis, each "
        f"parameter wrong by 5 %. It is fitted to {FITTED} records of each of {len(LEVELS)} levels; "
        f"{KEPT_OUT} more of each are kept out for validation."
    )
    page.add_diagnosis(
        "hidden",
        found.diagnosis,
        ladder=found.ladder,
        story=story,
        answer=found.answer_sentence,
        truth=found.compared_with_truth(),
    )


def checks(found: Search) -> dict[str, bool]:
    """Criteria that the search has to meet."""
    return {
        "a missing effect is detected": not found.diagnosis.adequate,
        "the hidden effect is named": found.named,
        "the error on records kept out falls to the noise (1.1 times at most)": found.over_floor
        <= FLOOR_RATIO,
    }
