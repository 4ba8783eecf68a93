"""Candidates: effects of the catalogue added to a model, fitted for real, and ranked by evidence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gsid.base.errors import GsidError, InputError
from gsid.diagnosis.joint_start import joint_starts
from gsid.diagnosis.scan import Scored, with_probe
from gsid.effects.types import find
from gsid.greybox.fit import PlantFit, fit_plant, noise_p_value
from gsid.greybox.linear_start import linear_start
from gsid.plant.effect import Param
from gsid.plant.linear_response import JOINT
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra

REFITTED = 5  # effects fitted for real in each round, at most
REFITTED_BESIDE_JOINT = 2  # each from one start: a joint makes simulations ten times dearer
RIVAL = 0.5  # and only those that promise this share of what another brought, or nearly all of a small drop
RIVAL_THRESHOLD = 0.1  # the same for threshold laws
STARTS = 2  # of each, the second when the first does not keep its promise
STARTS_FIXED = 5  # of those whose shape the fit cannot move
WHOLE = 0.25  # of a law that is there or not, this share has to be seen; the nearest of a grid shows half
KEPT = 0.9  # of the predicted drop: the promise is kept
BEYOND = 1.2  # the same where the shape is held: each has a promise of its own, and may bring more
CONVERGED_BY = 50  # steps, of the best candidate
STEPS_MAX = 15  # of each fit: a start that needs more is not near
STEPS_LOOK = 3  # of the first fit of a joint or a held shape, which says whether more are worth their time
STEPS_ALONE = 10  # of the fit of one record with a joint
WALLS = 3  # times that a fit with a joint is begun again from one record
FORGIVEN = 0.5  # of the cost without a joint: a joint that leaves more is not followed past the walls
SAME = 10.0  # costs (-2 log likelihood) that differ by less do not tell two effects apart


@dataclass(frozen=True, eq=False)
class Given:
    """What a search is given, and whom it tells in words what comes next."""

    model: PlantModel  # before it was fitted
    measured: list[Spectra]
    band: tuple[float, float] | None  # Hz
    alpha: float  # level of the tests
    on_step: Callable[[str], None]
    untried: dict[str, str] = field(default_factory=dict)  # effects that no start could be fitted of, and why

    def fit(
        self, model: PlantModel, max_iter: int = CONVERGED_BY, only: Sequence[int] | None = None
    ) -> PlantFit:
        """Fit to all records, or to some."""
        records = self.measured if only is None else [self.measured[i] for i in only]
        return fit_plant(model, records, band=self.band, max_iter=max_iter)

    def started_anew(self, model: PlantModel) -> PlantModel:
        """The model with new starting values of its linear part, from the records."""
        return linear_start(model, self.measured)

    def joint_starts(self, fit: PlantFit) -> list[tuple[PlantModel, float]]:
        """The model of a fit with a joint added, and by how much that lowers the error of the response."""
        return joint_starts(fit, self.measured, self.model)

    def noise_p_value(self, fit: PlantFit) -> float:
        """Probability of a misfit as large or larger by noise alone, of a fit of all records."""
        return noise_p_value(fit, self.measured)

    def is_noise(self, fit: PlantFit) -> bool:
        """Whether what a fit of all records leaves may be noise."""
        return self.noise_p_value(fit) > self.alpha


@dataclass(eq=False)
class Candidate:
    """An effect added to the model and fitted."""

    effect: str
    fit: PlantFit
    predicted_drop: float
    n_shapes: int = 1  # of the grid that the start was chosen from

    @property
    def params(self) -> dict[str, Param]:
        """Parameters of the added effect."""
        own = [effect for effect in self.fit.model.effects if effect.id == self.effect]
        return own[-1].params


@dataclass(eq=False)
class Group:
    """Effects that the data cannot tell apart, best first."""

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
    """The effects of the largest predicted drops, each with its best points of the grid as starts."""
    by_effect: dict[str, Scored] = {}
    for probe, item in sorted(scored, key=lambda pair: -pair[1].drop):
        if item.drop > 0 and not (probe.fixed and item.size[0] < WHOLE):
            by_effect.setdefault(probe.effect, []).append((probe, item))
    return {effect: tries[: _starts(tries)] for effect, tries in list(by_effect.items())[:REFITTED]}


def _starts(tries: Scored) -> int:
    return STARTS_FIXED if tries[0][0].fixed else STARTS


def _share_wanted(effect: str) -> float:
    """Of the largest drop seen, for an effect to be fitted: a threshold law is only roughly a direction."""
    return RIVAL_THRESHOLD if find(effect).null_kind == "threshold" else RIVAL


def tried(
    fit: PlantFit,
    scored: Scored,
    n_shapes: Mapping[str, int],
    given: Given,
) -> list[Candidate]:
    """The shortlist fitted, best promise first; once one leaves only noise, no small promise is tried.

    Parameters
    ----------
    fit : PlantFit
        Of the model without them.
    scored : list of (Probe, Score)
        See `gsid.diagnosis.scan.scan`.
    n_shapes : mapping
        Of each effect, how many shapes were looked at.
    given : Given

    Returns
    -------
    list of Candidate
    """
    candidates: list[Candidate] = []
    enough = brought = 0.0
    has_joint = JOINT in [effect.id for effect in fit.model.effects]
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
        given.on_step(f"trying {JOINT}")
        candidates += _joint(fit, given, fit.cost - brought)
    if candidates:
        best = min(range(len(candidates)), key=lambda i: evidence(fit, candidates[i]))
        candidates[best] = _converged(candidates[best], given)
    return candidates


def _refitted(fit: PlantFit, effect: str, tries: Scored, given: Given) -> Candidate | None:
    """The effect fitted from each start; None when no start can be fitted.

    Where the shape is held, a few steps tell the shapes apart, and only the best goes on.
    """
    best: Candidate | None = None
    for probe, item in tries:
        enough = (BEYOND if probe.fixed else KEPT) * item.drop
        # Of a held shape an unfinished fit will do: the cost only falls further.
        settled = best is not None and (probe.fixed or best.fit.converged)
        if settled and fit.cost - best.fit.cost > enough:
            break
        try:
            start = with_probe(fit.model, probe, item.size)
            larger = given.fit(start, STEPS_LOOK if probe.fixed else STEPS_MAX)
        except (GsidError, InputError) as error:
            given.untried[effect] = str(error)
            continue  # a start that cannot be simulated is no candidate
        if best is None or larger.cost < best.fit.cost:
            best = Candidate(effect, larger, item.drop)
    if best is not None:
        given.untried.pop(effect, None)  # of an earlier start, or round
    if best is not None and tries[0][0].fixed and not best.fit.converged:
        best = _further(best, given, STEPS_MAX)
    return best


def _further(candidate: Candidate, given: Given, max_iter: int) -> Candidate:
    """The candidate with its fit carried on."""
    try:
        fit = given.fit(candidate.fit.model, max_iter)
    except (GsidError, InputError):
        return candidate  # begun again, it may not find the steady state that the first fit followed
    return replace(candidate, fit=fit) if fit.cost < candidate.fit.cost else candidate


def _joint(fit: PlantFit, given: Given, beaten: float) -> list[Candidate]:
    """A joint with play, the dearest to simulate: tried when nothing else leaves only noise.

    Followed to its end only where the first steps lead below the least cost of the others.
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
        found.append(Candidate(JOINT, fitted, gain))
    return found


def _beyond_the_walls(fit: PlantFit, given: Given) -> PlantFit:
    """Fit one record alone, then with it one more at a time.

    Where a collision more or less begins, a record's cost has a wall, which stops the fit of all. The walls
    of other records stand elsewhere, and a record alone has the fewest.
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


def _converged(candidate: Candidate, given: Given) -> Candidate:
    """The candidate with its fit carried on until it has converged; one with a joint seldom gets further."""
    if candidate.fit.converged or candidate.effect == JOINT:
        return candidate
    return _further(candidate, given, CONVERGED_BY)


def evidence(fit: PlantFit, candidate: Candidate) -> float:
    """-2 log of the candidate's evidence over that of the model without it: negative speaks for it (DIA-5).

    With n residuals a parameter has to lower the cost by ln n to earn its place (Schwarz), and the best of m
    shapes by 2 ln m more, which is what the best of m directions of noise does.

    Parameters
    ----------
    fit : PlantFit
        Of the model without it.
    candidate : Candidate
    """
    n = fit.n_dof + len(fit.model.free_names)
    price = len(candidate.params) * np.log(n) + 2 * np.log(candidate.n_shapes)
    return candidate.fit.cost - fit.cost + price


def ranked(fit: PlantFit, candidates: list[Candidate]) -> list[Group]:
    """Groups of candidates whose costs differ by less than the data can tell, most probable first.

    The price of parameters puts the simpler law first; it does not speak against the richer one being true.
    """
    if not candidates:
        return []
    value = {id(c): evidence(fit, c) for c in candidates}
    ordered = sorted(candidates, key=lambda c: value[id(c)])
    least = min(value[id(ordered[0])], 0.0)
    weight = {id(c): np.exp(-(value[id(c)] - least) / 2) for c in candidates}
    total = sum(weight.values()) + np.exp(least / 2)  # the model without any is a candidate too
    groups: list[list[Candidate]] = []
    for candidate in ordered:
        mine = [g for g in groups if candidate.fit.cost - g[0].fit.cost < SAME]
        if mine:
            mine[0].append(candidate)
        else:
            groups.append([candidate])
    return [Group(members, float(sum(weight[id(c)] for c in members) / total)) for members in groups]
