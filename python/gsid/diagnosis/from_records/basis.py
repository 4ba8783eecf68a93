"""Numbers of a decision on which the probability of its best law rests."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gsid.diagnosis.from_records.evidence import Evidence
from gsid.diagnosis.missing_torque.stage import FirstStage


@dataclass(frozen=True)
class Basis:
    """What is known of the best law.

    Attributes
    ----------
    effects : tuple of str
        The best law, and those that the data do not distinguish from it.
    lead : float
        Drop of the cost against the best rival of another family, or nothing missing; 0 where no law was
        worth a fit by simulation.
    share : float
        Share of the misfit that it explains, on what is kept out.
    margin : float
        What the best rival leaves, over what it leaves.
    scatter, scatter_error : float
        Of its coefficient over realisations, relative to it, and what noise makes of it.
    adequate : bool
        Whether it leaves only noise.
    converged : bool
        Whether its fit has converged.
    beaten, taken_over : bool
        Whether a law from outside the catalogue explains more, or what it leaves depends on a coordinate; and
        whether a free function explains much of what it leaves.
    """

    effects: tuple[str, ...]
    lead: float
    share: float
    margin: float
    scatter: float
    scatter_error: float
    adequate: bool
    converged: bool
    beaten: bool
    taken_over: bool


def basis_of(evidence: Evidence) -> Basis:
    """The numbers of the best law by the fits by simulation.

    Parameters
    ----------
    evidence : Evidence
        As the decision takes it.
    """
    best = evidence.best()
    return Basis(
        effects=evidence.group(best),
        lead=evidence.lead(best),
        share=evidence.share(best),
        margin=evidence.margin(best),
        scatter=best.scatter,
        scatter_error=best.scatter_error,
        adequate=evidence.is_adequate(best),
        converged=best.converged or best.stalled,
        beaten=bool(evidence.beaten_by or evidence.depends_on(best)),
        taken_over=bool(evidence.taken_over_by),
    )


def basis_of_draft(stage: FirstStage) -> Basis:
    """The numbers of the best law by the first stage, where no law was worth a fit by simulation.

    Parameters
    ----------
    stage : FirstStage
    """
    best, conclusion = stage.ranking[0], stage.conclusion
    return Basis(
        effects=best.effects,
        lead=0.0,
        share=best.share_kept_out,
        margin=0.0 if math.isnan(best.margin) else best.margin,
        scatter=best.scatter,
        scatter_error=0.0,
        adequate=False,
        converged=False,
        beaten=bool(conclusion.beaten_by),
        taken_over=bool(conclusion.taken_over_by),
    )
