"""The steps of a diagnosis from records, and what is known after each."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from scipy import special

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.from_records.basis import Basis, basis_of
from gsid.diagnosis.from_records.canonical import (
    LAGS,
    SPRING,
    canonical_stack,
    has_low_mode,
    insignificant,
    pruned,
    resonant_stack,
    without_wrong_unit,
)
from gsid.diagnosis.from_records.confirm import Simulated, Simulations
from gsid.diagnosis.from_records.draft import Draft, draft, is_linear, null_cost
from gsid.diagnosis.from_records.drive_laws import drive_starts
from gsid.diagnosis.from_records.law_part import is_of_linear_part, linear_only, without_laws
from gsid.diagnosis.from_records.loop import identified_loop, referenced
from gsid.diagnosis.from_records.play import may_have_play
from gsid.diagnosis.from_records.ripple import Ripple, remaining_ripple
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.short_list import Candidate, short_list
from gsid.diagnosis.from_records.steps import Steps
from gsid.diagnosis.from_records.verdict import (
    ADEQUATE,
    MISSING,
    NEAREST,
    UNKNOWN,
    Decision,
    Evidence,
    by_first_stage,
    decide,
    is_simpler_of_angle,
    n_parameters,
)
from gsid.diagnosis.missing_torque.linear_fit import KnownFits
from gsid.greybox.fit import fit_plant, require_motion
from gsid.greybox.linear_start import linear_start
from gsid.plant.effect import Effect
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel, check_plant
from gsid.records.record import Record
from gsid.response.closed_loop import require_reference
from gsid.spectrum.realisation import listed, spectra_of
from gsid.spectrum.spectra import Spectra, is_open, read_as, require_motion_of_output
from gsid.structure.start import Start, start

ALPHA = 0.05
BIAS = "torque_bias"


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
        self.ripple: Ripple | None = None
        self.interrupted, self.hold_assumed, self.in_closed_loop = False, False, False
        self.cut = False  # whether the time was over before a law of the short list was fitted

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
            self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - began

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
        self.hold_assumed, self.open = is_open(self.measured), [one.hold is None for one in self.measured]
        if model is not None:
            with self.timed("given model"):
                self.take(model)
            return
        with self.timed("linear structure"):
            self.on_step("finding the linear structure")
            self.in_closed_loop = reference is not None
            source = records if self.in_closed_loop else self.measured
            if self.in_closed_loop:
                self.find_loop(listed(records), reference)
            try:
                self.start = start(
                    source, output=output, band=self.band, reference=reference, deadline=self.deadline
                )
            except np.linalg.LinAlgError:
                reason = "No linear structure represents the data: the search for one failed numerically."
                self.decision = Decision(UNKNOWN, (), (reason,))
                return
        if not self.start.has_model and self.deadline.is_over:
            self.give_up()
        elif not self.start.has_model:
            self.decision = Decision(UNKNOWN, (), (_why_no_stack(self.start),))
        else:
            self.stack = canonical_stack(self.start.model(), self.f_lo_hz, self.settings)
            self.measured = self.judged = without_wrong_unit(self.measured, self.stack)
            self.by_reference = without_wrong_unit(self.by_reference, self.stack)
            self.keep_resonances()

    def find_loop(self, records: list[Record], reference: str) -> None:
        """The controller, from the reference, the output and the command."""
        for record in records:
            require_reference(record, reference)
        self.loop = identified_loop(records, self.measured, reference, self.settings)
        if self.loop is not None:
            self.by_reference = referenced(records, self.measured, reference)

    def keep_resonances(self) -> None:
        """The low modes as well, where the stack without them is far worse."""
        found = self.start.model()
        if not has_low_mode(found, self.f_lo_hz, self.settings):
            return
        with_modes = canonical_stack(found, self.f_lo_hz, self.settings, merged=False)
        costs = [
            null_cost(self.measured, each, self.band, self.deadline, self.known_fits)
            for each in (self.stack, with_modes)
        ]
        if costs[0] > self.settings.merged_cost * costs[1]:
            self.stack = with_modes

    def take(self, model: PlantModel) -> None:
        """A given model. Its laws are fitted by simulation, and their part of the output is subtracted."""
        check_plant(model)
        if not model.free_names:
            hint = 'mark what the records may change, such as the gain of rigid_body, with "free": true'
            raise InputError("the given model has no free parameter", "", None, hint)
        self.given, self.stack, self.judged = model, linear_only(model), self.measured
        self.hold_assumed = self.hold_assumed and not model.has_controller
        laws = [effect for effect in model.effects if not is_of_linear_part(effect)]
        if laws:
            self.on_step("fitting the given model by simulation")
            model = linear_start(model, self.measured)
            fitted = fit_plant(model, self.measured, band=self.band, deadline=self.deadline)
            require_motion(fitted)
            self.measured = read_as(self.measured, fitted.hold) if fitted.hold_assumed else self.measured
            self.keep(fitted.model)

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
        run = Run(self.deadline, self.settings, self.band, self.without, self.on_step, self.alpha)
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

    def draw_up(self) -> None:
        """The first draft."""
        with self.timed("first draft"):
            self.draft = self.drafted(self.stack)
            self.try_resonant_stack()
        if is_open(self.measured) and self.draft.stage.hold is not None:
            self.measured = read_as(self.measured, self.draft.stage.hold)
            self.judged = read_as(self.judged, self.draft.stage.hold)
        self.hold = self.draft.stage.hold
        self.decision = by_first_stage(self.draft.stage)

    def give_up(self) -> None:
        """The time was over before the first draft."""
        what = "a linear structure was found" if self.stack is None else "the first draft"
        self.not_tried["laws of the catalogue"] = "the time was over before the first draft"
        self.decision = Decision(UNKNOWN, (), (f"The time was over before {what}.",))

    def drafted(self, stack: PlantModel) -> Draft:
        """The first draft on a stack."""
        return draft(
            self.judged,
            stack,
            band=self.band,
            without={*self.without, *(effect.id for effect in self.known)},
            from_data=self.start is not None or self.is_further,
            along=self.measured if self.known else None,
            known=self.known_fits,
            settings=self.settings,
            on_step=self.on_step,
            deadline=self.deadline,
            linear_rounds=0 if self.given else self.settings.linear_rounds,
        )

    def try_resonant_stack(self) -> None:
        """The lowest mode as the sprung body, where the best law leaves much, and leaves less beside that.

        The linear cost cannot decide it: a law is missing from both.
        """
        left = self.draft.stage.ranking[0].cost_per_dof
        if self.start is None or self.draft.stage.conclusion.kind == "none" or left < self.settings.much_left:
            return
        other = resonant_stack(self.start.model(), self.f_lo_hz, self.settings)
        if other is None:
            return
        self.on_step("the same with the lowest mode as the sprung body")
        try:
            found = self.drafted(other)
        except OutOfTime:
            return
        better = found.stage.ranking[0].cost_per_dof < self.settings.less_left * left
        if better and found.stage.conclusion.kind == "named":
            self.stack, self.draft = other, found

    def confirm(self) -> None:
        """Fit the short list by simulation, and decide again."""
        if self.in_closed_loop and not self.close_loop():
            return
        with self.timed("simulation"):
            fits, missing = self.simulations(), self.draft.stage.conclusion.kind != "none"
            listed = short_list(self.draft, self.pruned, self.settings) if missing else []
            self.on_step.expect(len(listed) + (self.null is None))
            self.null = self.null or fits.fit(self.pruned(self.draft.model), ())
            if self.null is not None and missing:
                self.fit_laws(fits, listed)
            self.accept_noise()
            if self.null is not None and self.decision.verdict == ADEQUATE:
                self.check_adequate()
            if not self.laws and self.decision.verdict == NEAREST:
                reason = (
                    f"No law was fitted by simulation; {' or '.join(self.decision.effects)} is a first draft."
                )
                self.decision = Decision(UNKNOWN, (), (*self.decision.reasons, reason))
        self.not_tried.update(fits.not_tried)

    def accept_noise(self) -> None:
        """Nothing is missing where the simulated linear part leaves only noise and no law was worth a fit.

        The first stage has no images of a sensor that is held at a low rate; the simulation has them.
        """
        if self.null is None or self.laws or self.decision.verdict != UNKNOWN:
            return
        if self.null.fit.cost_per_dof < self.settings.null_cost:
            self.decision = Decision(ADEQUATE)

    def close_loop(self) -> bool:
        """Simulate with the reference as the input, and the controller around the axis, if it is known.

        The measured command would let the simulated axis drift away from the measured motion. The lines are
        those of the command: a reference of slow moves excites few of them distinctly, the friction all.
        """
        if self.loop is None or self.stack.output != "angle":
            self.not_tried["fits by simulation"] = "the controller is not known (closed loop)"
            return False
        if self.band is None:
            f_hz = np.concatenate([one.f_hz[one.excited] for one in self.measured])
            self.band = float(f_hz.min()), float(f_hz.max())
        self.measured, self.known = self.by_reference, [*self.known, self.loop]
        return True

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

    @property
    def noise_p_value(self) -> float:
        """p-value of what is left by the simulated linear part, or by its response: the larger one.

        The simulation of an input without hold has images of the lines at four times the sample rate: with
        very little noise they are larger than it.
        """
        p_value = self.null.fit.noise_p_value
        if self.known:
            return p_value
        stage, n_free = self.draft.stage, len(self.null.model.free_names)
        n_dof = max(stage.n_rows - n_free, 1)
        return max(p_value, float(special.chdtrc(n_dof, stage.cost_per_dof * n_dof)))

    def conclude_without_law(self, null: Simulated) -> None:
        """Adequate, or unknown, with another fit of the given model."""
        self.null, self.laws, self.final = null, [], None
        self.decision = Decision(ADEQUATE)
        self.check_adequate()

    def check_adequate(self) -> None:
        """Whether what the linear part, or the given model, leaves is noise."""
        p_value = self.noise_p_value
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

    def fit_laws(self, fits: Simulations, listed: list[Candidate]) -> None:
        """The laws of the short list, and the verdict."""
        to_beat = None
        for one in listed:
            fitted = fits.fit(one.model, (one.effect,), to_beat)
            self.cut = self.cut or (fitted is None and self.deadline.is_over)
            if fitted is not None:
                self.laws.append(fitted)
                to_beat = min(fitted.cost, to_beat or fitted.cost)
                self.decide()
        if self.given and self.given.has_controller:
            self.fit_drive(fits)
        if self.laws:
            self.add_bias(fits)
        is_noise = self.null is not None and self.noise_p_value >= self.alpha
        if self.given and self.laws and is_noise and not self.is_significant:
            self.decision, self.final = Decision(ADEQUATE), None

    @property
    def is_significant(self) -> bool:
        """Whether the best law lowers the cost by more than the best of many laws does by chance (DIA-5)."""
        best = min(self.laws, key=lambda one: one.cost)
        needed = n_parameters(best) * np.log(best.fit.n_dof) + self.settings.chance
        return bool(self.null.cost - best.cost > needed)

    def fit_drive(self, fits: Simulations) -> None:
        """Laws of the drive inside a loop, which the first stage has no column for."""
        for effect, model in drive_starts(self.null.fit, self.without, self.deadline):
            fitted = fits.fit(model, (effect,), min((one.cost for one in self.laws), default=None))
            self.tried.add(effect)
            if fitted is not None:
                self.laws.append(fitted)
                self.decide()

    def fit_play(self) -> None:
        """Play between motor and load, which the first stage has no column for."""
        if BACKLASH in self.without or self.null is None or not may_have_play(self.null.model):
            return
        fits, least = self.simulations(), min((one.cost for one in self.laws), default=np.inf)
        with self.timed("simulation"):
            fitted = fits.fit_play(self.null.fit, self.given, least)
        self.not_tried.update(fits.not_tried)
        self.tried.add(BACKLASH)
        if fitted is not None:
            self.laws.append(fitted)
            self.decide()

    def weigh_model_error(self) -> None:
        """The values of the law with equal weights, and a ripple, where it leaves more than noise.

        The weights of noise then put the model's error on the lines where the output is largest.
        """
        if self.final is None or self.evidence().is_adequate(self.final):
            return
        with self.timed("fit with equal weights"):
            self.on_step("fitting with equal weights")
            how = {"band": self.band, "method": "nls-output", "deadline": self.deadline}
            try:
                self.deadline.check()
                fit = fit_plant(self.final.model, self.measured, **how)
            except (GsidError, InputError, OutOfTime):
                return
            if not fit.converged and (self.deadline.is_over or self.deadline.moves_left == 0):
                return  # it was cut: its values lie between those of two criteria
            other = replace(self.final, fit=fit)
            self.laws = [other if one is self.final else one for one in self.laws]
            self.final = other
            if self.decision.effects and not self.deadline.is_over:
                self.ripple = remaining_ripple(other.model, self.measured, self.band)

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

    def evidence(self, laws: Sequence[Simulated] | None = None) -> Evidence:
        """What the verdict is made from."""
        drafted = self.draft.stage.conclusion
        all_linear = self.start is None and not any(is_linear(effect) for effect in self.without)
        rivals = drafted.beaten_by, self.settings, drafted.taken_over_by, all_linear
        return Evidence(self.null, laws or self.laws, *rivals)

    def add_bias(self, fits: Simulations) -> None:
        """A constant torque beside each law that it helps, where the best leaves more than noise.

        The offset of a drive shifts the working point of a law. Where the best leaves only noise, it is tried
        beside simpler laws of the angle: cogging with its phase is any of them at another working point.
        """
        evidence = self.evidence()
        best = evidence.best()
        if not any(effect.id == SPRING for effect in best.model.effects):
            return
        adequate = evidence.is_adequate(best)
        for i, one in enumerate(self.laws):
            if adequate and not is_simpler_of_angle(one, best):
                continue
            fitted = fits.fit(one.model.with_effect(BIAS, {"level": 0.0}), one.effects, best.cost)
            if fitted is not None and evidence.is_worse(one, fitted):
                self.laws[i] = fitted
        self.decide()

    def mend_structure(self) -> None:
        """The linear structure beside the law.

        Where only noise is left, elements of the canonical stack that became zero are dropped. Otherwise the
        structure is found again from the records without the law's part of the output.
        """
        if self.decision.verdict != MISSING or self.start is None or self.final is None or self.loop:
            return
        if is_linear(self.decision.effects[0]):
            return
        with self.timed("structure beside the law"):
            if self.evidence().is_adequate(self.final):
                self.drop_zeros()
                return
            for _ in range(self.settings.structure_rounds):
                if self.deadline.is_over or not self.mended():
                    return

    def drop_zeros(self) -> None:
        """The model without optional elements that are not significant, where the cost stays."""
        fits = self.simulations()
        for name in insignificant(self.final.model, self.settings):
            smaller = fits.fit(self.final.model.without_effect(name), self.final.effects)
            if smaller is None:
                return
            if smaller.cost - self.final.cost < self.settings.needed:
                self.final = smaller

    def mended(self) -> bool:
        """Whether the structure changed and the model with it is as good."""
        self.on_step("finding the linear structure without the law's part of the output")
        laws = [effect for effect in self.final.model.effects if not is_of_linear_part(effect)]
        try:
            rest = without_laws(self.measured, self.final.model, self.deadline)
            found = start(rest, output=self.start.output, band=self.band, deadline=self.deadline)
        except (GsidError, InputError, np.linalg.LinAlgError, OutOfTime):
            return False
        if not found.has_model or found.effects.keys() == self.start.effects.keys():
            return False
        model = found.model()
        model.effects += laws
        fits = self.simulations()
        fitted = fits.fit(model, self.final.effects)
        if fitted is None or self.evidence().is_worse(fitted, self.final):
            return False
        self.start, self.final = found, fitted
        return True


def _why_no_stack(found: Start) -> str:
    if found.represented:
        return f"y is the {found.output}, which no stack of effects has as output: integrate y."
    return f"No stack of effects represents the data; a rational model of order {found.order} does best."
