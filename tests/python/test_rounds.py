"""Which of several effects a given model lacks: the rules alone, on rounds whose verdicts are given."""

from types import SimpleNamespace

from plants import plant

from gsid.base.deadline import Deadline, OutOfTime
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, Decision

GIVEN = {"rigid_body": {"gain": 40.0}, "viscous_friction": {"rate": 25.0}}
VALUES = {
    "coulomb_friction": {"level": 1.0},
    "cubic_spring": {"stiffness": 1.0},
    "mass_unbalance": {"level": 1.0, "angle_deg": 30.0},
    "motor_cogging": {"level": 1.0, "cycles_per_rev": 10.0, "phase_rad": 0.0},
    "drive_dead_zone": {"half_width": 0.1},
}


class Run:
    """A round beside the effects of a model; `answers` are (verdict, effect, share) by the effects known."""

    settings, deadline, is_significant = DEFAULTS, Deadline(), True

    def __init__(self, answers, known=()):
        self.answers, self.known, self.notes, self.not_tried = answers, known, [], {}
        verdict, effect, self.share = answers[frozenset(known)]
        self.decision = Decision(verdict, (effect,) if effect else ())
        model = plant(GIVEN | {name: VALUES[name] for name in (*known, *([effect] if effect else []))})
        self.final = SimpleNamespace(effects=(effect,), model=model) if effect else None
        self.null = SimpleNamespace(model=plant(GIVEN | {name: VALUES[name] for name in known}), effects=())
        self.draft = SimpleNamespace(stage=SimpleNamespace(conclusion=SimpleNamespace(kind="named")))

    def beside(self, model, null=None):
        further = Run(self.answers, tuple(e.id for e in model.effects if e.id not in GIVEN))
        if further.decision.verdict == OVER:  # the laws that are known are simulated first
            raise OutOfTime("the time is over")
        return further

    def draw_up(self):
        pass

    confirm = draw_up

    def fit_play(self):
        self.notes.append("play")

    def evidence(self):
        share = SimpleNamespace(share=lambda one: self.share)
        return SimpleNamespace(**vars(share), is_adequate=lambda one: True, is_worse=lambda one, other: False)


def found(**answers):
    """Effects found; keys are the effects known, joined by "_and_", or "alone"."""
    by = {frozenset() if k == "alone" else frozenset(k.split("_and_")): v for k, v in answers.items()}
    rounds = Rounds(Run(by))
    rounds.run()
    if any(verdict == OVER for verdict, *_ in by.values()):
        assert rounds.first.not_tried == {"further effects": "the time was over"}
    return [one.decision.effects[0] for one in rounds.kept], rounds.first.notes


OVER = "the time is over"
NOTHING = (ADEQUATE, None, 0.0)
COULOMB, CUBIC = (MISSING, "coulomb_friction", 0.99), (MISSING, "cubic_spring", 0.99)


def test_one_effect_beside_which_nothing_is_missing():
    assert found(alone=COULOMB, coulomb_friction=NOTHING) == (["coulomb_friction"], [])


def test_of_two_effects_neither_needs_a_name_alone():
    answers = {
        "alone": (NEAREST, "coulomb_friction", 0.6),
        "coulomb_friction": CUBIC,
        "cubic_spring": COULOMB,
        "coulomb_friction_and_cubic_spring": NOTHING,
    }
    assert found(**answers) == (["coulomb_friction", "cubic_spring"], [])


def test_a_law_that_explains_little_is_no_reason_for_a_further_round():
    answers = {"alone": (NEAREST, "coulomb_friction", 0.2), "coulomb_friction": CUBIC}
    assert found(**answers) == ([], ["play"])


def test_an_effect_that_later_ones_explain_is_dropped():
    dead_zone = (MISSING, "drive_dead_zone", 0.99)
    answers = {
        "alone": (NEAREST, "coulomb_friction", 0.6),
        "coulomb_friction": (NEAREST, "cubic_spring", 0.6),
        "coulomb_friction_and_cubic_spring": dead_zone,
        "cubic_spring_and_drive_dead_zone": NOTHING,
        "drive_dead_zone": CUBIC,
        "cubic_spring": dead_zone,
    }
    assert found(**answers) == (["cubic_spring", "drive_dead_zone"], [])


def test_an_effect_that_is_not_confirmed_beside_the_others_leaves_the_first():
    answers = {
        "alone": COULOMB,
        "coulomb_friction": (NEAREST, "cubic_spring", 0.6),
        "coulomb_friction_and_cubic_spring": NOTHING,
    }
    assert found(**answers) == (["coulomb_friction"], [])


def test_two_laws_of_one_family_stand_for_a_third():
    answers = {
        "alone": (NEAREST, "mass_unbalance", 0.6),
        "mass_unbalance": (NEAREST, "drive_dead_zone", 0.6),
        "mass_unbalance_and_drive_dead_zone": CUBIC,
        "drive_dead_zone": (MISSING, "motor_cogging", 0.99),
        "motor_cogging": (MISSING, "drive_dead_zone", 0.99),
    }
    assert found(**answers) == (["motor_cogging", "drive_dead_zone"], [])


def test_bug_a_deadline_in_a_further_round_erased_the_first_effect():
    assert found(alone=COULOMB, coulomb_friction=(OVER, None, 0.0)) == (["coulomb_friction"], [])


def test_a_deadline_in_the_review_leaves_the_first_effect():
    answers = {"alone": COULOMB, "coulomb_friction": CUBIC, "coulomb_friction_and_cubic_spring": NOTHING}
    assert found(**answers, cubic_spring=(OVER, None, 0.0)) == (["coulomb_friction"], [])
