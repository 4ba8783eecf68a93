"""The first laws of a ranking, each beside what the data miss, over the variable that the law depends on.

The torque missing from the linear part and the same by the law are estimated in one way, along the motion of
the model with the law (DIA-7): what the linear part imitates is taken from both.
"""

from __future__ import annotations

import html
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid.diagnosis.from_records.law_part import missing_torque, without
from gsid.diagnosis.from_records.settings import DecisionSettings
from gsid.diagnosis.torque_residual import Curve
from gsid.effects.types import find
from gsid.greybox.fit import CANNOT_FIT

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.result import Diagnosis, RankedLaw

LAWS = 3  # of the ranking
RECORDS = 2  # the more are used, the longer it takes; the curves change little
MAIN = DecisionSettings.nearest_share  # of the misfit: below it, a law is not the main effect
LEAST_SHOWN = 1e-4  # share that is printed as a number; nothing smaller becomes 0 % or 100 %
LEAST_SHARE = 0.005  # of the missing torque's mean square over a variable: below it, a law has no curve


@dataclass(frozen=True, eq=False)
class Fingerprint:
    """A law beside the missing torque, over one variable.

    Attributes
    ----------
    law : RankedLaw
    measured, by_law : Curve
        In the same bins.
    unit : str
        Of both torques over the inertia.
    """

    law: RankedLaw
    measured: Curve
    by_law: Curve
    unit: str

    @property
    def follows(self) -> float:
        """Share of the mean square of the missing torque's curve that the law's curve explains."""
        share = self.measured.share
        left = np.sum(share * (self.measured.torque - self.by_law.torque) ** 2)
        return float(1 - left / np.sum(share * self.measured.torque**2))

    @property
    def sentence(self) -> str:
        """What the law is, and how well it follows the data."""
        name, kept_out = " or ".join(self.law.effects), self.law.share_kept_out
        if math.isnan(kept_out):
            start = f"The curve of {name}"
        elif kept_out < MAIN <= self.follows:  # of a small part of the torque a law may follow all
            start = f"{name} explains only {_percent(kept_out)} of the misfit"
            start += ": it is not what is missing, or only a part of it, although its curve"
        else:
            start = f"{name} explains {_percent(kept_out)} of the misfit, and its curve"
        over, share = self.measured.name, _percent(self.follows)
        sentence = find(self.law.effects[0]).sentence
        return f"{start} over the {over} follows {share} of the torque missing there. {sentence}"

    def to_dict(self) -> dict[str, Any]:
        """An entry of `fingerprints` in `gsid diagnose --json`."""
        return {
            "effects": list(self.law.effects),
            "sentence": self.sentence,
            "variable": self.measured.name,
            "variable_unit": self.measured.unit,
            "unit": self.unit,
            "follows": self.follows,
            "at": self.measured.at,
            "measured": self.measured.torque,
            "std": self.measured.std,
            "by_law": self.by_law.torque,
        }

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.sentence)}</p>"


def _percent(share: float) -> str:
    """A share with so many digits that it becomes neither 0 % nor 100 % by rounding."""
    if 0 < share < LEAST_SHOWN:
        return f"less than {100 * LEAST_SHOWN:g} %"
    if 1 - LEAST_SHOWN < share < 1:
        return f"more than {100 * (1 - LEAST_SHOWN):g} %"
    return f"{100 * max(share, 0.0):.4g} %"  # below 0: worse than without it; how much worse tells nothing


def fingerprints(found: Diagnosis) -> list[Fingerprint]:
    """The first laws of a diagnosis beside the missing torque; without those that cannot be simulated.

    Parameters
    ----------
    found : Diagnosis

    Returns
    -------
    list of Fingerprint
        Empty if nothing is missing.
    """
    if found.adequate:
        return []
    laws = [one for one in found.ranking if one.effects and one.effects[0] in found.law_models]
    made = (_fingerprint(found, one) for one in laws[:LAWS])
    return [one for one in made if one is not None]


def _fingerprint(found: Diagnosis, law: RankedLaw) -> Fingerprint | None:
    model = found.law_models[law.effects[0]]
    try:
        part = without(model, law.effects[:1])
        measured, by_law = missing_torque(model, part, found.measured[:RECORDS], found.band)
    except CANNOT_FIT:
        return None
    curves = list(zip(measured.curves[:3], by_law.curves[:3], strict=True))
    best = max(curves, key=lambda pair: pair[1].explained)
    if best[1].explained < LEAST_SHARE or not np.any(best[0].torque):
        return None
    return Fingerprint(law, *best, measured.unit)
