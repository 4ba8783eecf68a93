"""Whether a law meets the conditions of a name, from the fits by simulation.

A name needs a converged fit that leaves only noise, or a large share of the misfit explained where it was not
fitted; a clear lead over laws of other families that were fitted as well; a coefficient that is the same in
all realisations; and no simpler law of its family that is as good. Otherwise it is the nearest, or unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.draft import is_linear
from gsid.diagnosis.from_records.evidence import Evidence, n_parameters
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.missing_torque.catalogue import law
from gsid.diagnosis.missing_torque.conclusion import (
    better_outside,
    inexact,
    scattered,
    taken_over,
    too_close,
    too_short,
    too_small,
)
from gsid.diagnosis.missing_torque.stage import FirstStage
from gsid.effects.types import find

ADEQUATE, MISSING, NEAREST, UNKNOWN = "adequate", "missing_effect", "nearest_effect", "unknown_effect"


@dataclass(frozen=True)
class Decision:
    """The verdict with its numbers.

    Attributes
    ----------
    verdict : {"adequate", "missing_effect", "nearest_effect", "unknown_effect"}
    effects : tuple of str
        The law named or nearest; several where the data do not distinguish them.
    reasons : tuple of str
        What kept a law from being named, one sentence each.
    unexplained_share : float or None
        Share of the misfit that the law leaves, where it was not fitted. None without a law, where the misfit
        is so small that its size is not known, and for a law that is nearest though it explains little.
    """

    verdict: str
    effects: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    unexplained_share: float | None = None


OF_FIRST_STAGE = {"none": ADEQUATE, "named": NEAREST, "nearest": NEAREST, "unknown": UNKNOWN}


def by_first_stage(stage: FirstStage) -> Decision:
    """The first draft, which names nothing: a name needs a fit by simulation.

    Parameters
    ----------
    stage : FirstStage
    """
    conclusion = stage.conclusion
    verdict = OF_FIRST_STAGE[conclusion.kind]
    share = None if verdict == ADEQUATE else 1 - stage.ranking[0].share_kept_out
    reasons = conclusion.reasons
    if conclusion.kind == "named":
        reasons = ("No fit by simulation has confirmed it.",)
    return Decision(verdict, conclusion.effects, reasons, share)


def decide(evidence: Evidence) -> Decision:
    """Judge the best law.

    Parameters
    ----------
    evidence : Evidence
        With at least one law.
    """
    best, settings = evidence.best(), evidence.settings
    if evidence.is_nothing_missing():
        return Decision(ADEQUATE)
    share, effects = evidence.share(best), evidence.group(best)
    left = 1 - share if evidence.excess(evidence.null) > 0 else None
    reasons = tuple(against(evidence, best))
    if not reasons:
        return Decision(MISSING, effects, (), left)
    adequate = evidence.is_adequate(best)
    steady = adequate or is_steady(best, settings.nearest_scatter, settings)
    explains_little = share < settings.nearest_share  # as a stop that one realisation touches
    if (
        (explains_little and not (adequate and evidence.is_clear(best)))
        or best.cost >= evidence.null.cost
        or not steady
        or (evidence.beaten_by and not adequate)  # by little, along the measured motion with its errors
        or not (adequate or best.has_reliable_share or evidence.margin(best) >= settings.named_margin)
    ):
        return Decision(UNKNOWN, (), reasons, left)
    return Decision(NEAREST, effects, reasons, None if explains_little else left)


def is_steady(one: Simulated, most: float, settings: DecisionSettings) -> bool:
    """Whether the coefficient is the same in all realisations, within a scatter or within noise.

    Parameters
    ----------
    one : Simulated
    most : float
        Largest scatter, relative to the coefficient.
    settings : DecisionSettings
    """
    return one.scatter <= max(most, settings.scatter_errors * one.scatter_error)


def is_undetermined_alone(one: Simulated, settings: DecisionSettings) -> bool:
    """Whether no realisation alone determines the coefficient of a law of many shapes: it may be another law.

    Parameters
    ----------
    one : Simulated
    settings : DecisionSettings
    """
    has_many_shapes = n_parameters(one) >= settings.many_shapes and not is_linear(one.effects[0])
    return has_many_shapes and one.scatter > settings.shape_scatter


def is_strength_determined(one: Simulated) -> bool:
    """Whether the data determine the parameters in which the torque of a law is linear.

    Else another law has the same torque within this travel, as a quadratic spring has that of an unbalance.

    Parameters
    ----------
    one : Simulated
    """
    strengths = [p.name for p in law(find(one.effects[0])).coefficients]
    return not any(f"{one.label}.{name}" in one.fit.undetermined for name in strengths)


def against(evidence: Evidence, best: Simulated) -> list[str]:
    """What keeps the best law from being named, one sentence each.

    Parameters
    ----------
    evidence : Evidence
    best : Simulated
    """
    settings, reasons = evidence.settings, []
    share, adequate = evidence.share(best), evidence.is_adequate(best)
    margin, lead = evidence.margin(best), evidence.lead(best)
    if not (best.converged or (adequate and best.stalled)):
        reasons.append("The fit of the best law by simulation has not converged.")
    if best.cost >= evidence.null.cost:
        reasons.append("The best law fits no better than the linear part alone.")
    if share < settings.named_share:
        reasons.append(too_small(share, settings.named_share))
    if margin < settings.named_margin and not (adequate and evidence.is_clear(best)):
        reasons.append(too_close(margin, lead, evidence.is_beaten_by_none(best)))
    # Where one was left out, another may stand for it and leave nearly only noise.
    is_loose = not adequate or not evidence.all_linear
    if is_loose and is_linear(best.effects[0]) and share < settings.linear_share:
        reasons.append(inexact("linear effect", share, settings.linear_share))
    # Where only noise is left, what is kept out has shown already that the coefficient is the same.
    is_unsteady = not adequate and not is_steady(best, settings.named_scatter, settings)
    if is_unsteady or is_undetermined_alone(best, settings):
        reasons.append(scattered(best.scatter))
    elif (
        not adequate and best.scatter_error > settings.nearest_scatter
    ):  # so large that all scatter is within it
        reasons.append(
            f"Noise alone varies the coefficient of the best law by {100 * best.scatter_error:.0f} %."
        )
    unknown = [name for name in best.fit.undetermined if name.partition(".")[0] == best.label]
    if unknown and not (adequate and (is_linear(best.effects[0]) or is_strength_determined(best))):
        reasons.append(f"The data do not determine {', '.join(unknown)}.")
    reasons += [better_outside(law) for law in evidence.from_outside(best)]
    if not adequate:  # else it was an error of the measured motion
        reasons += [taken_over(name) for name in evidence.taken_over_by]
    n_periods = best.fit.records[0].spectra.n_periods
    clear = evidence.null.fit.cost_per_dof >= settings.clear_misfit
    if len(best.fit.records) == 1 and n_periods < settings.periods_least and not clear:
        reasons.append(too_short(n_periods, settings.periods_least))
    if not reasons:
        reasons += [
            f"What the best law leaves depends on {name} (p = {p_value:.1g}): the law is another one,"
            " or a second effect is missing."
            for name, p_value in evidence.depends_on(best).items()
        ]
        reasons += evidence.doubts(evidence.null.fit, best.fit, best.effects[0], settings)
    return reasons
