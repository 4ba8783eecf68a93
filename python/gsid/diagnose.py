"""Which physical effect is missing from a model of a plant?

1. The free parameters are fitted, and what is left is tested in two ways at half the false-alarm rate
   each: is it more than noise (CMP-1), and does it point along an effect of the catalogue more than
   chance allows (DIA-1, DIA-2)?
2. Every effect that the model does not have is scored over a grid of its shapes (`gsid.probes`); the few
   best are added and fitted for real, from several starts.
3. They are ranked by evidence: the cost after the fit and a price for each parameter. Effects whose
   costs after the fit differ by less than the data can tell form one group.
4. The best is kept and the search goes on, until what is left is noise or nothing helps; then every
   effect found is tried to be left out again.
5. When the best still leaves most of the misfit, the missing effect is not in the catalogue.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from gsid._callable import callable_as
from gsid.effects import EffectType, catalogue, find
from gsid.errors import GsidError, InputError
from gsid.frf import Spectra, spectra
from gsid.greybox import PlantFit, RecordFit, fit_plant
from gsid.linear_start import linear_start
from gsid.linear_view import linear_view
from gsid.next_experiment import advice
from gsid.plant import RADIANS, Effect, Param, PlantModel, input_period
from gsid.probes import Probe, Trajectory, probes, quantization_at, quantization_spacing
from gsid.record import Record
from gsid.scores import Score, family_wise_p, orthonormal, random_periods, random_phases, score

if TYPE_CHECKING:
    import matplotlib.figure

ALPHA = 0.05
EFFECTS_MAX = 3  # effects looked for, one after the other
REFITTED = 5  # effects fitted for real in each round, at most
RIVAL = 0.5  # and only those that promise this share of the best one's drop, or nearly all of a small one
RIVAL_THRESHOLD = 0.1  # the same for threshold laws
STARTS = 2  # of each, the second when the first does not keep its promise
KEPT = 0.9  # of the predicted drop: the promise is kept
STEPS_MAX = 15  # of each fit: a start that needs more is not near
DRAWS = 999  # of the bootstrap
ZOOMS, ZOOM_POINTS = 2, 8  # refinements of a step's grid, points on each side
SAME = 10.0  # costs (-2 log likelihood) that differ by less do not tell two effects apart
EXPLAINED = 0.9  # share of the misfit above noise that the catalogue has to explain to be believed
NOT_SEEN_IN_THE_MEAN = ("periodic_disturbance",)
TURNING_ONLY = ("mass_unbalance", "motor_cogging")  # laws of an angle: not for an axis whose unit is a length


@dataclass(eq=False)
class Candidate:
    """An effect added to the model and fitted."""

    effects: tuple[str, ...]  # of this step: one
    fit: PlantFit
    predicted_drop: float

    @property
    def params(self) -> dict[str, Param]:
        """Parameters of the added effect."""
        return self.fit.model.effects[-1].params


@dataclass(eq=False)
class Group:
    """Effects that the data cannot tell apart, best first."""

    candidates: list[Candidate]
    probability: float

    @property
    def effects(self) -> list[str]:
        return [candidate.effects[-1] for candidate in self.candidates]

    def to_dict(self) -> dict[str, Any]:
        best = self.candidates[0]
        return {
            "effects": self.effects,
            "probability": self.probability,
            "cost_per_dof_after": best.fit.cost_per_dof,
            "drop": best.predicted_drop,
            "params": {name: {"value": p.value, "std": p.std} for name, p in best.params.items()},
        }


@dataclass(eq=False)
class Step:
    """One round of the search: the fit it started from, its tests, and how the candidates came out."""

    fit: PlantFit
    p_noise: float
    p_score: float
    ranking: list[Group]

    @property
    def p_value(self) -> float:
        """Of both tests together (Bonferroni)."""
        return min(1.0, 2 * min(self.p_noise, self.p_score))


@dataclass(eq=False, repr=False)
class Diagnosis:
    """What :func:`diagnose` found.

    Attributes
    ----------
    verdict : {"adequate", "missing_effect", "unknown_effect"}
    p_value : float
        Probability of a misfit like this by chance when nothing is missing.
    cost_per_dof, cost_per_dof_after : float
        Of the model as it was given (its free parameters fitted), and with what was found.
    explained : float
        Share of the misfit above noise that the effects found explain.
    found : list of Group
        The effects found, in the order of the search; each the first group of its round.
    steps : list of Step
    model : PlantModel
        With the best effect of each group found added, and fitted.
    """

    verdict: str
    p_value: float
    alpha: float
    cost_per_dof: float
    cost_per_dof_after: float
    explained: float
    found: list[Group]
    steps: list[Step]
    model: PlantModel
    next_experiment: str = ""
    names: list[str] = field(default_factory=list)

    @property
    def adequate(self) -> bool:
        return self.verdict == "adequate"

    @property
    def ranking(self) -> list[Group]:
        """Groups of the first round, most probable first."""
        return self.steps[0].ranking if self.steps else []

    @property
    def _p_words(self) -> str:
        return f"p = {self.p_value:.2g}" if self.p_value > 0 else "p < 1e-300"

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        if self.adequate:
            return f"Nothing is missing that these data show ({self._p_words})."
        after = f"cost per degree of freedom {self.cost_per_dof:.4g} -> {self.cost_per_dof_after:.4g}"
        names = ", then ".join(" or ".join(group.effects) for group in self.found)
        if self.verdict == "unknown_effect":
            best = f" The nearest is {names}, which explains {self.explained:.0%}." if names else ""
            return f"Something is missing that the catalogue does not have ({self._p_words}).{best}"
        explained = f"{self.explained:.0%} of the misfit explained"
        return f"Missing: {names} ({after}, {explained}, {self._p_words})."

    def plot(self) -> matplotlib.figure.Figure:
        """How far each effect that was tried brings the cost down; needs one that was."""
        from gsid import plots

        return plots.diagnosis(self)

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid diagnose --json`."""
        keys = ("verdict", "adequate", "p_value", "alpha", "cost_per_dof", "cost_per_dof_after", "explained")
        return {key: getattr(self, key) for key in keys} | {
            "ranking": [group.to_dict() for group in self.ranking],
            "found": [group.to_dict() for group in self.found],
            "next_experiment": self.next_experiment,
        }

    def __repr__(self) -> str:
        lines = [self.sentence]
        for number, step in enumerate(self.steps, 1):
            if not step.ranking:
                continue
            lines.append(f"  round {number}: cost per degree of freedom {step.fit.cost_per_dof:.4g}")
            for group in step.ranking[:4]:
                after = group.candidates[0].fit.cost_per_dof
                lines.append(f"    {group.probability:6.1%}  {' or '.join(group.effects):40} -> {after:.4g}")
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
    """Find out whether a physical effect is missing from a model, and which.

    Parameters
    ----------
    model : PlantModel
        What is believed so far; its free parameters are fitted first.
    records : Record or Spectra, or a sequence of them
        Realisations, best at two levels of the excitation.
    band : (lo, hi), optional
        Hz; default from the first to the last excited line, the lines between them that are not excited too.
    alpha : float
        False-alarm rate.
    seed : int
        Of the bootstrap.
    on_step : callable
        Told in words what comes next.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError, InputError
        As `gsid.greybox.fit_plant`.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, got {alpha}")
    several = [records] if isinstance(records, Record | Spectra) else list(records)
    if not several:
        raise ValueError("no record was given")
    measured = [r if isinstance(r, Spectra) else spectra(r) for r in several]
    on_step("fitting the model as it is")
    first = fit = fit_plant(linear_start(model, measured), measured, band=band)
    steps: list[Step] = []
    found: list[Group] = []
    while True:
        step, best = _round(fit, measured, band, alpha, seed, on_step, explore=len(found) < EFFECTS_MAX)
        steps.append(step)
        if step.p_value >= alpha or best is None:
            break
        found.append(best)
        fit = best.candidates[0].fit
    found, fit = _without_the_needless(model, found, fit, measured, band, on_step)
    return Diagnosis(
        verdict=_verdict(steps, found, first, fit, alpha),
        p_value=steps[0].p_value,
        alpha=alpha,
        cost_per_dof=first.cost_per_dof,
        cost_per_dof_after=fit.cost_per_dof,
        explained=_explained(first, fit),
        found=found,
        steps=steps,
        model=fit.model,
        next_experiment=_advice(found, measured),
        names=[s.name for s in measured],
    )


def _advice(found: list[Group], measured: list[Spectra]) -> str:
    """How to tell the members of the first group that has several apart."""
    for group in found:
        if len(group.candidates) > 1:
            a, b = group.candidates[:2]
            largest = max(measured, key=lambda one: float(np.linalg.norm(one.u)))
            return advice(a.fit.model, b.fit.model, largest, (a.effects[-1], b.effects[-1]))
    return ""


def _explained(before: PlantFit, after: PlantFit) -> float:
    excess = before.cost - before.n_dof
    return float(np.clip((before.cost - after.cost) / excess, 0, 1)) if excess > 0 else 0.0


def _verdict(steps: list[Step], found: list[Group], first: PlantFit, last: PlantFit, alpha: float) -> str:
    if steps[0].p_value >= alpha:
        return "adequate"
    # What is left counts against the catalogue only as far as it is more than the scatter of noise.
    scatter = 3 * np.sqrt(2 * last.n_dof * (1 + 2 / last.variance_dof))
    left = max(last.cost - last.n_dof - scatter, 0.0)
    gained = first.cost - last.cost
    still_wrong = steps[-1].p_noise < alpha / 2 and gained < EXPLAINED * (gained + left)
    return "unknown_effect" if not found or still_wrong else "missing_effect"


# ---- one round ---------------------------------------------------------------------------------------


def _round(
    fit: PlantFit,
    measured: list[Spectra],
    band: tuple[float, float] | None,
    alpha: float,
    seed: int,
    on_step: Callable[[str], None],
    *,
    explore: bool,
) -> tuple[Step, Group | None]:
    """Test a fit, score the catalogue, fit the best few; the best group when it earns its price."""
    scored = _scored(fit, measured)
    p_score = _score_p_value(fit, measured, [item for _, item in scored], seed)
    step = Step(fit, noise_p_value(fit, measured), p_score, [])
    if not explore or step.p_value >= alpha:
        return step, None
    candidates = []
    for effect, tries in _shortlist(scored).items():
        on_step(f"trying {effect}")
        candidate = _refitted(fit, effect, tries, measured, band)
        if candidate is not None:
            candidates.append(candidate)
    step.ranking = _ranked(fit, candidates)
    worth = step.ranking and step.ranking[0].candidates[0]
    if not worth or _evidence(fit, worth) > 0:
        return step, None
    return step, step.ranking[0]


def _score_p_value(fit: PlantFit, measured: list[Spectra], scores: list[Score], seed: int) -> float:
    """Of the best score, by the more cautious of two ways to draw what noise alone would do."""
    residual = stacked(fit, "residual")[:, 0]
    if not scores:
        return 1.0
    deviations = [
        (one.Y - one.y)[:, record.line] * record.weight
        for record, one in zip(fit.records, measured, strict=True)
    ]
    drawn = random_phases(residual, DRAWS, seed), random_periods(deviations, DRAWS, seed)
    return max(float(np.min(family_wise_p(residual, each, scores))) for each in drawn)


def noise_p_value(fit: PlantFit, measured: list[Spectra]) -> float:
    """Probability of a misfit as large or larger by noise alone (CMP-1), the fitted parameters allowed for.

    Parameters
    ----------
    fit : PlantFit
    measured : list of Spectra
        As fitted.

    Returns
    -------
    float
    """
    total, n_lines = 0.0, 0
    for record, one in zip(fit.records, measured, strict=True):
        use = record.line[record.line > 0]
        nu = one.n_periods - 1
        error = one.y[use] - record.prediction.Y[use]
        variance = np.maximum(one.var_y[use], np.finfo(float).tiny)
        total += float(np.sum(nu * np.log1p(one.n_periods * np.abs(error) ** 2 / variance / nu)))
        n_lines += len(use)
    return float(stats.chi2.sf(2 * total, max(2 * n_lines - len(fit.model.free_names), 1)))


def stacked(fit: PlantFit, what: str) -> np.ndarray:
    """Residual or Jacobian of all records: all real parts, then all imaginary parts.

    Parameters
    ----------
    fit : PlantFit
    what : "residual" or "jacobian"

    Returns
    -------
    (2 m, columns) ndarray, m the number of lines of all records
    """
    halves = [np.split(getattr(record, what).reshape(2 * len(record.line), -1), 2) for record in fit.records]
    return np.vstack([re for re, _ in halves] + [im for _, im in halves])


def whitened(fit: PlantFit, columns: list[np.ndarray]) -> np.ndarray:
    """Columns of a probe, weighted as the fit's residuals are and in the order of `stacked`.

    Parameters
    ----------
    fit : PlantFit
    columns : list of (q, K) complex ndarrays
        Lines 0 .. N/2, one entry per record.

    Returns
    -------
    (2 m, q) ndarray
    """
    parts = [
        (lines[:, record.line] * record.weight).T for lines, record in zip(columns, fit.records, strict=True)
    ]
    together = np.vstack(parts)
    real = np.concatenate([record.line == 0 for record in fit.records])
    return np.vstack([together.real, np.where(real[:, None], 0.0, together.imag)])


def trajectory(model: PlantModel, record: RecordFit, one: Spectra) -> Trajectory:
    """Path of a fitted model under one record's excitation.

    Parameters
    ----------
    model : PlantModel
    record : RecordFit
        Of the model's fit.
    one : Spectra
        The record.
    """
    view = linear_view(
        model.stack(),
        one.f_hz,
        one.fs_hz,
        output_angle=model.output == "angle",
        radians_per_unit=RADIANS[model.angle_unit],
        held=one.hold == "zoh" or model.has_controller,
    )
    return Trajectory(
        fs_hz=one.fs_hz,
        command=input_period(one, 1),
        angle=record.prediction.angle,
        rate=record.prediction.rate,
        output=record.prediction.y,
        f_hz=one.f_hz,
        torque_response=view.torque,
        command_response=view.command,
        direct_response=view.direct,
        radians_per_unit=RADIANS[model.angle_unit],
    )


def _scored(fit: PlantFit, measured: list[Spectra]) -> list[tuple[Probe, Score]]:
    """Every probe of every effect that the model does not have."""
    present = {effect.id for effect in fit.model.effects}
    left_out = present | set(NOT_SEEN_IN_THE_MEAN) | set(TURNING_ONLY if fit.model.angle_unit == "m" else ())
    absent = [e.id for e in catalogue().values() if e.id not in left_out and e.stage != "controller"]
    trajectories = [
        trajectory(fit.model, record, one) for record, one in zip(fit.records, measured, strict=True)
    ]
    tried = list(probes(trajectories, absent))
    if "torque_bias" in absent:
        bias = _bias_probe(fit.model, measured)
        if find("torque_bias")["level"].typical * np.linalg.norm(whitened(fit, bias.columns)) > 1:
            tried.append(bias)  # else a linear plant: a constant torque is not seen at all
    residual, nuisance = stacked(fit, "residual")[:, 0], orthonormal(stacked(fit, "jacobian"))

    def judged(several: Iterable[Probe]) -> list[tuple[Probe, Score]]:
        return [
            (probe, score(residual, nuisance, whitened(fit, probe.columns), one_sided=probe.one_sided))
            for probe in several
        ]

    scored = judged(tried)
    for _ in range(ZOOMS):
        scored += judged(_nearer(trajectories, scored))
    return scored


def _nearer(trajectories: list[Trajectory], scored: list[tuple[Probe, Score]]) -> Iterator[Probe]:
    """Points between the best step of a rounding and its neighbours: it has no slope for a fit to follow."""
    steps = [
        (item.drop, probe.start(item.size)["step"]) for probe, item in scored if probe.fixed == ("step",)
    ]
    if steps:
        known = np.array([step for _, step in steps])
        best = max(steps)[1]
        gaps = np.abs(known - best)
        spacing = np.min(gaps[gaps > 0], initial=quantization_spacing(trajectories, best))
        yield from quantization_at(
            trajectories, best + spacing * np.linspace(-1, 1, 2 * ZOOM_POINTS + 1)[1:-1]
        )


def _bias_probe(model: PlantModel, measured: list[Spectra]) -> Probe:
    """A constant torque shifts where the other laws work: it shows only through them, so it is simulated."""
    biased = copy.deepcopy(model)
    for effect in biased.effects:
        for param in effect.params.values():
            param.free = False
    biased = with_effect(biased, "torque_bias", {"level": 0.0})
    columns = [biased.predict(one, sensitivities=True).dY for one in measured]
    return Probe("torque_bias", columns, lambda c: {"level": float(c[0])})


def _shortlist(scored: list[tuple[Probe, Score]]) -> dict[str, list[tuple[Probe, Score]]]:
    """The effects of the largest predicted drops, each with its best points of the grid as starts."""
    by_effect: dict[str, list[tuple[Probe, Score]]] = {}
    for probe, item in sorted(scored, key=lambda pair: -pair[1].drop):
        if item.drop > 0:
            by_effect.setdefault(probe.effect, []).append((probe, item))
    drops = {effect: tries[0][1].drop for effect, tries in by_effect.items()}
    largest = max(drops.values(), default=0.0)
    rivals = [
        e for e, drop in drops.items() if drop > _share_wanted(e) * largest or largest - drop < 3 * SAME
    ]
    return {effect: by_effect[effect][:STARTS] for effect in rivals[:REFITTED]}


def _share_wanted(effect: str) -> float:
    """Of the largest drop, for an effect to be fitted: a threshold law's direction is only a rough one."""
    return RIVAL_THRESHOLD if find(effect).null_kind == "threshold" else RIVAL


def with_effect(
    model: PlantModel,
    effect: str | EffectType,
    params: dict[str, float],
    limits: dict[str, tuple[float, float]] | None = None,
    fixed: Sequence[str] = (),
) -> PlantModel:
    """A copy of a model with one more effect, its values moved into the catalogue's bounds.

    Parameters
    ----------
    model : PlantModel
    effect : str or EffectType
        Id of the catalogue, or an effect of one's own.
    params : dict of float
        Values; those not given are typical ones.
    limits : dict of (lo, hi), optional
        Limits of a fit that are narrower than the catalogue's bounds.
    fixed : sequence of str
        Parameters that a fit leaves as they are.
    """
    larger = copy.deepcopy(model)
    larger.cov, larger.fit = None, None
    added = {}
    own = effect if isinstance(effect, EffectType) else None
    for known in (own or find(effect)).parameters:
        limit = (limits or {}).get(known.name)
        lower, upper = limit or (known.lower, known.upper)
        value = float(np.clip(params.get(known.name, known.typical), lower, upper))
        added[known.name] = Param(value, known.name not in fixed, limits=limit)
    larger.effects.append(Effect(own.id if own else effect, added, own))
    return larger


def _refitted(
    fit: PlantFit,
    effect: str,
    tries: list[tuple[Probe, Score]],
    measured: list[Spectra],
    band: tuple[float, float] | None,
) -> Candidate | None:
    """The effect fitted from each start; None when no start can be fitted."""
    best: Candidate | None = None
    for probe, item in tries:
        if best is not None and fit.cost - best.fit.cost > KEPT * item.drop:
            break
        try:
            start = with_effect(fit.model, effect, probe.start(item.size), probe.limits, probe.fixed)
            larger = fit_plant(start, measured, band=band, max_iter=STEPS_MAX)
        except (GsidError, InputError):
            continue  # a start that cannot be simulated is no candidate
        if best is None or larger.cost < best.fit.cost:
            best = Candidate((effect,), larger, item.drop)
    return best


# ---- evidence ----------------------------------------------------------------------------------------


def _evidence(fit: PlantFit, candidate: Candidate) -> float:
    """-2 log of the candidate's evidence over that of the model without it (Schwarz): negative speaks for it.

    n is the number of residuals, so a parameter has to lower the cost by ln n to earn its place (DIA-5).
    """
    n = fit.n_dof + len(fit.model.free_names)
    return candidate.fit.cost - fit.cost + len(candidate.params) * np.log(n)


def _ranked(fit: PlantFit, candidates: list[Candidate]) -> list[Group]:
    """Groups of candidates whose evidence differs by less than the data can tell, most probable first."""
    if not candidates:
        return []
    value = {id(c): _evidence(fit, c) for c in candidates}
    ordered = sorted(candidates, key=lambda c: value[id(c)])
    least = min(value[id(ordered[0])], 0.0)
    weight = {id(c): np.exp(-(value[id(c)] - least) / 2) for c in candidates}
    total = sum(weight.values()) + np.exp(least / 2)  # the model without any is a candidate too
    groups: list[list[Candidate]] = []
    for candidate in ordered:
        if groups and value[id(candidate)] - value[id(groups[-1][0])] < SAME:
            groups[-1].append(candidate)
        else:
            groups.append([candidate])
    return [Group(members, float(sum(weight[id(c)] for c in members) / total)) for members in groups]


def _without_the_needless(
    model: PlantModel,
    found: list[Group],
    fit: PlantFit,
    measured: list[Spectra],
    band: tuple[float, float] | None,
    on_step: Callable[[str], None],
) -> tuple[list[Group], PlantFit]:
    """Leave out again what later effects have made needless: a forward search can be led astray."""
    for group in list(found[:-1]):
        effect = group.effects[0]
        smaller = copy.deepcopy(fit.model)
        smaller.cov, smaller.fit = None, None
        smaller.effects = [e for e in smaller.effects if e.id != effect]
        on_step(f"trying without {effect}")
        try:
            without = fit_plant(smaller, measured, band=band)
        except (GsidError, InputError):
            continue
        price = len(group.candidates[0].params) * np.log(fit.n_dof)
        if without.cost - fit.cost < price:
            found, fit = [g for g in found if g is not group], without
    return found, fit


callable_as(diagnose)
