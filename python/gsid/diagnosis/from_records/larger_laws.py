"""Larger laws that contain the best one and that the data do not exclude (DIA-14).

A law with more parameters fits at least as well as the law that it contains, and the simpler one is named.
Where the effect is weak, the same data also fit a quite different shape of the larger law: a friction that
doubles at low speed, or one that begins within the travel. Then the two are a group, and the next experiment
is one in which they differ.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.evidence import Evidence, contains, family_of
from gsid.diagnosis.from_records.law_part import label_of, without
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.unsearched_laws import as_good_remark, unsearched_as_good
from gsid.diagnosis.from_records.what_is_left import along_simulated_motion
from gsid.diagnosis.missing_torque import catalogue
from gsid.diagnosis.missing_torque.law_columns import Law, torque_lines, torques
from gsid.diagnosis.missing_torque.linear_fit import basis
from gsid.diagnosis.missing_torque.motion import motions
from gsid.diagnosis.missing_torque.problem import linear_part
from gsid.diagnosis.missing_torque.ranking import solved
from gsid.effects.types import catalogue as effect_types
from gsid.effects.types import find
from gsid.greybox.fit import PlantFit
from gsid.plant.model import PlantModel

Accepts = Callable[[float, float], bool]  # of the rise of the cost and the difference of a shape


@dataclass(frozen=True, eq=False)
class LargerLaw:
    """A shape of a larger law that fits as well as the law that it contains, or better.

    Attributes
    ----------
    effect : str
    params : dict of float
    rise : float
        Of the cost; below 0 it fits better.
    difference : float
        Of its torque along the motion from any multiple of that of the simpler law, over its rms; or over its
        peak, where it differs by more during some of the time.
    model : PlantModel
        The fitted model with this law in place of the simpler one.
    """

    effect: str
    params: dict[str, float]
    rise: float
    difference: float
    model: PlantModel

    def remark(self, simpler: str) -> str:
        """What is reported of it.

        Parameters
        ----------
        simpler : str
            The law that it contains.
        """
        values = ", ".join(f"{name} {value:.3g}" for name, value in self.params.items())
        return (
            f"These records do not exclude {self.effect}: with {values} its torque differs from that of"
            f" {simpler} by {self.difference:.0%}, and the cost by {self.rise:+.1f}."
        )


def add_larger_laws(run: Run) -> None:
    """Put larger laws that the data do not exclude into the group of the best law; in place.

    Only where the best law leaves no more than noise. In a closed loop the motion reacts to the torque
    through the controller, which the columns do not contain.

    Parameters
    ----------
    run : Run
        With its decision.
    """
    decision, final = run.decision, run.final
    if not decision.effects or final is None or run.in_closed_loop or final.model.has_controller:
        return
    if not run.evidence().is_adequate(final):
        return
    left_out = {*run.without, *decision.effects, *(effect.id for effect in final.model.effects)}
    is_over = run.deadline.is_over
    found = [] if is_over else not_excluded(final.fit, final.effects[0], left_out, run.settings)
    alike = as_good(run.evidence(), final, decision.effects)
    unsearched = unsearched_as_good(run, final, left_out)
    run.larger = {one.effect: one.model for one in found}
    run.larger |= {one.effects[0]: one.model for one in [*alike, *unsearched]}
    effects = (*decision.effects, *run.larger)
    run.decision = replace(decision, effects=effects)
    run.basis = run.basis and replace(run.basis, effects=effects)
    run.notes += [one.remark(final.effects[0]) for one in found]
    run.notes += [
        f"{one.effects[0]} fits these records as well (cost {one.cost - final.cost:+.1f}), with more"
        f" parameters; over another motion it may differ from {final.effects[0]}."
        for one in alike
    ]
    run.notes += [as_good_remark(one, final) for one in unsearched]


def as_good(evidence: Evidence, best: Simulated, group: Collection[str]) -> list[Simulated]:
    """Laws of the best one's family with more parameters that leave only noise too.

    Those with as many are in the group already; those that contain it are judged by their shapes. Within the
    travel of the records a cogging may be a cubic spring; beyond it they are different laws.

    Parameters
    ----------
    evidence : Evidence
    best : Simulated
    group : collection of str
        The best law and those that are in its group already.
    """
    return [
        one
        for one in evidence.laws
        if one.effects[0] not in group
        and family_of(one) == family_of(best)
        and not (contains(one, best) or _is_simpler_of(best.effects[0], one.effects[0]))
        and evidence.is_adequate(one)
        and (one.converged or one.stalled)
        and not evidence.is_worse(one, best)
    ]


def _is_simpler_of(effect: str, larger: str) -> bool:
    """Whether a law is another one at an end of its shapes, or at several such ends in turn."""
    simpler = find(larger).simpler
    return bool(simpler) and (simpler == effect or _is_simpler_of(effect, simpler))


def not_excluded(
    fit: PlantFit, effect: str, left_out: set[str], settings: DecisionSettings
) -> list[LargerLaw]:
    """The best shape of each larger law that differs from the law of a fit and fits as well.

    Parameters
    ----------
    fit : PlantFit
        By simulation, with the law.
    effect : str
        The law.
    left_out : set of str
        Larger laws that are not considered.
    settings : DecisionSettings
    """
    return _best_shapes(fit, effect, left_out, settings, _differs(settings))


def worth_a_fit(
    fit: PlantFit, effect: str, left_out: set[str], settings: DecisionSettings
) -> list[LargerLaw]:
    """The best shape of each larger law that fits clearly better than the law of a fit, or as `not_excluded`.

    Clearly: by more than the cost that is not significant, over the cost per degree of freedom.

    Parameters
    ----------
    fit, effect, left_out, settings
        As `not_excluded`.
    """
    differs, clear = _differs(settings), -settings.worse * max(fit.cost_per_dof, 1.0)

    def is_start(rise: float, difference: float) -> bool:
        return differs(rise, difference) or (rise < clear and difference > 0)

    return _best_shapes(fit, effect, left_out, settings, is_start)


def _differs(settings: DecisionSettings) -> Accepts:
    return lambda _rise, difference: difference >= settings.different


def _best_shapes(
    fit: PlantFit,
    effect: str,
    left_out: set[str],
    settings: DecisionSettings,
    accepts: Accepts,
) -> list[LargerLaw]:
    """The best shape of each larger law."""
    larger = [
        each
        for each in effect_types().values()
        if each.simpler == effect and each.id not in left_out and not each.not_searched
    ]
    profile = _Profile(fit, effect, settings) if larger else None
    found = [profile.best_shape(catalogue.law(each), accepts) for each in larger]
    return [one for one in found if one is not None]


class _Profile:
    """Cost of a fit with another law in place of its own, along the simulated motion.

    The other parameters of the fit follow: what they can do is projected out.
    """

    def __init__(self, fit: PlantFit, effect: str, settings: DecisionSettings) -> None:
        self.fit, self.effect, self.settings = fit, effect, settings
        self.problem = along_simulated_motion(fit)
        part = linear_part(fit.model)
        self.moved, self.entries = motions(self.problem, part), self.problem.responses(part)
        self.scales = catalogue.scales(self.problem, self.moved)
        label = label_of(fit.model, effect)
        own = np.array([name.rpartition(".")[0] == label for name in fit.model.free_names], bool)
        self.known = basis(fit.jacobian[:, ~own])
        law, params = catalogue.law(find(effect)), fit.model.stack()[label]
        shape = np.array([params[p.name] for p in law.shapes])
        c = np.array([params[p.name] for p in law.coefficients])
        self.torque = self._torque(law, shape, c)
        self.left = fit.residual - self._columns(law, shape[None, :])[0] @ c  # without the law

    def best_shape(self, law: Law, accepts: Accepts) -> LargerLaw | None:
        """The shape of a law that fits best of those that are accepted; None if there is none.

        Parameters
        ----------
        law : Law
        accepts : callable
            Whether a shape with this rise and this difference (see `LargerLaw`) may be the one.
        """
        points, best = law.points(self.scales), None
        if not len(points):
            return None
        for shape, columns in zip(points, self._columns(law, points), strict=True):
            for c in self._within_reach(law, columns):
                error = self.left + columns @ c
                rise = float(error @ error - self.fit.cost)
                if rise > (self.settings.worse if best is None else best[0]):
                    continue
                difference = self._difference(self._torque(law, shape, c))
                if accepts(rise, difference):
                    best = rise, shape, c, difference
        if best is None:
            return None
        rise, shape, c, difference = best
        params = law.params(shape, c)
        model = without(self.fit.model, [self.effect]).with_effect(law.effect.id, params)
        return LargerLaw(law.effect.id, params, rise, difference, model)

    def _within_reach(self, law: Law, columns: np.ndarray) -> list[np.ndarray]:
        """The coefficients that fit best, and those three standard deviations off in each of them."""
        _, best = solved(columns.T, -self.left, law.lower)
        spread = np.linalg.pinv(columns.T @ columns)
        std = np.sqrt(np.diag(spread))
        moves = [self.settings.significant * spread[:, i] / std[i] for i in np.flatnonzero(std > 0)]
        reached = [best, *(best + sign * move for move in moves for sign in (-1, 1))]
        return [c for c in reached if np.all(c >= law.lower)]

    def _columns(self, law: Law, shapes: np.ndarray) -> np.ndarray:
        """What unit coefficients change of the residual beside the other parameters, (shapes, rows, c)."""
        problem, changes = self.problem, []
        for r, lines in zip(problem.records, torque_lines(law, shapes, problem, self.moved), strict=True):
            whole = np.zeros((lines.shape[0] * lines.shape[1], len(r.y)), complex)
            whole[:, r.line] = (lines * self.entries[r.group][1]).reshape(len(whole), -1)
            changes.append(whole)
        columns = self.fit.whitened(changes)
        columns = columns - self.known @ (self.known.T @ columns)
        return np.moveaxis(columns.reshape(len(columns), len(shapes), -1), 1, 0)

    def _torque(self, law: Law, shape: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Torque of a law along the motion of all records."""
        values = law.unit_values(shape)
        return np.concatenate([c @ torques(law, values, m, self.problem.radians) for m in self.moved])

    def _difference(self, torque: np.ndarray) -> float:
        """Share of a torque that is no multiple of the fitted law's; 0 with a peak far above it.

        Of its rms, or of its peak: a friction that is twice as large at low speed matters where the axis
        reverses, though it moves faster most of the time.
        """
        power, own = float(torque @ torque), float(self.torque @ self.torque)
        highest = float(np.max(np.abs(torque)))
        if power == 0 or own == 0 or highest > self.settings.peak_most * np.max(np.abs(self.torque)):
            return 0.0
        apart = np.abs(torque - (torque @ self.torque) / own * self.torque)
        of_peak = float(np.quantile(apart, 1 - self.settings.seldom)) / highest
        return max(float(np.sqrt(apart @ apart / power)), of_peak)
