"""Whether the best law meets the conditions of a name: none, named, nearest or unknown.

A name needs a large share of the misfit kept out of the fit, a clear lead over the best other family, a
coefficient that is the same in all realisations, and no better rival from outside the catalogue. Rather
unknown than wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsid.diagnosis.missing_torque.free_functions import FreeFunction
from gsid.diagnosis.missing_torque.ranking import Candidate
from gsid.diagnosis.missing_torque.settings import SearchSettings


@dataclass(frozen=True)
class Conclusion:
    """Result of the decisions.

    Attributes
    ----------
    kind : {"none", "named", "nearest", "unknown"}
    effects : tuple of str
        The law named or nearest; several where only their family is certain. Empty else.
    reasons : tuple of str
        What kept a law from being named, one sentence each.
    beaten_by : tuple of str
        Laws from outside the catalogue that explain more.
    taken_over_by : tuple of str
        Free functions beside the law that explain much of what it leaves.
    """

    kind: str
    effects: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    beaten_by: tuple[str, ...] = ()
    taken_over_by: tuple[str, ...] = ()


@dataclass(frozen=True)
class Misfit:
    """The linear part alone.

    Attributes
    ----------
    cost, cost_per_dof, kept : float
    n_rows : int
        Whitened numbers.
    n_periods : int
        Of a single record; 0 with several.
    has_model_error : bool
        Whether the weights contain what the best law leaves: 1 is then this model error, not noise.
    """

    cost: float
    cost_per_dof: float
    kept: float
    n_rows: int
    n_periods: int
    has_model_error: bool = False

    @property
    def floor(self) -> float:
        """Kept-out cost that noise alone leaves; 0 where noise is none of it."""
        return 0.0 if self.has_model_error else 1.0

    @property
    def noise(self) -> float:
        """Two standard deviations of a mean of n_rows squares: less than this above 1 is noise.

        0 where a model error is in the weights: what is left then counts to the last bit.
        """
        return 0.0 if self.has_model_error else 2 * math.sqrt(2 / self.n_rows)

    def excess(self, kept: float) -> float:
        """Kept-out cost above noise.

        Parameters
        ----------
        kept : float
        """
        return max(kept - self.floor - self.noise, 0.0)

    def share(self, kept: float) -> float:
        """Share of the misfit that is explained, on what is kept out.

        Parameters
        ----------
        kept : float
        """
        left = self.excess(kept)
        if left == 0:
            return 1.0
        return 1 - left / (self.kept - self.floor) if self.kept > 1 else 0.0


def choose(candidates: Sequence[Candidate], misfit: Misfit, settings: SearchSettings) -> Candidate:
    """The best of the candidates: the least kept-out cost, or a simpler law of its family that is as good.

    Parameters
    ----------
    candidates : sequence of Candidate
        Refitted ones, at least one.
    misfit : Misfit
    settings : SearchSettings
    """
    least = min(candidates, key=lambda one: _reached(one, misfit))
    family = [one for one in candidates if one.family == least.family]
    best = min(family, key=lambda one: one.cost)
    good = [one for one in family if not _is_worse(one, best, misfit, settings)]
    return min(good, key=lambda one: (one.n_parameters, one.cost))


def _reached(one: Candidate, misfit: Misfit) -> float:
    """Kept-out cost that a fit has reached: linearised far from its minimum, it is that of the minimum."""
    return max(one.kept, one.cost / misfit.n_rows - misfit.noise)


def equals(
    best: Candidate, candidates: Sequence[Candidate], misfit: Misfit, settings: SearchSettings
) -> list[str]:
    """Other laws of the family that the data cannot tell from the best one.

    A law with more parameters that is not significantly better is none of them. Where noise is not all that
    is left, errors of the motion weigh more than noise: only a simulation can tell the members then.

    Parameters
    ----------
    best, candidates, misfit, settings
        As `choose`.
    """
    others = [one for one in candidates if one.family == best.family and one is not best]
    if best.kept > settings.member_cost and not misfit.has_model_error:
        return [one.name for one in others if one.kept - 1 < 2 * (best.kept - 1)]
    return [
        one.name
        for one in others
        if one.n_parameters <= best.n_parameters and not _is_worse(one, best, misfit, settings)
    ]


def _is_worse(one: Candidate, best: Candidate, misfit: Misfit, settings: SearchSettings) -> bool:
    scale = max(best.cost / misfit.n_rows, 1.0)
    needed = settings.member_gain + settings.member_share * (misfit.cost - best.cost) / scale
    return (one.cost - best.cost) / scale > needed


def margin(best: Candidate, rivals: Sequence[Candidate], misfit: Misfit) -> float:
    """Kept-out excess of the best rival of another family, over that of the best law.

    Parameters
    ----------
    best : Candidate
    rivals : sequence of Candidate
        Refitted ones, the best among them.
    misfit : Misfit
    """
    others = [one.kept for one in rivals if one.family != best.family]
    least = max(misfit.noise / 2, 1e-12)
    return max(min([*others, misfit.kept]) - misfit.floor, 0.0) / max(best.kept - misfit.floor, least)


def lead(best: Candidate, rivals: Sequence[Candidate], misfit: Misfit) -> float:
    """Drop of the cost against the best rival of another family, or nothing missing.

    Parameters
    ----------
    best, rivals, misfit
        As `margin`.
    """
    others = [one.cost for one in rivals if one.family != best.family]
    return min([*others, misfit.cost]) - best.cost


def is_beaten_by_none(best: Candidate, rivals: Sequence[Candidate], misfit: Misfit) -> bool:
    """Whether the linear part alone costs less than each law of another family.

    Parameters
    ----------
    best, rivals, misfit
        As `margin`.
    """
    return all(one.cost >= misfit.cost for one in rivals if one.family != best.family)


def conclude(
    best: Candidate,
    rivals: Sequence[Candidate],
    enlarged: Sequence[Candidate],
    misfit: Misfit,
    settings: SearchSettings,
    free: Sequence[FreeFunction] = (),
) -> Conclusion:
    """Judge the best law.

    Parameters
    ----------
    best : Candidate
        As `choose` gives it.
    rivals : sequence of Candidate
        All that were refitted, the best among them.
    enlarged : sequence of Candidate
        Refitted rivals from outside the catalogue.
    misfit : Misfit
    settings : SearchSettings
    free : sequence of FreeFunction
        Free functions beside the best law, with the weights of noise.
    """
    gain = misfit.cost - min([best.cost, *(one.cost for one in enlarged)])
    needed = _gain_by_chance(best, misfit, settings)
    # What is kept out chooses the best, though another one may lower the cost more.
    others = any(misfit.cost - one.cost >= _gain_by_chance(one, misfit, settings) for one in rivals)
    is_small = misfit.cost_per_dof < settings.null_cost and not misfit.has_model_error
    if is_small and gain < needed and not others:
        return Conclusion("none")
    share = misfit.share(best.kept)
    reasons = _against(best, rivals, enlarged, misfit, settings)
    beaten = tuple(one.name for one in enlarged if one.cost < best.cost - settings.enlarged_gain)
    taken = tuple(one.name for one in free if _takes_over(one, best, misfit, settings))
    reasons += [taken_over(name) for name in taken]
    if best.kept > settings.verdict_cost or share < settings.nearest_share or gain < needed:
        return Conclusion("unknown", (), tuple(reasons), beaten, taken)
    if not reasons:
        return Conclusion("named", (best.name, *equals(best, rivals, misfit, settings)))
    if beaten or not _steady(best, settings.nearest_scatter, settings):
        return Conclusion("unknown", (), tuple(reasons), beaten, taken)
    effects = (best.name, *equals(best, rivals, misfit, settings))
    return Conclusion("nearest", effects, tuple(reasons), (), taken)


def _gain_by_chance(one: Candidate, misfit: Misfit, settings: SearchSettings) -> float:
    """Fall of the cost that the best of many laws of as many parameters has by chance."""
    return one.n_parameters * math.log(misfit.n_rows) + settings.null_gain


def better_outside(law: str) -> str:
    """Sentence on a law from outside the catalogue that is better than the best of it.

    Parameters
    ----------
    law : str
        Its expression.
    """
    return f"In the first stage {law} explains more, and is not in the catalogue."


def too_small(share: float, least: float) -> str:
    """Sentence on a law that explains too little.

    Parameters
    ----------
    share, least : float
        Share of the misfit that it explains where it was not fitted, and the one required.
    """
    explained = f"The best law explains {100 * max(share, 0.0):.0f} % of the misfit on held-out data"
    return f"{explained}; {100 * least:.0f} % are required."


def too_close(leaves: float, lead: float, is_linear_part: bool = False) -> str:
    """Sentence on a law of another family that is nearly as good, or better.

    Parameters
    ----------
    leaves : float
        What it leaves, over what the best law leaves.
    lead : float
        Its cost less that of the best law.
    is_linear_part : bool
        Whether it is the fit without a law instead.
    """
    if is_linear_part:
        differs = f"its cost is {abs(lead):.0f} {'lower' if lead < 0 else 'higher'}"
        return f"The linear part alone leaves {leaves:.2g} times what the best law leaves; {differs}."
    if lead < 0:
        return f"A law of another family fits better (cost lower by {-lead:.0f})."
    leaves_as_much = f"The best law of another family leaves only {leaves:.2g} times as much"
    return f"{leaves_as_much}, and its cost is {lead:.0f} higher. It cannot be excluded."


def inexact(kind: str, share: float, least: float) -> str:
    """Sentence on an effect that does not depend on the measured motion, and explains too little.

    Parameters
    ----------
    kind : str
    share, least : float
        As `too_small`.
    """
    required = f"A {kind} has to explain {100 * least:.3g} % of the misfit on held-out data"
    return f"{required}; the best one explains {100 * share:.2f} %."


def scattered(scatter: float) -> str:
    """Sentence on a coefficient that differs between realisations.

    Parameters
    ----------
    scatter : float
        Relative to the coefficient.
    """
    return f"The coefficient of the best law varies by {100 * scatter:.0f} % between realisations."


def too_short(n_periods: int, least: int) -> str:
    """Sentence on a single record that is too short.

    Parameters
    ----------
    n_periods, least : int
        Number of its periods, and the one required.
    """
    short = f"One record of {n_periods} periods is too short to measure the scatter of the coefficient"
    return f"{short}; {least} periods are required."


def taken_over(name: str) -> str:
    """Sentence on a free function that explains most of what a law leaves.

    Parameters
    ----------
    name : str
        What it is a function of.
    """
    return f"A free function, {name}, explains much of what the best law leaves: the law is another one."


def _takes_over(one: FreeFunction, best: Candidate, misfit: Misfit, settings: SearchSettings) -> bool:
    """Whether a free function explains so much of what the law leaves that the law is another one."""
    least = settings.free_share_of_error if misfit.has_model_error else settings.free_share
    if one.family != best.family or (misfit.has_model_error and one.family != "position"):
        return False  # beside friction a second effect that is missing looks like that
    large = one.of_misfit > settings.free_least and one.price > settings.free_price
    clear = one.price > settings.free_clear_price
    return one.share > least and (large or clear)


def _against(
    best: Candidate,
    rivals: Sequence[Candidate],
    enlarged: Sequence[Candidate],
    misfit: Misfit,
    settings: SearchSettings,
) -> list[str]:
    """What keeps a law from being named."""
    reasons = []
    share, lead_over = misfit.share(best.kept), margin(best, rivals, misfit)
    if share < settings.named_share:
        reasons.append(too_small(share, settings.named_share))
    adequate = misfit.excess(best.kept) == 0
    ahead = lead(best, rivals, misfit)
    if lead_over < settings.named_margin and not (adequate and ahead >= settings.named_lead):
        reasons.append(too_close(lead_over, ahead, is_beaten_by_none(best, rivals, misfit)))
    if not adequate and not best.along_motion and share < settings.exact_share:
        kind = "linear effect" if best.law is None else "law of the command"
        reasons.append(inexact(kind, share, settings.exact_share))
    if not _steady(best, settings.named_scatter, settings):
        reasons.append(scattered(best.scatter))
    reasons += [better_outside(one.name) for one in enlarged if one.cost < best.cost - settings.enlarged_gain]
    if best.kept < settings.unconverged * best.cost / misfit.n_rows:
        reasons.append("The fit of the best law has not converged.")
    if best.kept > settings.verdict_cost:
        reasons.append(f"What is left has {best.kept:.3g} times the power of noise.")
    if 0 < misfit.n_periods < settings.periods_least and not misfit.has_model_error:
        reasons.append(too_short(misfit.n_periods, settings.periods_least))
    return reasons


def _steady(best: Candidate, most: float, settings: SearchSettings) -> bool:
    noise = settings.scatter_errors * best.scatter_error
    return bool(best.scatter <= max(most, noise)) and bool(np.isfinite(best.scatter))
