"""Find the physical effect that is missing from a model of a plant.

1. The free parameters are fitted, and the residual is tested in two ways, each at half the false-alarm rate.
   The first test is whether the residual is larger than noise (CMP-1). The second is whether it correlates
   with an effect of the catalogue more than chance allows (DIA-1, DIA-2). With too few periods only the first
   test is made.
2. Every effect that the model does not contain is scored over a grid of its shape parameters
   (`gsid.diagnosis.probes`). The few best are added and fitted by simulation, from several starts.
3. The candidates are ranked by evidence: the cost after the fit plus a penalty for each parameter. Effects
   that the data cannot distinguish by their costs form one group.
4. The best effect is added and the search continues until only noise remains or no effect helps. Then each
   effect found is removed on trial, and exchanged for its best rivals. If this changes the model, the search
   runs once more. The verdict applies to the final model. `gsid.diagnosis.search` implements this search.
5. The catalogue lacks the missing effect if the final model leaves too much of the misfit, or clearly more
   than noise, or if the records need different values of the parameters (DIA-9).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gsid.base.hold import fit_readings
from gsid.base.plottable import Plottable
from gsid.diagnosis.candidates import Group, SearchInput
from gsid.diagnosis.hold_cases import Case, settle
from gsid.diagnosis.next_experiment import advice
from gsid.diagnosis.search import DRAWS, EFFECTS_MAX, Ranking, Search, Step
from gsid.greybox.fit import PlantFit, as_assumed, fit_plant, require_motion
from gsid.greybox.linear_start import linear_start
from gsid.plant.model import PlantModel, check_plant, transport_delay_s
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of
from gsid.spectrum.spectra import Spectra, is_open, read_as

ALPHA = 0.05
EXPLAINED = 0.9  # share of the misfit above noise that the effects found have to explain
LEFT = 0.1  # largest remaining misfit above the scatter of noise, relative to the noise
P_LEAST = 1 / (DRAWS + 1)  # smallest p-value of the bootstrap
SHOWN = 4  # groups shown for each round
SURE = 0.1  # times alpha: level at which even a small remaining misfit counts as more than noise


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the search, as shown to the user."""

    name: str  # 1, 2, .. or "end"
    before: float | None  # cost per degree of freedom at the start of the round; None for "end"
    ranking: Ranking
    taken: bool  # whether the first of the ranking was added to the model


@dataclass(eq=False, repr=False)
class Diagnosis(Plottable):
    """Result of :func:`diagnose`.

    Attributes
    ----------
    verdict : {"adequate", "missing_effect", "unknown_effect"}
    p_value : float
        Probability of a misfit this large by chance if no effect is missing.
    cost_per_dof, cost_per_dof_after : float
        Cost per degree of freedom of the given model with its free parameters fitted, and of the model with
        the effects found.
    explained : float
        Share of the misfit above noise that the effects found explain.
    p_constant : float or None
        Probability that noise alone makes the parameters of the final model differ this much between the
        records. It is small if a law has the wrong form, because its parameters then depend on the level of
        the excitation. None with one record or too few periods.
    rankings : list of lists of Group
        One ranking for each effect found, in the order of the search: the effect and its rivals, most
        probable first, with the other effects found in the model.
    steps : list of Step
    model : PlantModel
        The given model with the best effect of each group found added, and fitted.
    converged : bool
        Whether the last fit converged.
    next_experiment : str
        An experiment that would distinguish the members of a group; empty if each group has one member.
    names : list of str
        Names of the records.
    untried : dict of str
        Effects whose fits failed from every start, with the reason.
    hold : {"zoh", "none"} or None
        As in `gsid.PlantFit`.
    hold_assumed : bool
        The records do not state their hold. The diagnosis was made under both assumptions: a model that is
        adequate under either is adequate, and a lag, a delay, a sampler or a mode is named only if it is
        missing under both.
    other_delay_s : float or None
        The model's delay [s] under the other assumption; None where the hold is stated or there is no delay.
    hold_notes : list of str
        Effects that were not named because they are missing under one assumption only.
    """

    verdict: str
    p_value: float
    alpha: float
    cost_per_dof: float
    cost_per_dof_after: float
    explained: float
    p_constant: float | None
    rankings: list[Ranking]
    steps: list[Step]
    model: PlantModel
    converged: bool
    next_experiment: str = ""
    names: list[str] = field(default_factory=list)
    untried: dict[str, str] = field(default_factory=dict)
    hold: str | None = None
    hold_assumed: bool = False
    other_delay_s: float | None = None
    hold_notes: list[str] = field(default_factory=list)

    @property
    def delay_hold_uncertainty_s(self) -> float | None:
        """Difference of the delay between the two assumptions of the hold [s]; None if the hold is stated."""
        if self.other_delay_s is None:
            return None
        return abs(transport_delay_s(self.model) - self.other_delay_s)

    def read(self, measured: Sequence[Spectra]) -> list[Spectra]:
        """The records with the hold that the diagnosis assumed.

        Parameters
        ----------
        measured : sequence of Spectra
            The records of the diagnosis.
        """
        return read_as(measured, self.hold) if self.hold_assumed else list(measured)

    @property
    def found(self) -> list[Group]:
        """The effects found, in the order of the search: the first group of each ranking."""
        return [ranking[0] for ranking in self.rankings]

    @property
    def ranking(self) -> Ranking:
        """Ranking of the first effect found; without one, the candidates of the first round."""
        return self.rankings[0] if self.rankings else self.steps[0].ranking

    @property
    def adequate(self) -> bool:
        """Whether the model leaves only noise."""
        return self.verdict == "adequate"

    @property
    def named(self) -> bool:
        """Whether the effects found explain the misfit, even if another effect is missing too."""
        most = self.verdict == "unknown_effect" and self.explained >= EXPLAINED
        return self.verdict == "missing_effect" or (bool(self.found) and most)

    @property
    def _p_words(self) -> str:
        return f"p = {self.p_value:.2g}" if self.p_value > 0 else "p < 1e-300"

    @property
    def sentence(self) -> str:
        """The verdict as a sentence."""
        if self.adequate:
            return f"These data show no missing effect ({self._p_words})."
        names = ", then ".join(_in_words(group.effects) for group in self.found)
        if not self.named:
            best = f" The nearest effect is {names}, which explains {self.explained:.0%}." if names else ""
            return f"An effect is missing that is not in the catalogue ({self._p_words}).{best}"
        after = f"cost per degree of freedom {self.cost_per_dof:.4g} -> {self.cost_per_dof_after:.4g}"
        missing = (
            f"Missing: {names} ({after}, {self.explained:.0%} of the misfit explained, {self._p_words})."
        )
        if self.verdict == "missing_effect":
            return missing
        return f"{missing} {self._why_not_all}: another effect is missing that is not in the catalogue."

    @property
    def _why_not_all(self) -> str:
        if self.steps[-1].p_value < self.alpha:
            return "The remaining misfit is larger than noise"
        return f"The records need different values of the parameters (p = {self.p_constant:.2g})"

    @property
    def rounds(self) -> list[Round]:
        """The rounds that fitted candidates, with their best groups.

        The rounds named "end" follow: the effects whose rivals changed once all effects were in the model.
        `sentence` uses these rivals.
        """
        fitted = [
            Round(str(i), s.fit.cost_per_dof, s.ranking[:SHOWN], s.taken)
            for i, s in enumerate(self.steps, 1)
            if s.ranking
        ]
        at_first = [one.ranking[0].effects for one in fitted if one.taken]
        in_the_end = [ranking for ranking in self.rankings if ranking[0].effects not in at_first]
        return [*fitted, *(Round("end", None, ranking, True) for ranking in in_the_end)]

    @property
    def notes(self) -> list[str]:
        """Remarks on the result, one sentence each."""
        notes = [*self.hold_notes]
        notes += [f"{effect} could not be fitted: {why}." for effect, why in self.untried.items()]
        notes += [
            f"{' or '.join(step.ranking[0].effects)} would remove {step.too_small:.1%} of the remaining "
            "misfit: too little to be the missing effect."
            for step in self.steps
            if step.too_small is not None
        ]
        return notes if self.converged else [*notes, "The last fit has NOT converged."]

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid diagnose --json`."""
        keys = ("verdict", "adequate", "p_value", "alpha", "cost_per_dof", "cost_per_dof_after")
        return {key: getattr(self, key) for key in (*keys, "explained", "p_constant")} | {
            "ranking": [group.to_dict() for group in self.ranking],
            "found": [group.to_dict() for group in self.found],
            "converged": self.converged,
            "hold": self.hold,
            "hold_assumed": self.hold_assumed,
            "delay_hold_uncertainty_s": self.delay_hold_uncertainty_s,
            "notes": self.notes,
            "next_experiment": self.next_experiment,
        }

    def __repr__(self) -> str:
        lines = [self.sentence]
        for one in self.rounds:
            cost = (
                f"cost per degree of freedom {one.before:.4g}"
                if one.before
                else "with the other effects found"
            )
            lines.append(f"  round {one.name}: {cost}")
            for group in one.ranking:
                after = group.candidates[0].fit.cost_per_dof
                lines.append(f"    {group.probability:6.1%}  {' or '.join(group.effects):40} -> {after:.4g}")
        lines += [f"  {note}" for note in self.notes]
        if self.next_experiment:
            lines.append(f"  {self.next_experiment}")
        return "\n".join(lines)


def diagnose(
    model: PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    band: tuple[float, float] | None = None,
    alpha: float = ALPHA,
    seed: int = 0,
    on_step: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Find out whether a physical effect is missing from a model, and which one.

    Parameters
    ----------
    model : PlantModel
        What is believed so far; its free parameters are fitted first.
    records : Record or Spectra, or a sequence of them
        Realisations, preferably at two levels of the excitation. If they do not state their hold, the
        diagnosis is made under both assumptions (`gsid.diagnosis.hold_cases`).
    band : (lo, hi), optional
        Hz; default from the first to the last excited line, the lines between them that are not excited too.
    alpha : float
        False-alarm rate.
    seed : int
        Random seed of the bootstrap.
    on_step : callable
        Called with a short description of each step before it starts.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError, InputError
        As `gsid.fit_plant`.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, got {alpha}")
    measured = spectra_of(records)
    check_plant(model)
    on_step("fitting the given model")

    def case(measured: list[Spectra]) -> Case:
        first = fit_plant(linear_start(model, measured), measured, band=band)
        require_motion(first)
        return Case(first, Search(SearchInput(model, measured, band, alpha, on_step), seed))

    is_assumed = is_open(measured) and not model.has_controller
    if is_assumed:
        chosen, other = settle(fit_readings(lambda reading: case(read_as(measured, reading))))
        as_assumed(chosen.fit, other)
    else:
        chosen = case(measured).run()
    search, first, fit = chosen.search, chosen.first, chosen.fit
    steps, found = search.steps, [ranking[0] for ranking in chosen.rankings]
    p_constant = search.p_constant(fit)
    return Diagnosis(
        verdict=_verdict(steps, found, first, fit, p_constant, alpha),
        p_value=steps[0].p_value,
        alpha=alpha,
        cost_per_dof=first.cost_per_dof,
        cost_per_dof_after=fit.cost_per_dof,
        explained=_explained(first, fit),
        p_constant=p_constant,
        rankings=chosen.rankings,
        steps=steps,
        model=fit.model,
        converged=fit.converged,
        next_experiment=_advice(found, measured),
        names=[s.name for s in measured],
        untried=search.given.untried,
        hold=fit.hold,
        hold_assumed=is_assumed,
        other_delay_s=fit.other_delay_s,
        hold_notes=chosen.notes,
    )


def _in_words(effects: list[str]) -> str:
    others = " or ".join(effects[1:])
    return f"{effects[0]} (these data cannot distinguish it from {others})" if others else effects[0]


def _advice(found: list[Group], measured: list[Spectra]) -> str:
    """An experiment that distinguishes the members of the first group with several."""
    for group in found:
        if len(group.candidates) > 1:
            a, b = group.candidates[:2]
            largest = max(measured, key=lambda one: float(np.linalg.norm(one.u)))
            return advice(a.fit.model, b.fit.model, largest, (a.effect, b.effect))
    return ""


def _explained(before: PlantFit, after: PlantFit) -> float:
    excess = before.cost - before.n_dof
    return float(np.clip((before.cost - after.cost) / excess, 0, 1)) if excess > 0 else 0.0


def _verdict(
    steps: list[Step],
    found: list[Group],
    first: PlantFit,
    last: PlantFit,
    p_constant: float | None,
    alpha: float,
) -> str:
    if steps[0].p_value >= alpha:
        return "adequate"
    gained = first.cost - last.cost
    too_little = gained < EXPLAINED * (gained + last.misfit)
    end = steps[-1]
    too_much_left = end.p_noise < SURE * alpha or (
        end.p_noise < alpha / 2 and last.misfit > LEFT * last.n_dof
    )
    at_a_loss = len(found) == EFFECTS_MAX and end.p_value < alpha
    another_form = p_constant is not None and p_constant <= max(SURE * alpha, P_LEAST)
    unknown = not found or too_little or too_much_left or at_a_loss or another_form
    return "unknown_effect" if unknown else "missing_effect"
