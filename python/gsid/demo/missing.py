"""Second half of the demo: hide an effect in the axis, search for it, add it, and show the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.comparison import Comparison, compare
from gsid.demo.axis import FS_HZ, PERIOD, Bench
from gsid.demo.hidden import Hidden, draw
from gsid.diagnosis.add import add
from gsid.diagnosis.from_records.diagnose import diagnose_records
from gsid.diagnosis.from_records.result import Diagnosis
from gsid.diagnosis.ladder import Ladder, ladder
from gsid.excitation.multisine import Multisine
from gsid.greybox.fit import fit_plant
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.report import Report, Truth
from gsid.spectrum.realisation import spectra
from gsid.spectrum.spectra import Spectra

LEVELS = (15.0, 45.0)  # command of the first line; the larger one moves the axis by 3 deg
SHAPE_DB = -15.0  # per decade: springs and gravity only show where the axis travels, below 2 Hz
BAND_HZ = (0.5, 194.5)
PERIODS = 8  # not a multiple of 5, as in the first half
FITTED, KEPT_OUT = 2, 2  # realisations of each level; the error on four kept out scatters by 4 % of the noise
FLOOR_RATIO = 1.1  # largest error on the records kept out, relative to noise alone

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
        Comparison of the linear model, its parameters fitted, with the fitted records.
    diagnosis : Diagnosis
    linear : PlantModel
        Linear model that was found from the fitted records.
    model : PlantModel
        The same with the effects found.
    """

    hidden: Hidden
    fitted: list[Spectra]
    comparison: Comparison
    diagnosis: Diagnosis
    linear: PlantModel
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
    found = search(hidden, fitted, kept_out, bench.on_step)
    found.linear.save(bench.folder / "initial_model.json")
    found.model.save(bench.folder / "found.json")
    write_atomically(answer, lambda part: part.write_text(hidden.answer, encoding="utf-8"))
    return found


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


def search(
    hidden: Hidden, fitted: list[Spectra], kept_out: list[Spectra], on_step: Callable[[str], None]
) -> Search:
    """Diagnose, and add the effects found; the records kept out are used for validation only.

    The search does not use the answer.
    """
    diagnosis = diagnose_records(fitted, on_step=lambda text: on_step(f"hidden: {text}"))
    if diagnosis.linear is None:
        raise InputError("no linear stack represents the records", "hidden", None, "take another --seed")
    model = diagnosis.linear
    for effect, *_ in diagnosis.found:  # a sensor that is sampled and held is in the linear stack
        model = model.without_effect(effect)
    linear = model
    for effect, *_ in diagnosis.found:
        on_step(f"hidden: adding {effect}")
        model = add(effect, model, fitted, held_out=kept_out).model
    comparison = compare(fit_plant(linear, fitted).model, fitted, fitted=True)
    return Search(hidden, fitted, comparison, diagnosis, linear, model)


def add_to(page: Report, found: Search) -> None:
    """Add the search to the page."""
    story = (
        f"One effect of the catalogue, chosen by seed {found.hidden.seed}, was hidden in the axis. The "
        f"answer was hashed before the measurement (SHA-256 {found.hidden.sha256} of the file hidden.json) "
        "and is shown below the ladder. The search gets no model: the linear model is found from "
        f"{FITTED} records of each of {len(LEVELS)} levels; {KEPT_OUT} more of each are kept out for "
        "validation."
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
