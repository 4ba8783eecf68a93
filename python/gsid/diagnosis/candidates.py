"""Candidates: effects of the catalogue, each added to a model, fitted by simulation and ranked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.joint_start import joint_starts
from gsid.diagnosis.scan import Scored, with_probe
from gsid.effects.types import find
from gsid.greybox.fit import PlantFit, fit_plant
from gsid.greybox.linear_start import linear_start
from gsid.plant.effect import Param
from gsid.plant.linear_response import BACKLASH
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra

REFITTED = 5  # largest number of effects fitted in each round
REFITTED_BESIDE_JOINT = 2  # the same with backlash in the model, which makes a simulation ten times slower
RIVAL = 0.5  # least predicted drop of a further effect, as a share of the drop that another effect achieved
RIVAL_THRESHOLD = 0.1  # the same for threshold laws
STARTS = 2  # starts of each fit; the second is used if the first does not reach the predicted drop
STARTS_FIXED = 5  # the same for an effect with a fixed shape parameter
WHOLE = 0.25  # least coefficient of a law without a size of its own; the nearest grid point shows about 0.5
KEPT = 0.9  # share of the predicted drop at which no second start is needed
BEYOND = 1.2  # the same for a fixed shape parameter: another grid point may achieve more
CONVERGED_BY = 50  # iterations of the best candidate's fit
STEPS_MAX = 15  # iterations of each fit: a start that needs more is too far from the minimum
STEPS_LOOK = 3  # iterations of the first fit with backlash or a fixed shape, which selects what is continued
STEPS_ALONE = 10  # iterations of the fit of one record with backlash
WALLS = 3  # restarts of a fit with backlash from one record
FORGIVEN = 0.5  # share of the cost without backlash: a fit with backlash that leaves more is not restarted
SAME = 10.0  # costs (-2 log likelihood) that differ by less do not distinguish two effects


@dataclass(frozen=True, eq=False)
class SearchInput:
    """Input of a search: the model, the records, the settings, and a callback that reports progress."""

    model: PlantModel  # before the fit
    measured: list[Spectra]
    band: tuple[float, float] | None  # Hz
    alpha: float  # significance level of the tests
    on_step: Callable[[str], None]  # called with a description of the next step
    untried: dict[str, str] = field(
        default_factory=dict
    )  # effects whose fits failed from all starts, and why

    def fit(
        self, model: PlantModel, max_iter: int = CONVERGED_BY, only: Sequence[int] | None = None
    ) -> PlantFit:
        """Fit a model to all records, or to the records with the indices `only`."""
        records = self.measured if only is None else [self.measured[i] for i in only]
        return fit_plant(model, records, band=self.band, max_iter=max_iter)

    def started_anew(self, model: PlantModel) -> PlantModel:
        """The model with new starting values of its linear part, estimated from the records."""
        return linear_start(model, self.measured)

    def joint_starts(self, fit: PlantFit) -> list[tuple[PlantModel, float]]:
        """The model of a fit with backlash added, and how much this lowers the error of the response."""
        return joint_starts(fit, self.model)

    def is_noise(self, fit: PlantFit) -> bool:
        """Whether the residual of a fit to all records is consistent with noise."""
        return fit.noise_p_value > self.alpha


@dataclass(eq=False)
class Candidate:
    """An effect that was added to the model and fitted."""

    effect: str
    fit: PlantFit
    predicted_drop: float
    n_shapes: int = 1  # number of grid points from which the start was chosen

    @property
    def params(self) -> dict[str, Param]:
        """Parameters of the added effect."""
        own = [effect for effect in self.fit.model.effects if effect.id == self.effect]
        return own[-1].params


@dataclass(eq=False)
class Group:
    """Effects that the data cannot distinguish, best first."""

    candidates: list[Candidate]
    probability: float

    @property
    def effects(self) -> list[str]:
        return [candidate.effect for candidate in self.candidates]

    def to_dict(self) -> dict[str, Any]:
        best = self.candidates[0]
        return {
            "effects": self.effects,
            "probability": self.probability,
            "cost_per_dof_after": best.fit.cost_per_dof,
            "drop": best.predicted_drop,
            "params": {name: {"value": p.value, "std": p.std} for name, p in best.params.items()},
        }


def shortlist(scored: Scored) -> dict[str, Scored]:
    """The effects with the largest predicted drops, each with its best grid points as starts."""
    by_effect: dict[str, Scored] = {}
    for probe, item in sorted(scored, key=lambda pair: -pair[1].drop):
        if item.drop > 0 and not (probe.fixed and item.size[0] < WHOLE):
            by_effect.setdefault(probe.effect, []).append((probe, item))
    return {effect: tries[: _starts(tries)] for effect, tries in list(by_effect.items())[:REFITTED]}


def _starts(tries: Scored) -> int:
    return STARTS_FIXED if tries[0][0].fixed else STARTS


def _share_wanted(effect: str) -> float:
    """Least predicted drop of an effect to be fitted, as a share of the largest drop achieved so far.

    It is smaller for threshold laws, because linear sensitivities describe them only roughly.
    """
    return RIVAL_THRESHOLD if find(effect).null_kind == "threshold" else RIVAL


def fit_candidates(
    fit: PlantFit,
    scored: Scored,
    n_shapes: Mapping[str, int],
    given: SearchInput,
) -> list[Candidate]:
    """Fit the shortlisted effects, in the order of their predicted drops.

    Once a candidate leaves only noise, effects with a much smaller predicted drop are skipped.

    Parameters
    ----------
    fit : PlantFit
        Fit of the model without the candidates.
    scored : list of (Probe, Score)
        See `gsid.diagnosis.scan.scan`.
    n_shapes : mapping
        Number of grid points scored for each effect.
    given : SearchInput

    Returns
    -------
    list of Candidate
    """
    candidates: list[Candidate] = []
    enough = brought = 0.0
    has_joint = BACKLASH in [effect.id for effect in fit.model.effects]
    for effect, tries in list(shortlist(scored).items())[: REFITTED_BESIDE_JOINT if has_joint else None]:
        promise = tries[0][1].drop
        hopeless = promise < min(_share_wanted(effect) * brought, brought - 3 * SAME)
        if hopeless or promise < RIVAL * enough - SAME:
            continue
        given.on_step(f"trying {effect}")
        candidate = _refitted(fit, effect, tries[:1] if has_joint else tries, given)
        if candidate is None:
            continue
        candidate.n_shapes = n_shapes[effect]
        candidates.append(candidate)
        brought = max(brought, fit.cost - candidate.fit.cost)
        if given.is_noise(candidate.fit):
            enough = max(enough, fit.cost - candidate.fit.cost)
    if enough == 0 and not has_joint:
        given.on_step(f"trying {BACKLASH}")
        candidates += _joint(fit, given, fit.cost - brought)
    if candidates:
        best = min(range(len(candidates)), key=lambda i: evidence(fit, candidates[i]))
        candidates[best] = _converged(candidates[best], given)
    return candidates


def _refitted(fit: PlantFit, effect: str, tries: Scored, given: SearchInput) -> Candidate | None:
    """The best fit of an effect over its starts; None if the fit fails from every start.

    With a fixed shape parameter, a few iterations compare the grid points, and only the best is continued.
    """
    best: Candidate | None = None
    for probe, item in tries:
        enough = (BEYOND if probe.fixed else KEPT) * item.drop
        # With a fixed shape an unfinished fit is sufficient, because further iterations only lower its cost.
        settled = best is not None and (probe.fixed or best.fit.converged)
        if settled and fit.cost - best.fit.cost > enough:
            break
        try:
            start = with_probe(fit.model, probe, item.size)
            larger = given.fit(start, STEPS_LOOK if probe.fixed else STEPS_MAX)
        except (GsidError, InputError) as error:
            given.untried[effect] = str(error)
            continue  # a start that cannot be simulated is skipped
        if best is None or larger.cost < best.fit.cost:
            best = Candidate(effect, larger, item.drop)
    if best is not None:
        given.untried.pop(effect, None)  # entry of an earlier start or round
    if best is not None and tries[0][0].fixed and not best.fit.converged:
        best = _further(best, given, STEPS_MAX)
    return best


def _further(candidate: Candidate, given: SearchInput, max_iter: int) -> Candidate:
    """The candidate after further iterations of its fit."""
    try:
        fit = given.fit(candidate.fit.model, max_iter)
    except (GsidError, InputError):
        return candidate  # a restarted fit may miss the steady state that the first fit tracked
    return replace(candidate, fit=fit) if fit.cost < candidate.fit.cost else candidate


def _joint(fit: PlantFit, given: SearchInput, beaten: float) -> list[Candidate]:
    """Fit backlash, the slowest effect to simulate; used only if no other effect leaves only noise.

    The fit is completed only if its first iterations reach a lower cost than all other effects.
    """
    found = []
    for start, gain in given.joint_starts(fit):
        try:
            fitted = given.fit(start, STEPS_LOOK)
            if fitted.cost < FORGIVEN * fit.cost:
                fitted = _beyond_the_walls(fitted, given)
            if fitted.cost < beaten and not fitted.converged:
                fitted = given.fit(fitted.model, STEPS_MAX)
        except (GsidError, InputError):
            continue
        found.append(Candidate(BACKLASH, fitted, gain))
    return found


def _beyond_the_walls(fit: PlantFit, given: SearchInput) -> PlantFit:
    """Fit one record alone, then add the other records one at a time.

    The cost of a record has a steep step wherever the number of collisions changes, and such a step stops the
    fit. The steps of different records lie at different values, so that the cost of a single record has the
    fewest steps.
    """
    n_records = len(given.measured)
    for _ in range(WALLS if n_records > 1 else 0):
        if given.is_noise(fit):
            break
        try:
            alone = [given.fit(fit.model, STEPS_ALONE, only=[i]) for i in range(n_records)]
            order = sorted(range(n_records), key=lambda i: alone[i].cost_per_dof)
            further = alone[order[0]]
            for n in range(2, n_records + 1):
                further = given.fit(further.model, STEPS_ALONE, only=sorted(order[:n]))
        except (GsidError, InputError):
            break
        if further.cost > fit.cost - SAME:
            break
        fit = further
    return fit


def _converged(candidate: Candidate, given: SearchInput) -> Candidate:
    """The candidate with its fit continued to convergence, except backlash, whose fit rarely improves."""
    if candidate.fit.converged or candidate.effect == BACKLASH:
        return candidate
    return _further(candidate, given, CONVERGED_BY)


def evidence(fit: PlantFit, candidate: Candidate) -> float:
    """-2 log of the evidence ratio of the models with and without the candidate (DIA-5).

    A negative value favours the candidate. With n residuals, each parameter has to lower the cost by ln n
    (Schwarz). A shape chosen as the best of m has to lower it by 2 ln m more, the drop that noise gives in
    the best of m directions.

    Parameters
    ----------
    fit : PlantFit
        Fit of the model without the candidate.
    candidate : Candidate
    """
    n = fit.n_dof + len(fit.model.free_names)
    price = len(candidate.params) * np.log(n) + 2 * np.log(candidate.n_shapes)
    return candidate.fit.cost - fit.cost + price


def ranked(fit: PlantFit, candidates: list[Candidate]) -> list[Group]:
    """Groups of candidates that the data cannot distinguish by their costs, most probable first.

    The penalty for parameters ranks the simpler law first. It is no evidence against the law with more
    parameters.
    """
    if not candidates:
        return []
    value = {id(c): evidence(fit, c) for c in candidates}
    ordered = sorted(candidates, key=lambda c: value[id(c)])
    least = min(value[id(ordered[0])], 0.0)
    weight = {id(c): np.exp(-(value[id(c)] - least) / 2) for c in candidates}
    total = sum(weight.values()) + np.exp(least / 2)  # the model without a further effect is a candidate too
    groups: list[list[Candidate]] = []
    for candidate in ordered:
        mine = [g for g in groups if candidate.fit.cost - g[0].fit.cost < SAME]
        if mine:
            mine[0].append(candidate)
        else:
            groups.append([candidate])
    return [Group(members, float(sum(weight[id(c)] for c in members) / total)) for members in groups]
