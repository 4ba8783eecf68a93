"""What a command found, in sentences, and the buttons that follow."""

import json
import signal

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


def test_the_search_goes_on_if_a_named_effect_is_not_all():
    known = {"verdict": "missing_effect", "sentence": "Missing is x.", "notes": [], "ranking": RANKING}
    found = outcome_of("diagnose", 0, answer(**known, nearest=[{"effects": ["hard_stop"]}]), [])
    assert (found.effects, found.next) == ((), ("predict", "compare", "diagnose"))


def test_all_members_of_the_nearest_group_can_be_added():
    known = {"verdict": "nearest_effect", "sentence": "The nearest is x.", "notes": [], "ranking": RANKING}
    found = outcome_of("diagnose", 0, answer(**known, effects=["cubic_spring", "motor_cogging"]), [])
    assert found.effects == ("cubic_spring", "motor_cogging")
    assert found.next == ("predict", "compare")


@pytest.mark.parametrize("verdict", ["adequate", "unknown_effect"])
def test_no_law_is_offered_if_none_is_near(verdict):
    known = {"verdict": verdict, "sentence": "Nothing.", "notes": [], "ranking": RANKING, "effects": []}
    found = outcome_of("diagnose", 0, answer(**known), [])
    assert (found.effects, found.next) == ((), ("predict", "compare"))


def test_the_fit_of_a_constant_output_is_not_defined():
    one = {"name": "a", "fit_percent": None, "fit_percent_of_noise": None}
    found = outcome_of("predict", 0, answer(records=[one]), [])
    nothing = "not defined (constant output)"
    assert found.sentences == (f"a: FIT {nothing}, noise alone {nothing}.",)


@pytest.mark.parametrize("verb", ["look", "frf", "start", "compare", "predict", "diagnose", "add"])
@pytest.mark.parametrize("values", [{}, {"records": [3], "f_hz": [], "verdict": []}])
def test_an_answer_without_the_expected_keys_is_reported(verb, values):
    found = outcome_of(verb, 0, answer(**values), ["note: x", "wrote y"])
    assert found.sentences == ("The command's answer could not be read.", "note: x")
    assert (found.effects, found.next) == ((), ())


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


def test_the_error_is_first_and_its_hint_follows():
    messages = ["warning: x", "error: no column u", "  where: a.csv", "  hint: name it"]
    found = outcome_of("look", 3, b"", messages)
    assert found.sentences == ("error: no column u", "where: a.csv", "hint: name it", "warning: x")


@pytest.mark.parametrize(
    ("code", "name"), [(-signal.SIGSEGV, "SIGSEGV"), (-signal.SIGKILL, "SIGKILL"), (-999, "signal 999")]
)
def test_a_crash_is_not_taken_for_a_stop(code, name):
    found = outcome_of("look", code, b"", ["error: the answer is too long"])
    assert found.sentences == (f"The command was ended by {name}.", "error: the answer is too long")


@pytest.mark.parametrize("code", [-signal.SIGKILL, -signal.SIGINT, 130])
def test_a_stopped_step_is_no_crash(code):
    assert outcome_of("look", code, b"", [], stopped=True).sentences == ("The step was stopped.",)


def test_a_stopped_step_shows_what_it_has_found():
    known = {"sentence": "Adequate.", "adequate": True}
    assert outcome_of("compare", 130, answer(**known), [], stopped=True).sentences == ("Adequate.",)


def test_a_silent_command_is_no_success():
    assert outcome_of("look", 0, b"", []).sentences == ("The command ended without an answer.",)


def test_a_proposal_has_its_size_and_can_be_run_unless_there_is_none():
    values = {"n_realisations": 1, "n_periods": 4, "amplitude": 12.0, "time_s": 5.5, "reason": "Why."}
    found = outcome_of("next", 0, json.dumps(values).encode(), [])
    assert found.sentences == ("4 periods of a command up to 12, 5.5 s with waiting. Why.",)
    assert found.next == ("run",)
    found = outcome_of("next", 0, json.dumps(values | {"n_realisations": 3}).encode(), [])
    assert found.sentences[0].startswith("3 realisations of 4 periods")
    none = values | {"amplitude": None, "experiments": [], "reason": "No experiment distinguishes them."}
    found = outcome_of("next", 0, json.dumps(none).encode(), [])
    assert (found.sentences, found.next) == (("No experiment distinguishes them.",), ())
