"""Stepwise search for the effects that a model lacks: forward steps, then backward steps and exchanges."""

from __future__ import annotations

import copy
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.candidates import (
    CONVERGED_BY,
    STEPS_LOOK,
    Candidate,
    Group,
    SearchInput,
    evidence,
    fit_candidates,
    ranked,
)
from gsid.diagnosis.scan import SAMPLER, Scored, scan, scan_rates
from gsid.diagnosis.score_test import (
    Score,
    columns_by_record,
    family_wise_p,
    orthonormal,
    random_periods,
    random_phases,
    score,
)
from gsid.effects.types import catalogue
from gsid.greybox.fit import PlantFit
from gsid.plant.model import PlantModel

EFFECTS_MAX = 3  # largest number of effects added
SEARCHES = 2  # the second runs if backward steps or exchanges have changed the model
SHARE_LEAST = 0.03  # share of the remaining misfit that a further effect has to remove
RIVALS = 2  # rivals that are fitted in place of each effect found, at the end of the search
# The special case that a law contains. It is fitted in place of the law even without a high score of its own.
SIMPLER = {effect.id: effect.simpler for effect in catalogue().values() if effect.simpler}
DRAWS = 999  # number of bootstrap draws
SCATTER_LEAST = 7  # degrees of freedom of the scatter over periods; with fewer, no score is significant

Ranking = list[Group]  # most probable first


@dataclass(eq=False)
class Step:
    """One round of the search: the fit it starts from, the tests of this fit, and the ranked candidates."""

    fit: PlantFit
    p_noise: float
    p_score: float | None  # None: too few periods for the bootstrap
    ranking: Ranking
    taken: bool = False  # whether the first of the ranking was added to the model
    too_small: float | None = (
        None  # share of the misfit that the best candidate removes, if it was rejected because this is small
    )

    @property
    def p_value(self) -> float:
        """Combined p-value of both tests (Bonferroni)."""
        if self.p_score is None:
            return self.p_noise
        return min(1.0, 2 * min(self.p_noise, self.p_score))


@dataclass(eq=False)
class Search:
    """Input of a search and the rounds completed so far; see `gsid.diagnose` for the arguments."""

    given: SearchInput
    seed: int  # of the bootstrap
    steps: list[Step] = field(default_factory=list)
    _tested: dict[int, tuple[Step, Scored]] = field(default_factory=dict)
    _smaller: dict[frozenset[str], PlantFit | None] = field(default_factory=dict)

    def run(self, fit: PlantFit) -> tuple[list[Ranking], PlantFit]:
        """Rankings of the effects found, and the fit with the best of each; the last step tests this fit."""
        rankings: list[Ranking] = []
        for _ in range(SEARCHES):
            grown, fit = self._forward(rankings, fit)
            if len(grown) == len(rankings):
                return rankings, fit
            rankings, tidied = self._exchanged(*self._without_the_needless(grown, fit))
            if tidied is fit:
                return rankings, fit
            fit = tidied
        self._round(fit, explore=False)
        return rankings, fit

    def _forward(self, rankings: list[Ranking], fit: PlantFit) -> tuple[list[Ranking], PlantFit]:
        """Add the best effect in each round until only noise remains or no effect improves the evidence."""
        grown = list(rankings)
        while self._round(fit, explore=len(grown) < EFFECTS_MAX):
            grown.append(self.steps[-1].ranking)
            fit = grown[-1][0].candidates[0].fit
        return grown, fit

    def _round(self, fit: PlantFit, *, explore: bool) -> bool:
        """Test a fit, score the catalogue, and fit the best candidates. True if the best one was accepted."""
        step, scored = self._test(fit)
        self.steps.append(step)
        if not explore or step.p_value >= self.given.alpha:
            return False
        step.ranking = ranked(fit, self.candidates(fit, scored))
        if step.ranking:
            self._judge(step)
        return step.taken

    def scan(self, fit: PlantFit) -> Scored:
        """Score every effect that the model does not contain."""
        return scan(fit)

    def candidates(self, fit: PlantFit, scored: Scored) -> list[Candidate]:
        """Fit the effects with the best scores; the sample and hold of a sensor has its own grid of rates."""
        n_shapes = Counter(probe.effect for probe, _ in scored)
        rates, n_shapes[SAMPLER] = scan_rates(fit)
        scored = [pair for pair in scored if pair[0].effect != SAMPLER] + rates
        return fit_candidates(fit, scored, n_shapes, self.given)

    def test(self, fit: PlantFit) -> Step:
        """The tests of a fit, computed once and kept."""
        return self._test(fit)[0]

    def _test(self, fit: PlantFit) -> tuple[Step, Scored]:
        if id(fit) not in self._tested:  # the step keeps its fit alive, so that the id stays unique
            scored = self.scan(fit)
            p_score = self._score_p_value(fit, [item for _, item in scored])
            step = Step(fit, fit.noise_p_value, p_score, [])
            self._tested[id(fit)] = step, scored
        return self._tested[id(fit)]

    def _judge(self, step: Step) -> None:
        """Accept the best candidate by its evidence and, after the first round, by its share of the misfit.

        The share is tested because a law of the wrong form always removes a little of the misfit.
        """
        best = step.ranking[0].candidates[0]
        if evidence(step.fit, best) > 0:
            return
        drop = step.fit.cost - best.fit.cost
        step.taken = len(self.steps) == 1 or drop > SHARE_LEAST * step.fit.misfit
        step.too_small = None if step.taken else drop / step.fit.misfit

    @property
    def _few_periods(self) -> bool:
        return sum(one.n_periods - 1 for one in self.given.measured) < SCATTER_LEAST

    def _score_p_value(self, fit: PlantFit, scores: list[Score]) -> float | None:
        """p-value of the best score: the larger one of two bootstraps of the noise (DIA-2)."""
        if self._few_periods:
            return None
        if not scores:
            return 1.0
        residual = fit.residual
        drawn = random_phases(residual, DRAWS, self.seed), self._scatter(fit)
        return max(float(np.min(family_wise_p(residual, each, scores))) for each in drawn)

    def _scatter(self, fit: PlantFit) -> np.ndarray:
        deviations = [
            (record.spectra.Y - record.spectra.y)[:, record.line] * record.weight for record in fit.records
        ]
        return random_periods(deviations, DRAWS, self.seed)

    def p_constant(self, fit: PlantFit) -> float | None:
        """Probability that noise alone makes the parameters differ this much between the records (DIA-9).

        Parameters
        ----------
        fit : PlantFit

        Returns
        -------
        float or None
            None with one record, or with too few periods for the bootstrap.
        """
        if len(self.given.measured) < 2 or self._few_periods:
            return None
        residual, jacobian = fit.residual, fit.jacobian
        own = columns_by_record(jacobian, [len(record.line) for record in fit.records])
        item = score(residual, orthonormal(jacobian), own)
        return float(family_wise_p(residual, self._scatter(fit), [item])[0])

    def _without_the_needless(self, rankings: list[Ranking], fit: PlantFit) -> tuple[list[Ranking], PlantFit]:
        """Backward step: remove effects that later effects have made unnecessary."""
        for ranking in rankings[:-1]:
            needless = ranking[0].candidates[0]
            self.given.on_step(f"trying without {needless.effect}")
            without = self._without_or_none(fit, needless.effect)
            price = len(needless.params) * np.log(fit.n_dof)
            if without is not None and without.cost - fit.cost < price:
                rankings, fit = [r for r in rankings if r is not ranking], without
        return rankings, fit

    def _exchanged(self, rankings: list[Ranking], fit: PlantFit) -> tuple[list[Ranking], PlantFit]:
        """Rank each effect again, together with its rivals, with all other effects in the model."""
        if not rankings or (len(rankings) == 1 and rankings[0][0].candidates[0].fit is fit):
            return rankings, fit
        again: list[Ranking] = []
        for i, ranking in enumerate(rankings):
            own = ranking[0].candidates[0]
            now = [replace(own, fit=fit)]
            others = {r[0].candidates[0].effect for r in [*again, *rankings[i:]]}
            for rival in self._rivals(own, others):
                self.given.on_step(f"trying {rival.effect} in place of {own.effect}")
                exchanged = self.with_rival(fit.model, own.effect, rival)
                if exchanged is not None:
                    now.append(replace(rival, fit=exchanged))
            now += self._simpler(fit.model, own, others | {candidate.effect for candidate in now})
            # If the fit without this effect fails, the fit without any added effect replaces it.
            again.append(ranked(self._without_or_none(fit, own.effect) or self.steps[0].fit, now))
            fit = again[-1][0].candidates[0].fit
        for ranking in again:
            best = ranking[0].candidates
            best[0] = replace(best[0], fit=fit)
        return again, fit

    def _rivals(self, own: Candidate, taken: set[str]) -> list[Candidate]:
        """The next best candidates of the last round that fitted an effect, if they lowered the cost."""
        rounds = [
            [c for group in step.ranking for c in group.candidates if c.fit.cost < step.fit.cost]
            for step in self.steps
        ]
        beside = [fitted for fitted in rounds if own.effect in [c.effect for c in fitted]][-1]
        return [c for c in beside if c.effect not in taken][:RIVALS]

    def _simpler(self, model: PlantModel, own: Candidate, known: set[str]) -> list[Candidate]:
        """The special case that an effect contains, fitted in its place if it has not been fitted yet."""
        effect = SIMPLER.get(own.effect)
        if effect is None or effect in known:
            return []
        self.given.on_step(f"trying {effect} in place of {own.effect}")
        start = {"level": sum(p.value for name, p in own.params.items() if name in ("level", "extra"))}
        fit = self.fit_or_none(model.without_effect(own.effect).with_effect(effect, start))
        return [Candidate(effect, fit, own.predicted_drop)] if fit else []

    def _without_or_none(self, fit: PlantFit, effect: str) -> PlantFit | None:
        """Fit without an effect, computed once for each set of effects."""
        model = fit.model.without_effect(effect)
        left = frozenset(each.id for each in model.effects)
        if left not in self._smaller:
            self._smaller[left] = self.fit_or_none(model, anew=effect == SAMPLER)
        return self._smaller[left]

    def with_rival(self, model: PlantModel, effect: str, rival: Candidate) -> PlantFit | None:
        """Fit with a rival in place of an effect, from the better of two starts.

        The first start is this model with the rival's values. The second is the rival's fitted model with the
        other effects of this model added.
        """
        here, there = model.without_effect(effect), rival.fit.model.without_effect(effect)
        here.effects.append(copy.deepcopy(rival.fit.model.effects[-1]))
        as_fitted = {e.id: e for e in there.effects}
        there.effects = [copy.deepcopy(as_fitted.get(e.id, e)) for e in here.effects]
        looks = [
            self.fit_or_none(here, STEPS_LOOK, anew=SAMPLER in (effect, rival.effect)),
            self.fit_or_none(there, STEPS_LOOK),
        ]
        near = min((fit for fit in looks if fit), key=lambda fit: fit.cost, default=None)
        return near and (near if near.converged else self.fit_or_none(near.model) or near)

    def fit_or_none(
        self, model: PlantModel, max_iter: int = CONVERGED_BY, *, anew: bool = False
    ) -> PlantFit | None:
        """Fit a model, optionally with new starting values of its linear part; None if the fit fails.
        New starting values are needed when a sample and hold is added or removed, because its delay is then
        missing from the present values.
        """
        try:
            return self.given.fit(self.given.started_anew(model) if anew else model, max_iter)
        except (GsidError, InputError):
            return None
