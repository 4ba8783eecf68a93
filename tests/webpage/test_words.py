"""What a command found, in sentences, and the buttons that follow."""

import json

import pytest

from gsid.webpage.words import outcome_of

RANKING = [{"effects": ["cubic_spring", "motor_cogging"]}, {"effects": []}, {"effects": ["hard_stop"]}]


def answer(**values):
    return json.dumps(values).encode()


def test_a_named_effect_is_in_the_model_already():
    known = {
        "verdict": "missing_effect",
        "sentence": "Missing is x.",
        "notes": ["assumed: y"],
        "ranking": RANKING,
    }
    found = outcome_of("diagnose", 0, answer(**known), [])
    assert found.sentences == ("Missing is x.", "assumed: y")
    assert (found.effects, found.next) == ((), ("predict", "compare"))


def test_laws_that_are_not_named_can_be_added():
    known = {"verdict": "nearest_effect", "sentence": "The nearest is x.", "notes": [], "ranking": RANKING}
    assert outcome_of("diagnose", 0, answer(**known), []).effects == ("cubic_spring", "hard_stop")


def test_notes_of_the_command_follow_its_answer():
    known = {"sentence": "Adequate.", "adequate": True}
    found = outcome_of("compare", 0, answer(**known), ["note: the hold is assumed", "wrote x.json"])
    assert found.sentences == ("Adequate.", "note: the hold is assumed")


@pytest.mark.parametrize("answered", [b"", b"{", b"[]"])
def test_a_failure_is_what_the_command_wrote(answered):
    found = outcome_of(
        "look", 3, answered, ["error: no column u", "  where: a.csv", "hint: name it with --u"]
    )
    assert found.sentences == ("error: no column u", "where: a.csv", "hint: name it with --u")


def test_a_command_that_was_killed_or_silent_is_no_success():
    assert outcome_of("look", -9, b"", []).sentences == ("The step was stopped.",)
    assert outcome_of("look", 0, b"", []).sentences == ("The command ended without an answer.",)
