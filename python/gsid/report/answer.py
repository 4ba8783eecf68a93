"""The answer of a report: adequate or not, what is missing, how sure this is, and what to do next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsid.diagnosis.from_records.result import LIKE_TRIALS
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, UNKNOWN
from gsid.plant.model import PlantModel
from gsid.plots import band_text
from gsid.report.words import error_fall, what_was_made

if TYPE_CHECKING:
    from gsid.comparison import Comparison
    from gsid.diagnosis.from_records.result import Diagnosis
    from gsid.diagnosis.ladder import Ladder
    from gsid.fitting.estimators import Estimators
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel
    from gsid.response.distortion import Distortion
    from gsid.response.frf import Frf

GOOD, BAD, NONE = "good", "bad", "none"


@dataclass(frozen=True)
class Answer:
    """What stands first.

    Attributes
    ----------
    grade : {"good", "bad", "none"}
        Colour of the answer.
    verdict, certainty, next_step : str
        A sentence each, the last two may be empty.
    command : str
        What to type for the next step; may be empty.
    """

    grade: str
    verdict: str
    certainty: str = ""
    next_step: str = ""
    command: str = ""


# --- a diagnosis ------------------------------------------------------------------------------------------


def of_diagnosis(found: Diagnosis, ladder: Ladder | None) -> Answer:
    """The answer of a diagnosis.

    Parameters
    ----------
    found : Diagnosis
    ladder : Ladder or None
        Of the model that it found.
    """
    if not found.ranking:
        return Answer(NONE, found.sentence, " ".join(found.findings), *_next_of_diagnosis(found, ladder))
    sentence = found.sentence
    start = "Adequate" if found.adequate else "Not adequate"
    verdict = f"{start}: {sentence[0].lower()}{sentence[1:]}"
    grade = GOOD if found.adequate else BAD
    return Answer(grade, verdict, _certainty(found, ladder), *_next_of_diagnosis(found, ladder))


def _certainty(found: Diagnosis, ladder: Ladder | None) -> str:
    facts = []
    if found.probability is not None:
        what = " or ".join(found.effects) or "none of the catalogue"
        facts.append(f"the probability of {what} is {found.probability:.2f} {LIKE_TRIALS}")
    if found.adequate and found.p_value is not None:
        facts.append(f"p = {found.p_value:.2g}")
    if found.adequate:
        facts.append("an effect smaller than the noise of these records would not show")
    if ladder is not None and ladder.rungs:
        facts.append(error_fall(ladder))
    if found.reasons:
        kept = " ".join(found.reasons).rstrip(".")
        facts.append(f"no law is named, because: {kept}" if not found.named else kept)
    text = "; ".join(facts)
    interrupted = " The diagnosis was interrupted: this is the state it had reached."
    return (f"How sure: {text}." if text else "") + (interrupted if found.interrupted else "")


def _next_of_diagnosis(found: Diagnosis, ladder: Ladder | None) -> tuple[str, str]:
    if found.next_experiment:
        return f"Next: {found.next_experiment[0].lower()}{found.next_experiment[1:]}", ""
    if found.verdict == ADEQUATE:
        return f"Next: use the model {_where(found)}; a record at another level tests it further.", ""
    if found.linear is None:
        return "Next: check the records, which no stack of effects represents.", "gsid look REC..."
    if found.verdict == UNKNOWN or not found.effects:
        text = "Next: save the missing torque as a law, add it, and judge it on a new record."
        return text, (
            "gsid diagnose REC... --curve CURVE.csv\n"
            "gsid add --table CURVE.csv --model LINEAR.json REC... --held-out NEW.csv -o M2.json"
        )
    if found.verdict == MISSING and ladder is not None and _on_records_kept_out(ladder):
        return f"Next: use the model with this effect {_where(found)}; it was judged on records kept out.", ""
    add = f"gsid add {found.effects[0]} --model LINEAR.json REC... --held-out NEW.csv -o M2.json"
    if found.verdict == MISSING:
        return "Next: judge the effect on a new record, which this search has not used.", add
    return "Next: measure a second level; as an approximation, add the nearest law and judge it.", add


def _on_records_kept_out(ladder: Ladder) -> bool:
    return bool(ladder.rungs) and all(rung.judged_on == "kept_out" for rung in ladder.rungs)


def _where(found: Diagnosis) -> str:
    band = found.band
    if band is None and found.measured:
        lines = [one.f_hz[one.excited] for one in found.measured]
        band = (min(f.min() for f in lines), max(f.max() for f in lines))
    levels = "at the levels of these records"
    return f"from {band_text(*band)}, {levels}" if band else levels


# --- a comparison, or a measurement alone -----------------------------------------------------------------


def of_comparison(comparison: Comparison, model: object) -> Answer:
    """The answer of a comparison with a record.

    Parameters
    ----------
    comparison : Comparison
    model : RationalModel, PiecewiseModel or PlantModel
    """
    if comparison.adequate:
        sure = (
            f"How sure: the test rejects a correct model in {100 * comparison.alpha:g} of 100 cases; an "
            "error smaller than the noise would not show."
        )
        if comparison.model_uncertainty == "fitted":
            text, command = (
                "Next: test it on a record that the fit has not used.",
                "gsid compare --model M.json NEW.csv",
            )
        else:
            text, command = "Next: use the model for the lines and levels of these records.", ""
        return Answer(GOOD, comparison.verdict, sure, text, command)
    kinds = {band["lines"] for band in comparison.where}
    if kinds - {"excited"}:
        missing = "the excess at lines that were not excited can only be nonlinear"
    else:
        missing = "the excess at excited lines is a nonlinear effect or a missing linear one"
    sure = f"What is missing is not known: {missing} (p = {comparison.p_value:.2g})."
    given = " --model M.json" if isinstance(model, PlantModel) else ""
    return Answer(
        BAD, comparison.verdict, sure, "Next: find the missing effect.", f"gsid diagnose REC...{given}"
    )


def of_measurement(
    frf: Frf | None,
    model: RationalModel | PiecewiseModel | PlantModel | None,
    distortion: Distortion | None,
) -> Answer:
    """The answer without a comparison.

    Parameters
    ----------
    frf : Frf or None
    model : RationalModel, PiecewiseModel, PlantModel or None
    distortion : Distortion or None
    """
    sure = distortion.verdict if distortion is not None and distortion.bands else ""
    if model is not None:
        steps = "Next: test the model against a record.", "gsid compare --model M.json REC..."
    elif frf is not None:
        steps = "Next: find a physical model and what it lacks.", "gsid diagnose REC..."
    else:
        steps = "", ""
    return Answer(NONE, what_was_made(frf, model), sure, *steps)


def of_estimators(found: Estimators) -> Answer:
    """The answer of a comparison of estimators.

    Parameters
    ----------
    found : Estimators
    """
    good = [row for row in found.rows if not row.note]
    sure = ""
    if found.cost_expected is not None:
        sure = f"Noise alone leaves {found.cost_expected:.0f} of the cost."
    verdict = f"{len(good)} of {len(found.rows)} estimators converged to a stable model."
    return Answer(GOOD if len(good) == len(found.rows) else NONE, verdict, sure)
