"""Result of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from gsid.base.plottable import Plottable
from gsid.base.tables import Table, paragraphs
from gsid.diagnosis.from_records.basis import Basis
from gsid.diagnosis.from_records.law_part import missing_torque
from gsid.diagnosis.from_records.probability import Probabilities
from gsid.diagnosis.from_records.ripple import Ripple
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST
from gsid.diagnosis.torque_residual import TorqueResidual, torque_residual
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra

FITS = "fits by simulation"  # key of `not_tried` where none was made
LIKE_TRIALS = "in trials like those of docs/explanation/from_records.md"


@dataclass(frozen=True)
class RankedLaw:
    """One law of the ranking.

    Attributes
    ----------
    effects : tuple of str
        Empty: none of the catalogue.
    params : dict of float
        Values of its parameters.
    cost_per_dof_after : float
        Cost per degree of freedom with it; NaN if it was only scanned.
    share_kept_out : float
        Share of the misfit that it explains where it was not fitted; NaN if it was only scanned, and if the
        verdict is "adequate": noise has no share.
    margin : float
        What the best law of another family leaves, over what it leaves; NaN if it was only scanned.
    scatter : float
        Of its coefficient over realisations, relative to it; NaN if it was only scanned.
    confirmed : bool
        Whether the numbers are those of a converged fit by simulation.
    by : str
        What the numbers come from.
    probability : float or None
        That it is the law that is missing. The laws that the data do not distinguish share one. None where
        no trials tell it: see `Diagnosis.probability`.
    """

    effects: tuple[str, ...]
    params: dict[str, float]
    cost_per_dof_after: float
    share_kept_out: float
    margin: float
    scatter: float
    confirmed: bool
    by: str = "first stage"
    probability: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """An entry of `ranking` in `gsid diagnose --json`."""
        return vars(self) | {"effects": list(self.effects)}


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Plottable):
    """Result of :func:`diagnose` and :func:`diagnose_records`.

    Attributes
    ----------
    verdict : {"adequate", "missing_effect", "nearest_effect", "unknown_effect"}
    effects : tuple of str
        The law that is missing, or the nearest; several where the data do not distinguish them.
    unexplained_share : float or None
        Share of the misfit that the law leaves, where it was not fitted. None without a law, where the misfit
        is so small that its size is not known, and for a law that is nearest though it explains little.
    confirmed : bool
        Whether the verdict was confirmed by simulation; False for a first draft.
    reasons : tuple of str
        What kept a law from being named, one sentence each.
    ranking : list of RankedLaw
        The best law first. One entry without effects stands for "none of the catalogue": the linear part
        alone.
    found : list of tuple of str
        All effects found: linear ones that a given model lacked, a sensor that is sampled and held, and the
        law.
    model : PlantModel or None
        The stack with the effects found, if a law is named, else the linear stack. None where no stack
        represents the data.
    cost_per_dof, cost_per_dof_after : float
        Of the linear stack, and of `model`; 1 where only noise is left.
    p_value : float or None
        Probability of a misfit this large or larger if no effect is missing; None for a first draft.
    assumed : list of str
        What the result relies on and the data do not show.
    not_tried : dict of str
        Effects that were not tried or not confirmed, with the reason.
    seconds : dict of float
        Time of each step [s].
    hold : {"zoh", "none"} or None
        Hold of the input that was assumed.
    hold_assumed : bool
        Whether the records do not state it.
    names : list of str
        Names of the records.
    measured : list of Spectra
        The records with that hold.
    band : (lo, hi) or None
        Hz.
    linear : PlantModel or None
        The linear stack alone, or the given model, fitted.
    law_model : PlantModel or None
        The stack with the laws that are named or nearest.
    without_law : PlantModel or None
        The same without these laws.
    interrupted : bool
        Whether the diagnosis was interrupted: this is the state that it had reached.
    ripple : Ripple or None
        Dominant period over the position of what the law leaves; None if none exceeds the others.
    next_experiment : str
        An experiment that would distinguish the members of a group; empty if each group has one member.
    other_delay_s : float or None
        Delay [s] under the other assumption of the hold, with all effects found; from records alone also with
        the nearest. None where the hold is stated or there is no delay.
    delay_hold_uncertainty_s : float or None
        Difference of this delay between the two assumptions [s].
    remarks : list of str
        What was not named because of the hold, and what more is left.
    basis : Basis or None
        Numbers of the best law, also if nothing is missing; None if no law was fitted and the verdict is not
        "unknown_effect", and with several effects.
    probabilities : Probabilities or None
        Of the best law, of the other laws, and of none of the catalogue, calibrated on simulated trials. None
        without a basis, if nothing is missing, if the time was over, in a closed loop, and beside laws of a
        given model: there were no such trials.
    nearest : list of tuple of str
        Effects that are missing but not named: beside those found, or alone (verdict "nearest_effect").
    law_models : dict of PlantModel
        The stack with each of the first laws of the ranking, by the law's first effect.
    """

    verdict: str
    effects: tuple[str, ...]
    unexplained_share: float | None
    confirmed: bool
    reasons: tuple[str, ...]
    ranking: list[RankedLaw]
    found: list[tuple[str, ...]]
    model: PlantModel | None
    cost_per_dof: float
    cost_per_dof_after: float
    p_value: float | None
    assumed: list[str]
    not_tried: dict[str, str]
    seconds: dict[str, float]
    hold: str | None
    hold_assumed: bool
    names: list[str]
    measured: list[Spectra] = field(default_factory=list)
    band: tuple[float, float] | None = None
    linear: PlantModel | None = None
    law_model: PlantModel | None = None
    without_law: PlantModel | None = None
    interrupted: bool = False
    ripple: Ripple | None = None
    next_experiment: str = ""
    other_delay_s: float | None = None
    delay_hold_uncertainty_s: float | None = None
    remarks: list[str] = field(default_factory=list)
    basis: Basis | None = None
    probabilities: Probabilities | None = None
    nearest: list[tuple[str, ...]] = field(default_factory=list)
    law_models: dict[str, PlantModel] = field(default_factory=dict)

    @property
    def adequate(self) -> bool:
        """Whether nothing is missing."""
        return self.verdict == ADEQUATE

    @property
    def named(self) -> bool:
        """Whether the missing effect has a name."""
        return self.verdict == MISSING

    @property
    def probability(self) -> float | None:
        """Probability of the first of the ranking: `effects` together, or none of the catalogue."""
        if self.probabilities is None:
            return None
        return self.probabilities.best if self.effects else self.probabilities.none

    @property
    def sentence(self) -> str:
        """The verdict as a sentence."""
        if not self.ranking:
            return "No law was judged."
        names = _listed(self._named)
        draft = "" if self.confirmed else "First draft, not confirmed by simulation: "
        if self.adequate:
            text = "these data show no missing effect."
        elif self.named:
            text = f"missing is {names} ({self._cost}{self._unexplained}){self._beside}."
        elif self.verdict == NEAREST:
            what = "several effects are missing" if len(self.nearest) > 1 else "an effect is missing"
            text = f"{what}; {self._nearest} ({self._cost}{self._unexplained})."
        else:
            text = "an effect is missing; these data confirm no law of the catalogue."
        return draft + text if draft else text[0].upper() + text[1:]

    @property
    def by_command(self) -> bool:
        """Whether the controller of a closed loop is not known: a fit goes from the command to the output."""
        return FITS in self.not_tried

    @property
    def laws(self) -> list[tuple[str, ...]]:
        """Effects of `law_model`: those named, and the nearest."""
        return [*self._named, *self.nearest] if self.named else self.nearest or [self.effects]

    @property
    def _named(self) -> list[tuple[str, ...]]:
        return self.found if self.named and self.effects in self.found else [self.effects]

    @property
    def _beside(self) -> str:
        if not self.nearest:
            return ""
        return (
            f"; another effect is missing beside {'them' if len(self._named) > 1 else 'it'}, {self._nearest}"
        )

    @property
    def _nearest(self) -> str:
        several = self.nearest or [self.effects]
        return f"the nearest {'are' if len(several) > 1 else 'is'} {_listed(several)}"

    @property
    def _cost(self) -> str:
        return f"cost per degree of freedom {self.cost_per_dof:.4g} -> {self.cost_per_dof_after:.4g}"

    @property
    def _unexplained(self) -> str:
        if self.unexplained_share is None:
            return ""
        if self.unexplained_share == 0:
            return ", only noise is left"
        return f", not explained: {_percent(self.unexplained_share)} of the misfit"

    def torque_residual(self) -> TorqueResidual:
        """Torque missing from the linear part, against rate, angle, command and time.

        Raises
        ------
        ValueError
            No stack represents the data.
        """
        return self.missing_torque()[0]

    def missing_torque(self) -> tuple[TorqueResidual, TorqueResidual | None]:
        """The missing torque, and the same by the law that is named or nearest.

        Raises
        ------
        ValueError
            No stack represents the data.
        """
        if self.law_model is not None:
            return missing_torque(self.law_model, self.without_law, self.measured, self.band)
        if self.linear is None:
            raise ValueError("no stack of effects represents the data: there is no missing torque")
        return torque_residual(self.linear, self.measured, band=self.band), None

    @property
    def findings(self) -> list[str]:
        """Reasons, remarks, the probability and the period of what is left, as sentences."""
        notes = [*self.reasons, *self.remarks]
        if self.probability is not None:
            what = " or ".join(self.effects) or "none of the catalogue"
            notes.append(f"Probability of {what}: {_probability(self.probability)} {LIKE_TRIALS}.")
        if self.ripple is not None:
            notes.append(self.ripple.sentence)
        if self.interrupted:
            notes.append("The diagnosis was interrupted: this is the state it had reached.")
        return notes

    @property
    def notes(self) -> list[str]:
        """The findings, what was assumed and what was not tried."""
        assumed = [f"assumed: {text}" for text in self.assumed]
        return [
            *self.findings,
            *assumed,
            *(f"not tried: {name}: {why}" for name, why in self.not_tried.items()),
        ]

    def table(self) -> Table:
        """The ranking."""
        head = ["law", "cost per d.o.f.", "explained, kept out", "margin", "scatter", "probability", "by"]
        rows = [
            [
                " or ".join(one.effects) or "none of the catalogue",
                f"{one.cost_per_dof_after:.4g}",
                _percent(one.share_kept_out),
                "" if one.margin != one.margin else f"{one.margin:.3g}",
                _scatter(one.scatter),
                _probability(one.probability),
                one.by,
            ]
            for one in self.ranking
            if one.cost_per_dof_after == one.cost_per_dof_after
        ]
        return Table(head, rows, left=["law", "by"])

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid diagnose --json`."""
        keys = (
            "verdict", "adequate", "unexplained_share", "confirmed", "p_value", "cost_per_dof",
            "cost_per_dof_after", "hold", "hold_assumed", "assumed", "not_tried", "seconds", "notes",
            "interrupted", "probability",
        )  # fmt: skip
        keys += ("delay_hold_uncertainty_s", "next_experiment")
        known = {key: getattr(self, key) for key in keys}
        share = None if self.unexplained_share is None else 1 - self.unexplained_share
        return known | {
            "sentence": self.sentence,
            "effects": list(self.effects),
            "explained": share,
            "ranking": [one.to_dict() for one in self.ranking],
            "ripple": None if self.ripple is None else vars(self.ripple),
            "found": [{"effects": list(effects)} for effects in self.found],
            "nearest": [{"effects": list(effects)} for effects in self.nearest],
            "model": None if self.model is None else self.model.to_dict(),
        }

    def __repr__(self) -> str:
        lines = [self.sentence, self.table().text() if self.ranking else ""]
        return "\n".join([*lines, *self.notes])

    def _repr_html_(self) -> str:
        ranking = self.table().html() if self.ranking else ""
        return paragraphs(self.sentence, *self.findings) + ranking + paragraphs(self.next_experiment)


def _listed(several: Sequence[tuple[str, ...]]) -> str:
    return ", then ".join(" or ".join(effects) for effects in several)


def _percent(share: float | None) -> str:
    """A share with so many digits that what is left never becomes 0 % or 100 % by rounding."""
    if share is None or share != share:
        return ""
    if share < 0:
        return "< 0%"  # worse than without it, where it was not fitted; how much worse tells nothing
    text = f"{share:.1%}"
    if text not in ("100.0%", "0.0%") or not 0 < share < 1:
        return text
    finer = f"{share:.2%}"
    return {"100.00%": "> 99.99%", "0.00%": "< 0.01%"}.get(finer, finer)


def _scatter(scatter: float) -> str:
    """A scatter; above 100 % its size tells nothing."""
    if scatter != scatter:
        return ""
    return "> 100%" if scatter > 1 else f"{scatter:.2%}"


def _probability(probability: float | None) -> str:
    """A probability to two decimals; that of a single law is seldom known better."""
    if probability is None:
        return ""
    return "< 0.01" if probability < 0.01 else f"{probability:.2f}"
