"""A diagnosis of records that do not state their hold: an effect has to be missing under both assumptions.

The given model is fitted under both; if it is adequate under either it is adequate. Otherwise the search
runs under the likelier assumption. Only if that search settles nothing, and the other assumption then fits
what was found better, it runs under the other too. A lag, a delay, a sampler or a far mode can stand in for a
hold: what was found of these has to be missing under the other assumption beside all else that was found.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gsid.base.hold import ALIKE, DECLARE, MEANING, likelier, other_reading
from gsid.diagnosis.candidates import evidence
from gsid.diagnosis.search import Ranking, Search
from gsid.greybox.fit import PlantFit
from gsid.plant.model import PlantModel

# For a hold; the mode where it lies above the band.
STAND_IN = {"motor_lag", "sensor_lag", "transport_delay", "sensor_sample_hold", "flexible_mode"}


@dataclass(eq=False)
class Case:
    """A search on records of a known hold, or under one assumption of those that do not state it.

    Attributes
    ----------
    first : PlantFit
        Of the model as it was given.
    search : Search
    rankings : list of Ranking
        Of the effects found.
    fit : PlantFit
        With the first of each ranking.
    notes : list of str
        What was not named, and why.
    """

    first: PlantFit
    search: Search
    rankings: list[Ranking] = field(default_factory=list)
    fit: PlantFit | None = None
    notes: list[str] = field(default_factory=list)

    def run(self) -> Case:
        """Search for what is missing."""
        self.rankings, self.fit = self.search.run(self.first)
        return self

    @property
    def is_adequate(self) -> bool:
        """Whether the model as it was given leaves noise only."""
        return self.search.test(self.first).p_value >= self.search.given.alpha

    @property
    def is_settled(self) -> bool:
        """Whether what was found leaves noise only."""
        return self.search.steps[-1].p_value >= self.search.given.alpha

    def refit(self, model: PlantModel) -> PlantFit | None:
        """Another model fitted to these records; None where it cannot be."""
        return self.search.fit_or_none(model, anew=True)

    def take(self, rankings: list[Ranking], fit: PlantFit) -> None:
        """Take what was found under the other assumption, with the fit under this one."""
        if not rankings:  # a better minimum of the model as it was given
            self.first = fit
        before = [self.first] if rankings else []
        self.search.steps = [self.search.test(each) for each in [*before, fit]]
        self._keep(rankings, fit)

    def leave_out(self, rankings: list[Ranking], fit: PlantFit) -> None:
        """Go back to the fit without some effects that were found."""
        self.search.steps.append(self.search.test(fit))
        self._keep([ranking for ranking in self.rankings if ranking not in rankings], fit)

    def _keep(self, rankings: list[Ranking], fit: PlantFit) -> None:
        self.rankings, self.fit = rankings, fit
        for ranking in rankings:
            best = ranking[0].candidates
            best[0] = replace(best[0], fit=fit)


def settle(cases: dict[str, Case]) -> tuple[Case, PlantFit | None]:
    """Search under the assumptions of records that do not state their hold.

    Parameters
    ----------
    cases : dict of Case
        By assumption, one at least, not run yet.

    Returns
    -------
    Case
        Of the assumption taken.
    PlantFit or None
        The same model under the other assumption.
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
    """Without what is missing under one assumption only; the other's model where that needs none of it."""
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
    """Whether an effect earns its place beside all others that were found."""
    best = ranking[0].candidates[0]
    whole, part = case.refit(found), case.refit(found.without_effect(best.effect))
    return whole is not None and part is not None and evidence(part, replace(best, fit=whole)) < 0


def _note(rankings: list[Ranking], hold: str) -> str:
    names = " and ".join(" or ".join(ranking[0].effects) for ranking in rankings)
    return f"{names} is not missing if the input is {MEANING[hold]}, and so is not named: {DECLARE}."
