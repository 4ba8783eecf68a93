"""Probability that the best law of a diagnosis is right, from trials whose answer is known.

How much likelier one law is than another is no evidence where neither is right. The probability is
therefore a frequency: how often the best law of a simulated trial was the hidden one, as a function of what
the decision knows of it (DIA-11). It holds for a mix of cases like that of the trials.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gsid.diagnosis.from_records.basis import Basis

DECADES = 4.0  # of the lead; more does not show in the trials
MARGINS = 2.0  # decades of the margin
SHARE = 0.01  # least share that a law leaves; less is noise in most trials


@dataclass(frozen=True)
class Calibration:
    """Coefficients of the logistic function; `make diagnosis-probability-study` fits them.

    Attributes
    ----------
    intercept : float
    lead : float
        For each decade of 1 + the lead in cost.
    margin : float
        For each decade of the margin over the best rival.
    share : float
        For each decade by which the law lowers the share of the misfit that is not explained.
    outside : float
        If a law from outside the catalogue explains more, or a free function much of what is left; not
        positive.
    other : float
        Share of the trials with a wrong best law in which another law of the catalogue is missing.
    n_trials : int
        Trials that bound the probability: no value is nearer to 0 or 1 than 1 / (n_trials + 2).
    source : str
        Study, seeds and number of diagnoses.
    """

    intercept: float
    lead: float
    margin: float
    share: float
    outside: float
    other: float
    n_trials: int
    source: str


CALIBRATION = Calibration(
    intercept=-6.452,
    lead=0.842,
    margin=0.373,
    share=2.925,
    outside=-2.26,
    other=0.122,
    n_trials=30,
    source="from-records-study, seeds 501, 601, 1618, 21710, 21711 and 31415: 188 diagnoses of 68 trials",
)


@dataclass(frozen=True)
class Probabilities:
    """Probabilities that sum to 1.

    Attributes
    ----------
    best : float
        Of the best law and of those that the data do not distinguish from it, together.
    other : float
        Of the other laws of the catalogue together.
    none : float
        None of the catalogue.
    """

    best: float
    other: float
    none: float


def probabilities(basis: Basis, calibration: Calibration = CALIBRATION) -> Probabilities:
    """How often a best law with such numbers is the right one.

    Parameters
    ----------
    basis : Basis
    calibration : Calibration
    """
    x = features(basis)
    slopes = (calibration.lead, calibration.margin, calibration.share, calibration.outside)
    log_odds = calibration.intercept + sum(a * b for a, b in zip(slopes, x, strict=True))
    least = 1 / (calibration.n_trials + 2)
    best = min(max(1 / (1 + math.exp(-log_odds)), least), 1 - least)
    other = (1 - best) * calibration.other
    return Probabilities(best, other, 1 - best - other)


def features(basis: Basis) -> tuple[float, float, float, float]:
    """Decades of lead, margin and share, and whether a law from outside is better.

    Parameters
    ----------
    basis : Basis
    """
    lead = math.log10(1 + max(basis.lead, 0.0))
    margin = math.log10(1 + max(basis.margin, 0.0))
    share = -math.log10(min(max(1 - basis.share, SHARE), 1.0))
    outside = basis.beaten or (basis.taken_over and not basis.adequate)
    return min(lead, DECADES), min(margin, MARGINS), share, float(outside)
