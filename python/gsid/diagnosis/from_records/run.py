"""The steps of a diagnosis from records, and what is known after each."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager

from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.from_records.canonical import SPRING, canonical_stack, pruned, without_wrong_unit
from gsid.diagnosis.from_records.confirm import Simulated, Simulations
from gsid.diagnosis.from_records.draft import Draft, draft, is_linear
from gsid.diagnosis.from_records.law_part import without_laws
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.short_list import short_list
from gsid.diagnosis.from_records.verdict import MISSING, Decision, Evidence, by_first_stage, decide
from gsid.plant.effect import Effect
from gsid.plant.model import PlantModel, check_plant
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, is_open, require_motion_of_output
from gsid.structure.start import Start, start

BIAS = "torque_bias"


class Run:
    """One diagnosis: its settings, and what is known so far."""

    def __init__(
        self,
        budget_s: float,
        settings: DecisionSettings,
        band: tuple[float, float] | None,
        without: Collection[str],
        on_step: Callable[[str], None],
    ) -> None:
        self.deadline = time.perf_counter() + budget_s
        self.settings, self.band, self.without, self.on_step = settings, band, without, on_step
        self.seconds: dict[str, float] = {}
        self.not_tried: dict[str, str] = {}
        self.measured: list[Spectra] = []
        self.start: Start | None = None
        self.stack: PlantModel | None = None
        self.draft: Draft | None = None
        self.null: Simulated | None = None
        self.laws: list[Simulated] = []
        self.decision = Decision("unknown_effect", (), ("No stack of effects represents the data.",))
        self.final: Simulated | None = None
        self.interrupted, self.hold_assumed = False, False

    @property
    def is_confirmed(self) -> bool:
        """Whether the verdict is one of fits by simulation."""
        return self.null is not None and (bool(self.laws) or not self.decision.effects)

    @contextmanager
    def timed(self, step: str) -> Iterator[None]:
        """Note the time of a step, also of one that is interrupted."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[step] = time.perf_counter() - began

    def find_structure(
        self,
        records: Record | Spectra | Sequence[Record | Spectra],
        model: PlantModel | None,
        output: str | None,
        reference: str | None,
    ) -> None:
        """The canonical stack from the data, or the given model."""
        with self.timed("spectra"):
            self.on_step("transforming the records")
            self.measured = spectra_of(records)
        require_motion_of_output(self.measured)
        self.hold_assumed = is_open(self.measured)
        if model is not None:
            check_plant(model)
            self.stack = model
            return
        with self.timed("linear structure"):
            self.on_step("finding the linear structure")
            source = self.measured if reference is None else records
            self.start = start(source, output=output, band=self.band, reference=reference)
        if self.start.has_model:
            self.stack = canonical_stack(self.start.model(), self.f_lo_hz, self.settings)
            self.measured = without_wrong_unit(self.measured, self.stack)

    @property
    def f_lo_hz(self) -> float:
        """Lowest line [Hz]."""
        if self.start is not None:
            return float(self.start.measured.f_hz[0])
        return min(float(one.f_hz[one.excited][0]) for one in self.measured)

    def draw_up(self) -> None:
        """The first draft."""
        with self.timed("first draft"):
            self.draft = draft(
                self.measured,
                self.stack,
                band=self.band,
                without=self.without,
                settings=self.settings,
                on_step=self.on_step,
            )
        self.measured = self.draft.measured
        self.decision = by_first_stage(self.draft.stage)

    def confirm(self) -> None:
        """Fit the short list by simulation, and decide again."""
        with self.timed("simulation"):
            fits = Simulations(self.measured, self.band, self.deadline, self.settings, self.on_step)
            self.null = fits.fit(pruned(self.draft.model, self.f_lo_hz, self.settings), ())
            if self.null is not None and self.draft.stage.conclusion.kind != "none":
                self.fit_laws(fits)
        self.not_tried |= fits.not_tried

    def fit_laws(self, fits: Simulations) -> None:
        """The laws of the short list, and the verdict."""
        to_beat = None
        for one in short_list(self.draft, self.f_lo_hz, self.settings):
            fitted = fits.fit(one.model, (one.effect,), to_beat)
            if fitted is not None:
                self.laws.append(fitted)
                to_beat = min(fitted.cost, to_beat or fitted.cost)
                self.decide()
        if self.laws:
            self.add_bias(fits)

    def decide(self) -> None:
        """The verdict from the fits so far."""
        evidence = self.evidence()
        self.decision, self.final = decide(evidence), evidence.best()

    def evidence(self, laws: Sequence[Simulated] | None = None) -> Evidence:
        """What the verdict is made from."""
        beaten_by = self.draft.stage.conclusion.beaten_by
        return Evidence(self.null, laws or self.laws, beaten_by, self.settings)

    def add_bias(self, fits: Simulations) -> None:
        """A constant torque beside each law that it helps, where the best leaves more than noise.

        The offset of a drive shifts the working point of a law.
        """
        evidence = self.evidence()
        best = evidence.best()
        if evidence.is_adequate(best) or not any(effect.id == SPRING for effect in best.model.effects):
            return
        for i, one in enumerate(self.laws):
            fitted = fits.fit(one.model.with_effect(BIAS, {"level": 0.0}), one.effects, best.cost)
            if fitted is not None and evidence.is_worse(one, fitted):
                self.laws[i] = fitted
        self.decide()

    def mend_structure(self) -> None:
        """The linear structure of the records without the law's part, with the law fitted again."""
        if self.decision.verdict != MISSING or self.start is None or is_linear(self.decision.effects[0]):
            return
        with self.timed("structure without the law"):
            for _ in range(self.settings.structure_rounds):
                if time.perf_counter() > self.deadline or not self.mended():
                    return

    def mended(self) -> bool:
        """Whether the structure changed and the model with it is as good."""
        self.on_step("finding the linear structure without the law's part of the output")
        laws = [effect for effect in self.final.model.effects if not _in_linear_part(effect)]
        try:
            rest = without_laws(self.measured, self.final.model)
            found = start(rest, output=self.start.output, band=self.band)
        except (GsidError, InputError):
            return False
        if not found.has_model or found.effects.keys() == self.start.effects.keys():
            return False
        model = found.model()
        model.effects += laws
        fits = Simulations(self.measured, self.band, self.deadline, self.settings, self.on_step)
        fitted = fits.fit(model, self.final.effects)
        if fitted is None or self.evidence().is_worse(fitted, self.final):
            return False
        self.start, self.final = found, fitted
        return True


def _in_linear_part(effect: Effect) -> bool:
    return effect.type.null_kind == "never" or is_linear(effect.id)
