"""The verdict as a sentence, and a nearest effect beside a named one in words and in JSON."""

import dataclasses

import pytest

from gsid.diagnosis.from_records.result import Diagnosis, RankedLaw
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, UNKNOWN

COULOMB, CUBIC, ZONE = ("coulomb_friction",), ("cubic_spring",), ("drive_dead_zone",)


def diagnosis(verdict, found, nearest):
    effects = (found or nearest)[0]
    nan = float("nan")
    ranking = [RankedLaw(effects, {}, 1.0, 1.0, nan, nan, True)]
    reasons = ("cubic_spring: it is too weak.",)
    costs = (None, 1.5, 1.05, 0.0)
    rest = ([], {}, {}, "zoh", False, [])
    return Diagnosis(verdict, effects, 0.02, True, reasons, ranking, found, *costs, *rest, nearest=nearest)


def test_a_nearest_effect_beside_a_named_one_is_in_every_form_of_the_result():
    result = diagnosis(MISSING, [COULOMB], [CUBIC])
    assert result.sentence == (
        "Missing is coulomb_friction (cost per degree of freedom 1.5 -> 1.05, "
        "not explained: 2.0% of the misfit); another effect is missing beside it, "
        "the nearest is cubic_spring."
    )
    assert result.sentence in repr(result)
    assert "it is too weak" in result.findings[0]
    as_json = result.to_dict()
    assert as_json["found"] == [{"effects": ["coulomb_friction"]}]
    assert as_json["nearest"] == [{"effects": ["cubic_spring"]}]
    assert result.laws == [COULOMB, CUBIC]


def test_words_for_two_named_and_for_two_nearest():
    both = diagnosis(MISSING, [COULOMB, ZONE], [CUBIC]).sentence
    assert both.startswith("Missing is coulomb_friction, then drive_dead_zone (")
    assert both.endswith("; another effect is missing beside them, the nearest is cubic_spring.")
    near = diagnosis(NEAREST, [], [COULOMB, CUBIC])
    assert near.sentence.startswith(
        "Several effects are missing; the nearest are coulomb_friction, then cubic_spring ("
    )
    assert near.laws == [COULOMB, CUBIC]
    one = diagnosis(NEAREST, [], [CUBIC]).sentence
    assert one.startswith("An effect is missing; the nearest is cubic_spring (cost ")


@pytest.mark.parametrize(
    ("verdict", "confirmed", "sentence"),
    [
        (ADEQUATE, True, "These data show no missing effect."),
        (UNKNOWN, True, "An effect is missing; these data confirm no law of the catalogue."),
        (
            ADEQUATE,
            False,
            "First draft, not confirmed by simulation: these data show no missing effect.",
        ),
    ],
)
def test_a_verdict_without_a_law_as_a_sentence(verdict, confirmed, sentence):
    result = dataclasses.replace(diagnosis(NEAREST, [], [CUBIC]), verdict=verdict, confirmed=confirmed)
    assert result.sentence == sentence
