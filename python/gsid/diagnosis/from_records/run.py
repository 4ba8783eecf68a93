"""What is known of a diagnosis after each step, and what follows from it."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from scipy import special

from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records.basis import Basis, basis_of
from gsid.diagnosis.from_records.canonical import pruned
from gsid.diagnosis.from_records.confirm import Simulated, Simulations
from gsid.diagnosis.from_records.draft import Draft, is_linear
from gsid.diagnosis.from_records.evidence import Evidence, may_be_noise, n_parameters
from gsid.diagnosis.from_records.law_part import is_of_linear_part, linear_only, without_laws
from gsid.diagnosis.from_records.ripple import Ripple
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.steps import Steps
from gsid.diagnosis.from_records.verdict import ADEQUATE, UNKNOWN, Decision, decide
from gsid.diagnosis.missing_torque.linear_fit import KnownFits
from gsid.effects.ids import LAGS, SPRING
from gsid.plant.effect import Effect
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra
from gsid.structure.start import Start

ALPHA = 0.05


class Run:
    """One diagnosis: its settings, and what is known so far."""

    def __init__(
        self,
        deadline: Deadline,
        settings: DecisionSettings,
        band: tuple[float, float] | None,
        without: Collection[str],
        on_step: Callable[[str], None],
        alpha: float = ALPHA,
    ) -> None:
        self.deadline, self.alpha = deadline, alpha
        self.settings, self.band, self.without = settings, band, without
        self.on_step = on_step if isinstance(on_step, Steps) else Steps(on_step, deadline)
        self.seconds: dict[str, float] = {}
        self.not_tried: dict[str, str] = {}
        self.tried: set[str] = set()  # by simulation, though the first stage has no column for them
        self.notes: list[str] = []
        self.hold: str | None = None
        self.measured: list[Spectra] = []
        self.open: list[bool] = []  # whether each record states no hold
        self.judged: list[Spectra] = []  # without the part of the laws that are known
        self.known: list[Effect] = []  # these laws
        self.known_fits: KnownFits = {}  # of the linear part to `judged`
        self.given: PlantModel | None = None
        self.is_further = False  # a round beside effects that were found
        self.loop: Effect | None = None  # the controller of a closed loop
        self.by_reference: list[Spectra] = []  # its records, with the reference as the input
        self.start: Start | None = None
        self.stack: PlantModel | None = None
        self.draft: Draft | None = None
        self.null: Simulated | None = None
        self.laws: list[Simulated] = []
        self.decision = Decision(UNKNOWN)
        self.basis: Basis | None = None  # of the decision
        self.final: Simulated | None = None
        self.larger: dict[str, PlantModel] = {}  # further laws that are not excluded
        self.ripple: Ripple | None = None
        self.interrupted, self.hold_assumed, self.in_closed_loop = False, False, False
        self.cut = False  # whether time or work was over before a law of the short list was fitted

    @property
    def is_confirmed(self) -> bool:
        """Whether the verdict is one of fits by simulation."""
        return self.null is not None and (bool(self.laws) or not (self.decision.effects or self.cut))

    @contextmanager
    def timed(self, step: str) -> Iterator[None]:
        """Note the time of a step, also of one that is interrupted."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - began

    @property
    def excluded(self) -> set[str]:
        """Effects that are not tried: those left out, and those that the model has already."""
        return {*self.without, *(effect.id for effect in self.known)}

    def keep(self, model: PlantModel) -> None:
        """Judge what is missing beside a fitted model."""
        self.stack = linear_only(model)
        self.known = [effect for effect in model.effects if not is_of_linear_part(effect)]
        self.judged = without_laws(self.measured, model, self.deadline) if self.known else self.measured
        self.known_fits = {}

    def beside(self, model: PlantModel, null: Simulated | None = None) -> Run:
        """A further round: what is missing beside a fitted model, such as one with the effects found so far.

        Parameters
        ----------
        model : PlantModel
        null : Simulated, optional
            Its fit.
        """
        deadline = self.deadline.bounded(self.settings.moves_most)  # the fits so far used theirs
        run = Run(deadline, self.settings, self.band, self.without, self.on_step, self.alpha)
        run.seconds, run.given, run.is_further = self.seconds, self.given, True
        run.measured, run.open, run.hold_assumed = self.measured, self.open, self.hold_assumed
        run.notes, run.not_tried = self.notes, self.not_tried
        run.keep(model)
        run.null = replace(null, effects=()) if null else None
        return run

    @property
    def f_lo_hz(self) -> float:
        """Lowest line [Hz]."""
        if self.start is not None:
            return float(self.start.measured.f_hz[0])
        return min(float(one.f_hz[one.excited][0]) for one in self.measured)

    def accept_noise(self) -> None:
        """Nothing is missing where the simulated linear part leaves only noise and no law was worth a fit.

        The first stage has no images of a sensor that is held at a low rate; the simulation has them.
        """
        if self.null is None or self.laws or self.cut or self.decision.verdict != UNKNOWN:
            return
        if may_be_noise(self.null, self.settings):
            self.decision = Decision(ADEQUATE)

    def accept_noise_of_draft(self) -> None:
        """Nothing is missing where the first draft confirms no law and the linear part leaves only noise.

        In a closed loop without a known controller no simulation can tell.
        """
        stage = self.draft.stage
        n_dof = max(stage.n_rows - len(self.draft.model.free_names), 1)
        p_value = float(special.chdtrc(n_dof, stage.cost_per_dof * n_dof))
        if self.decision.verdict == UNKNOWN and p_value >= self.alpha:
            self.decision = Decision(ADEQUATE)

    def pruned(self, model: PlantModel) -> PlantModel:
        """Without elements of the canonical stack that became zero; those of a given model stay."""
        return model if self.given else pruned(model, self.f_lo_hz, self.settings)

    def simulations(self) -> Simulations:
        """Fits by simulation, with the time that is left."""
        return Simulations(
            self.measured,
            self.band,
            self.deadline,
            self.settings,
            self.on_step,
            known=tuple(self.known),
            left_out=self.left_out(),
        )

    def left_out(self) -> tuple[str, ...]:
        """In a closed loop: elements of the canonical stack that the linear structure does not have.

        The controller sees its own lag there, which the simulation already has, and its gain holds the axis.
        """
        if self.loop is None or self.start is None:
            return ()
        return tuple(effect for effect in (SPRING, *LAGS) if effect not in self.start.effects)

    def conclude_without_law(self, null: Simulated) -> None:
        """Adequate, or unknown, with another fit of the given model."""
        self.null, self.laws, self.final = null, [], None
        self.decision = Decision(ADEQUATE)
        self.check_adequate()

    def check_adequate(self) -> None:
        """Whether what the linear part, or the given model, leaves is noise."""
        p_value = self.null.noise_p_value
        if p_value < self.p_least:
            reason = f"What is left is larger than noise (p = {p_value:.2g}), and no law explains it."
            self.decision = Decision(UNKNOWN, (), (reason,))

    @property
    def p_least(self) -> float:
        """p-value below which something is missing though no law explains it.

        A given model is a hypothesis that is tested. A structure that was selected from the data leaves a
        little more than noise.
        """
        return self.alpha if self.given else self.settings.p_least

    @property
    def shown(self) -> Simulated | None:
        """The fit that the result is of: with the law that is named or nearest, else of the linear part."""
        return self.final if self.final and self.decision.effects else self.null

    @property
    def is_significant(self) -> bool:
        """Whether the best law lowers the cost by more than the best of many laws does by chance (DIA-5)."""
        best = min(self.laws, key=lambda one: one.cost)
        needed = n_parameters(best) * np.log(best.fit.n_dof) + self.settings.chance
        return bool(self.null.cost - best.cost > needed)

    def replace_final(self, better: Simulated) -> None:
        """Put another fit of the best law in its place, also among the laws.

        Parameters
        ----------
        better : Simulated
        """
        self.laws = [better if one is self.final else one for one in self.laws]
        self.final = better

    def decide(self) -> None:
        """The verdict from the fits so far."""
        evidence = self.evidence().weighed()
        self.decision, self.final = decide(evidence), self.laws[evidence.laws.index(evidence.best())]
        self.basis = basis_of(evidence)
        effects = self.decision.effects
        if effects and self.start is not None and is_linear(effects[0]):
            reason = (
                f"The linear structure is not certain: {' or '.join(effects)} explains most of the misfit."
            )
            self.decision = Decision(UNKNOWN, (), (reason,), self.decision.unexplained_share)

    def evidence(self) -> Evidence:
        """What the verdict is made from."""
        drafted, first = self.draft.stage.conclusion, self.draft.stage.ranking[0].effects[0]
        all_linear = self.start is None and not any(is_linear(effect) for effect in self.without)
        rivals = drafted.beaten_by, self.settings, drafted.taken_over_by, all_linear
        return Evidence(self.null, self.laws, *rivals, beaten=first)
