"""Fits by simulation that a decision compares: what each explains, and which is better."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from scipy import special

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.doubts import doubts
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.model_error import weighed
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.from_records.what_is_left import what_is_left
from gsid.diagnosis.missing_torque.catalogue import contains_spring, family
from gsid.effects.types import find
from gsid.greybox.fit import PlantFit

SEARCHED = ("hard_stop", "gear_backlash")  # laws with a search of their own beside the first stage
# Families of laws that a linear effect does the work of, where the amplitudes do not differ enough.
COUNTERPARTS = {"damping": ("drag", "dry friction"), "spring": ("position",)}


@dataclass(frozen=True, eq=False)
class Evidence:
    """Fits by simulation that a decision compares.

    Attributes
    ----------
    null : Simulated
        The linear part alone.
    laws : sequence of Simulated
        With one law each.
    beaten_by : tuple of str
        Laws from outside the catalogue that explained more than the best one in the first stage.
    settings : DecisionSettings
    taken_over_by : tuple of str
        Free functions that explained most of what the best law left in the first stage.
    all_linear : bool
        Whether a linear effect may be missing and all of them were tried: else one may stand for another.
    beaten : str
        Best law of the first stage, which `beaten_by` refers to; empty: every law.
    what_is_left : callable
        p-values of what a fit leaves, by coordinate, where it lowers the cost by a least number.
    doubts : callable
        What speaks against a law, from its fit and that of the linear part.
    """

    null: Simulated
    laws: Sequence[Simulated]
    beaten_by: tuple[str, ...]
    settings: DecisionSettings
    taken_over_by: tuple[str, ...] = ()
    all_linear: bool = True
    beaten: str = ""
    what_is_left: Callable[[PlantFit, float], Mapping[str, float]] = what_is_left
    doubts: Callable[[PlantFit, PlantFit, str, DecisionSettings], list[str]] = doubts

    @property
    def has_model_error(self) -> bool:
        """Whether the weights contain what the best law leaves: 1 is then this model error, not noise."""
        return self.null.weighed is not None

    @property
    def floor(self) -> float:
        """Kept-out cost that noise alone leaves; 0 where noise is none of it."""
        return 0.0 if self.has_model_error else 1.0

    @property
    def noise(self) -> float:
        """Two standard deviations of a mean of that many squares: less than this above 1 is noise."""
        return 0.0 if self.has_model_error else 2 * math.sqrt(2 / self.null.fit.n_dof)

    def weighed(self) -> Evidence:
        """The same with the weights of what the best law leaves, where that is more than noise."""
        best = self.best()
        if best.fit.cost_per_dof < self.settings.much_left:
            return self
        null, laws = weighed(self.null, self.laws, best, self.settings)
        return replace(self, null=null, laws=laws)

    def kept(self, one: Simulated) -> float:
        """Kept-out cost; that of the linear part for a law that lowers no cost.

        Linearised at a strength of 0 any shape of a law is as good, and the records left out may choose one.

        Parameters
        ----------
        one : Simulated
        """
        return one.kept if one.cost < self.null.cost else max(one.kept, self.null.kept)

    def excess(self, one: Simulated) -> float:
        """Kept-out cost above noise.

        Parameters
        ----------
        one : Simulated
        """
        return max(self.kept(one) - self.floor - self.noise, 0.0)

    def share(self, one: Simulated) -> float:
        """Share of the misfit that a law explains, on what is kept out.

        Parameters
        ----------
        one : Simulated
        """
        left = self.excess(one)
        if left == 0 or self.is_exact(one):
            return 1.0
        return 1 - left / (self.null.kept - self.floor) if self.null.kept > 1 else 0.0

    def is_adequate(self, one: Simulated) -> bool:
        """Whether a fit leaves only noise: as little as noise does, or no more than it does by chance.

        Parameters
        ----------
        one : Simulated
        """
        if self.has_model_error:
            return False
        small = one.fit.cost_per_dof <= self.settings.adequate
        return small or self.excess(one) == 0 or one.noise_p_value >= self.settings.p_adequate

    def from_outside(self, one: Simulated) -> tuple[str, ...]:
        """Laws from outside the catalogue that speak against a law: those that beat it in the first stage.

        They do not speak against a law that leaves only noise if they beat one of another family, or if a
        search beside the first stage has found it.

        Parameters
        ----------
        one : Simulated
        """
        own = one.effects[0]
        is_another = bool(self.beaten) and (
            family(find(self.beaten)) != family_of(one) or (own in SEARCHED and own != self.beaten)
        )
        return () if is_another and self.is_adequate(one) else self.beaten_by

    def depends_on(self, one: Simulated) -> dict[str, float]:
        """Coordinates that what a fit leaves depends on, with p-values, though its cost is that of noise.

        What is small against the fall of the cost is not counted, as it is not where more than noise is left.

        Parameters
        ----------
        one : Simulated
        """
        if not self.is_adequate(one):
            return {}
        least = (1 - self.settings.linear_share) * (self.null.cost - one.cost)
        found = self.what_is_left(one.fit, least)
        return {name: p_value for name, p_value in found.items() if p_value < self.settings.p_left}

    def is_nothing_missing(self) -> bool:
        """Whether the linear part alone leaves only noise, and no law lowers its cost by more than chance.

        The first stage takes a law along the measured motion, whose errors it may follow.
        """
        if not may_be_noise(self.null, self.settings):
            return False
        unit = math.log(self.null.fit.n_dof)
        gains = [self.null.cost - one.cost - n_parameters(one) * unit for one in self.laws]
        return max(gains) < self.settings.null_gain

    def rivals(self, one: Simulated) -> list[Simulated]:
        """Fits of laws of other families; not of a law that contains it and is not significantly better.

        Parameters
        ----------
        one : Simulated
        """
        others = [other for other in self.laws if family_of(other) != family_of(one)]
        others = [other for other in others if not contains(other, one) or self.is_worse(one, other)]
        return [other for other in others if not self.is_settled(other, one)]

    def is_settled(self, other: Simulated, best: Simulated) -> bool:
        """Whether a law is in the group of the best one, or linear as it and with more parameters.

        So is one of the family of a member of the group that is not significantly better than the best: a
        hysteresis, where a damping and a dry friction are the group.

        Parameters
        ----------
        other, best : Simulated
        """
        both = self.is_among_linear(other) and self.is_among_linear(best) and self.is_adequate(best)
        more = n_parameters(other) > n_parameters(best) and self.priced(other) > self.priced(best)
        group = self.alike(best)
        is_of_group = any(family_of(other) == family_of(member) for member in group)
        return (both and more) or other in group or (is_of_group and not self.is_worse(best, other))

    def margin(self, one: Simulated) -> float:
        """What the best rival of another family leaves, over what the law leaves.

        Parameters
        ----------
        one : Simulated
        """
        least = min(self.kept(other) for other in [self.null, *self.rivals(one)])
        return max(least - self.floor, 0.0) / max(self.kept(one) - self.floor, self.noise / 2)

    def lead(self, one: Simulated) -> float:
        """Drop of the cost against the best rival of another family, or nothing missing.

        Parameters
        ----------
        one : Simulated
        """
        return min(other.cost for other in [self.null, *self.rivals(one)]) - one.cost

    def is_beaten_by_none(self, one: Simulated) -> bool:
        """Whether the linear part alone costs less than each law of another family.

        Parameters
        ----------
        one : Simulated
        """
        return all(other.cost >= self.null.cost for other in self.rivals(one))

    def is_clear(self, one: Simulated) -> bool:
        """Whether a law that leaves only noise is better than nothing missing and all rivals.

        Parameters
        ----------
        one : Simulated
        """
        if not (self.is_among_linear(one) and all(map(_is_linear, self.alike(one)))):
            return self.lead(one) >= self.settings.named_lead
        if self.null.cost - one.cost < self.settings.linear_drop:
            return False
        return all(self.is_less_likely(other, one) for other in self.rivals(one))

    def is_among_linear(self, one: Simulated) -> bool:
        """Whether a fit is that of a linear effect, and all linear effects were its rivals.

        Parameters
        ----------
        one : Simulated
        """
        return bool(one.effects) and is_linear(one.effects[0]) and self.all_linear

    def is_exact(self, one: Simulated) -> bool:
        """Whether a linear effect leaves no significant misfit, beside all others that were tried.

        Parameters
        ----------
        one : Simulated
        """
        is_chance = one.noise_p_value >= special.ndtr(-self.settings.significant)
        return self.is_among_linear(one) and self.is_adequate(one) and bool(is_chance)

    def is_less_likely(self, one: Simulated, other: Simulated) -> bool:
        """Whether the odds of a fit against another, with a price for each parameter, exclude it (DIA-12).

        Parameters
        ----------
        one, other : Simulated
        """
        return self.priced(one) - self.priced(other) > 2 * math.log(self.settings.linear_odds)

    def priced(self, one: Simulated) -> float:
        """Cost of a fit with ln n for each parameter.

        Parameters
        ----------
        one : Simulated
        """
        return one.cost + n_parameters(one) * math.log(self.null.fit.n_dof)

    def is_worse(self, one: Simulated, best: Simulated) -> bool:
        """Whether a law is significantly worse than the best of its family.

        Where a model error is left, a simpler law is worse only if it leaves twice as much: what shapes
        with more parameters take of the error is no evidence for them.

        Parameters
        ----------
        one, best : Simulated
        """
        simpler = n_parameters(one) < n_parameters(best)
        if self.has_model_error and simpler and self.kept(one) < self.settings.member_ratio * self.kept(best):
            return False
        scale = max(best.cost / best.fit.n_dof, 1.0)
        share = 0.0 if self.is_adequate(best) else self.settings.worse_share * best.fit.n_dof
        return (one.cost - best.cost) / scale > self.settings.worse + share

    def best(self) -> Simulated:
        """The law that leaves least, or a simpler one of its family that is not significantly worse."""
        least = self.least()
        members = [one for one in self.laws if family_of(one) == family_of(least) or contains(least, one)]
        top = min(members, key=lambda one: one.cost)
        good = [one for one in members if not self.is_worse(one, top)]
        best = min(good, key=lambda one: (n_parameters(one), one.cost))
        return self.likeliest(best)

    def least(self) -> Simulated:
        """The law that leaves least where it was not fitted, unless one that leaves noise is far likelier.

        There the scatter of what is kept out is larger than the misfit of a weak law. A stop that is touched
        in one realisation explains nothing where that is left out.
        """
        least = min(self.laws, key=self.kept)
        adequate = [one for one in self.laws if self.is_adequate(one)]
        likeliest = min(adequate, key=self.priced, default=least)
        return likeliest if self.is_less_likely(least, likeliest) else least

    def likeliest(self, best: Simulated) -> Simulated:
        """A linear effect instead of the best law, if it is likelier or simpler, and only noise is left.

        A mode of three parameters can take the place of any other linear effect.

        Parameters
        ----------
        best : Simulated
            Of all laws.
        """
        if not self.is_adequate(best):
            return best
        linear = [one for one in self.laws if self.is_among_linear(one) and self.is_adequate(one)]
        likeliest = min([best, *linear], key=self.priced)
        as_good = [one for one in linear if self.is_counterpart(one, likeliest)]
        return min(as_good, key=self.priced, default=likeliest)

    def is_counterpart(self, one: Simulated, law: Simulated) -> bool:
        """Whether a linear effect does the same as a law of as many parameters.

        Parameters
        ----------
        one, law : Simulated
        """
        kind = find(one.effects[0]).linear_part
        if family_of(law) not in COUNTERPARTS.get(kind, ()) or not self.is_among_linear(one):
            return False
        alike = self.is_adequate(one) and self.is_adequate(law) and n_parameters(one) == n_parameters(law)
        return alike and not (self.is_less_likely(one, law) or self.is_less_likely(law, one))

    def group(self, best: Simulated) -> tuple[str, ...]:
        """The best law and others that are as simple and not significantly worse.

        Parameters
        ----------
        best : Simulated
        """
        return (best.effects[0], *(one.effects[0] for one in self.alike(best)))

    def alike(self, best: Simulated) -> list[Simulated]:
        """The other laws of the best one's group.

        Parameters
        ----------
        best : Simulated
        """
        simple = [one for one in self.laws if one is not best and n_parameters(one) <= n_parameters(best)]
        return [one for one in simple if self.is_alike(one, best)]

    def is_alike(self, one: Simulated, best: Simulated) -> bool:
        """Whether the data do not tell a law from the best: one of its family, or one of them is linear.

        Odds decide between linear effects, a lag and a delay too. A simpler law of the family needs a clear
        difference to be excluded, not just a significant one.

        Parameters
        ----------
        one, best : Simulated
        """
        if self.is_among_linear(one) and self.is_among_linear(best) and self.is_adequate(best):
            return self.is_adequate(one) and not self.is_less_likely(one, best)
        if family_of(one) == family_of(best):
            simpler = n_parameters(one) < n_parameters(best) and self.is_adequate(one)
            is_near = simpler and one.cost - best.cost <= self.settings.clearly_worse
            return is_near or not self.is_worse(one, best)
        return self.is_counterpart(best, one)


def _is_linear(one: Simulated) -> bool:
    return is_linear(one.effects[0])


def may_be_noise(null: Simulated, settings: DecisionSettings) -> bool:
    """Whether a linear part alone leaves so little that nothing may be missing.

    Parameters
    ----------
    null : Simulated
    settings : DecisionSettings
    """
    spread = math.sqrt(2 / null.fit.n_dof)
    return null.fit.cost_per_dof < max(settings.null_cost, 1 + settings.null_spread * spread)


def contains(one: Simulated, other: Simulated) -> bool:
    """Whether a law contains another one of another family: an unbalance, a cogging or a stop a spring.

    Parameters
    ----------
    one, other : Simulated
    """
    if not (one.effects and other.effects) or find(other.effects[0]).linear_part != "spring":
        return False
    return contains_spring(find(one.effects[0]))


def family_of(one: Simulated) -> str:
    """Family of a fit's law.

    Parameters
    ----------
    one : Simulated
    """
    return family(find(one.effects[0]))


def n_parameters(one: Simulated) -> int:
    """Number of the law's parameters.

    Parameters
    ----------
    one : Simulated
    """
    return len(find(one.effects[0]).parameters)


def is_simpler_of_angle(one: Simulated, best: Simulated) -> bool:
    """Whether a law of the angle stays simpler than the best one with a constant torque beside it.

    Parameters
    ----------
    one, best : Simulated
    """
    of_angle = find(one.effects[0]).c.looks_at_angle and find(best.effects[0]).c.looks_at_angle
    return bool(of_angle) and n_parameters(one) + 1 < n_parameters(best)
