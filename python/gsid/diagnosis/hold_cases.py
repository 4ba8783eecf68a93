"""Diagnosis of records that do not state their hold: an effect has to be missing under both assumptions.

The given model is fitted under both assumptions. It is adequate if it is adequate under either. Otherwise the
search runs under the more likely assumption. It runs under the other one too if the first search does not
leave only noise and the model found fits better under the other assumption. A lag, a delay, a sample and hold
or a mode above the band can imitate a hold. Such an effect is named only if it is also missing under the
other assumption, with all other effects found in the model.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gsid.base.hold import ALIKE, DECLARE, MEANING, likelier, other_reading
from gsid.diagnosis.candidates import evidence
from gsid.diagnosis.search import Ranking, Search
from gsid.greybox.fit import PlantFit
from gsid.plant.model import PlantModel

# Effects that can imitate a hold; the mode only if it lies above the band.
STAND_IN = {"motor_lag", "sensor_lag", "transport_delay", "sensor_sample_hold", "flexible_mode"}


@dataclass(eq=False)
class Case:
    """A search of records with a known hold, or under one assumption about their hold.

    Attributes
    ----------
    first : PlantFit
        Fit of the given model.
    search : Search
    rankings : list of Ranking
        Rankings of the effects found.
    fit : PlantFit
        Fit with the first effect of each ranking.
    notes : list of str
        Effects that were not named, and why.
    """

    first: PlantFit
    search: Search
    rankings: list[Ranking] = field(default_factory=list)
    fit: PlantFit | None = None
    notes: list[str] = field(default_factory=list)

    def run(self) -> Case:
        """Search for missing effects."""
        self.rankings, self.fit = self.search.run(self.first)
        return self

    @property
    def is_adequate(self) -> bool:
        """Whether the given model leaves only noise."""
        return self.search.test(self.first).p_value >= self.search.given.alpha

    @property
    def is_settled(self) -> bool:
        """Whether the model found leaves only noise."""
        return self.search.steps[-1].p_value >= self.search.given.alpha

    def refit(self, model: PlantModel) -> PlantFit | None:
        """Fit another model to these records; None if the fit fails."""
        return self.search.fit_or_none(model, anew=True)

    def take(self, rankings: list[Ranking], fit: PlantFit) -> None:
        """Adopt the effects found under the other assumption, with the fit under this one."""
        if not rankings:  # a better minimum of the given model
            self.first = fit
        before = [self.first] if rankings else []
        self.search.steps = [self.search.test(each) for each in [*before, fit]]
        self._keep(rankings, fit)

    def leave_out(self, rankings: list[Ranking], fit: PlantFit) -> None:
        """Adopt a fit without some of the effects found."""
        self.search.steps.append(self.search.test(fit))
        self._keep([ranking for ranking in self.rankings if ranking not in rankings], fit)

    def _keep(self, rankings: list[Ranking], fit: PlantFit) -> None:
        self.rankings, self.fit = rankings, fit
        for ranking in rankings:
            best = ranking[0].candidates
            best[0] = replace(best[0], fit=fit)


def settle(cases: dict[str, Case]) -> tuple[Case, PlantFit | None]:
    """Search records that do not state their hold, under one assumption or both.

    Parameters
    ----------
    cases : dict of Case
        At least one case, by assumption; not searched yet.

    Returns
    -------
    Case
        The case of the assumption adopted.
    PlantFit or None
        Fit of the same model under the other assumption.
    """
    taken = likelier({reading: case.first.cost for reading, case in cases.items()})
    for reading in (taken, other_reading(taken)):
        if reading in cases and cases[reading].is_adequate:
            other = cases.get(other_reading(reading))
            return cases[reading].run(), other and other.first
    case, other = cases[taken].run(), cases.get(other_reading(taken))
    if other is None:
        return case, None
    if not case.is_settled:
        moved = other.refit(case.fit.model)
        if moved is not None and case.fit.cost - moved.cost > ALIKE:
            taken, case, other = other_reading(taken), other.run(), case
    return _checked(case, other, other_reading(taken))


def _checked(case: Case, other: Case, other_hold: str) -> tuple[Case, PlantFit | None]:
    """Remove effects that are missing under one assumption only.

    If the model under the other assumption needs none of the doubtful effects, that case is returned.
    """
    doubtful = [ranking for ranking in case.rankings if STAND_IN & set(ranking[0].effects)]
    if not doubtful:
        return case, other.refit(case.fit.model)
    stripped = case.fit.model
    for ranking in doubtful:
        stripped = stripped.without_effect(ranking[0].effects[0])
    plain = other.refit(stripped)
    if plain is not None and other.search.test(plain).p_value >= other.search.given.alpha:
        other.take([ranking for ranking in case.rankings if ranking not in doubtful], plain)
        other.notes = [_note(doubtful, other_hold)]
        return other, case.refit(stripped)
    refuted = [ranking for ranking in doubtful if not _is_missing(other, case.fit.model, ranking)]
    if refuted:
        kept = case.fit.model
        for ranking in refuted:
            kept = kept.without_effect(ranking[0].effects[0])
        fit = case.refit(kept)
        if fit is not None:
            case.leave_out(refuted, fit)
            case.notes.append(_note(refuted, other_hold))
    return case, other.refit(case.fit.model)


def _is_missing(case: Case, found: PlantModel, ranking: Ranking) -> bool:
    """Whether the evidence favours an effect, with all other effects found in the model."""
    best = ranking[0].candidates[0]
    whole, part = case.refit(found), case.refit(found.without_effect(best.effect))
    return whole is not None and part is not None and evidence(part, replace(best, fit=whole)) < 0


def _note(rankings: list[Ranking], hold: str) -> str:
    names = " and ".join(" or ".join(ranking[0].effects) for ranking in rankings)
    return f"{names} is not missing if the input is {MEANING[hold]}, and so is not named: {DECLARE}."
