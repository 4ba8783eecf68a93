"""Which of several effects a given model lacks: the rules alone, on rounds whose verdicts are given."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest
from plants import plant

from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import InputError, SimulationError
from gsid.diagnosis.from_records import rounds as rounds_of
from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.law_part import without
from gsid.diagnosis.from_records.rounds import Rounds
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import ADEQUATE, MISSING, NEAREST, UNKNOWN, Decision

GIVEN = {"rigid_body": {"gain": 40.0}, "viscous_friction": {"rate": 25.0}}
VALUES = {
    "coulomb_friction": {"level": 1.0},
    "cubic_spring": {"stiffness": 1.0},
    "mass_unbalance": {"level": 1.0, "angle_deg": 30.0},
    "motor_cogging": {"level": 1.0, "cycles_per_rev": 10.0, "phase_rad": 0.0},
    "drive_dead_zone": {"half_width": 0.1},
}


@dataclass
class Fit:
    """A fit by simulation."""

    effects: tuple
    model: object
    cost: float = 3.0


@dataclass
class Fits:
    """Fits of all models, or of none."""

    has_work: bool = True
    deadline: Deadline | None = None

    def fit(self, model, effects):
        return Fit(effects, model) if self.has_work else None


class Run:
    """A round beside the effects of a model; `answers` are (verdict, effect, share) by the effects known.

    An answer without an effect of the catalogue has this effect, with a minus, among those known; one beside
    values that were not fitted has UNFIT among them.
    """

    settings, deadline, is_significant = DEFAULTS, Deadline(), True

    def __init__(self, answers, known=(), is_fitted=False):
        self.answers, self.known, self.notes, self.is_fitted = answers, known, [], is_fitted
        self.without, self.not_tried = set(), {}

    def draw_up(self):
        known = self.known
        asked = frozenset([*known, *(f"-{one}" for one in self.without)])
        answer = (
            self.answers[asked] if self.is_fitted else self.answers.get(asked | {UNFIT}, self.answers[asked])
        )
        verdict, effect, self.share = answer
        if verdict == OVER:  # the laws that are known are simulated first
            raise OutOfTime("the time is over")
        if verdict == NO_LAW:
            raise InputError("no effect of the catalogue can be fitted", "a record")
        if verdict == UNSTABLE:
            raise SimulationError(-4, "the plant cannot be simulated")
        self.decision = Decision(verdict, (effect,) if effect else ())
        model = plant(GIVEN | {name: VALUES[name] for name in (*known, *([effect] if effect else []))})
        self.final = Fit((effect,), model) if effect else None
        null = plant(GIVEN | {name: VALUES[name] for name in known})
        self.null = Fit((), null) if self.share is not None else None
        self.draft = SimpleNamespace(stage=SimpleNamespace(conclusion=SimpleNamespace(kind="named")))

    def beside(self, model, null=None):
        return Run(self.answers, tuple(e.id for e in model.effects if e.id not in GIVEN), null is not None)

    def evidence(self):
        """The best rival of each law is a dead zone."""
        model = plant(GIVEN | {name: VALUES[name] for name in {*self.known, "drive_dead_zone"}})
        rival = SimpleNamespace(model=model, cost=2.0, effects=("drive_dead_zone",))
        return SimpleNamespace(
            share=lambda one: self.share,
            is_adequate=lambda one: True,
            is_worse=lambda one, other: False,
            rivals=lambda one: [rival],
        )

    def simulations(self):
        return Fits()


@pytest.fixture(autouse=True)
def steps(monkeypatch):
    """Drafts whose answers are given; play leaves a note."""
    monkeypatch.setattr(rounds_of, "draw_up", Run.draw_up)
    monkeypatch.setattr(rounds_of, "confirm", lambda run: None)
    monkeypatch.setattr(rounds_of, "fit_play", lambda run: run.notes.append("play"))
    monkeypatch.setattr(rounds_of, "seek_play_from_data", lambda run: None)


def judged(**answers):
    """The rounds; keys are the effects known, joined by "_and_", or "alone"."""
    by = {frozenset() if k == "alone" else frozenset(k.split("_and_")): v for k, v in answers.items()}
    first = Run(by)
    first.draw_up()
    rounds = Rounds(first)
    rounds.run()
    return rounds


def names(runs):
    return [one.decision.effects[0] for one in runs]


def found(**answers):
    """Effects found, and the notes."""
    rounds = judged(**answers)
    if any(verdict == OVER for verdict, *_ in answers.values()):
        assert rounds.first.not_tried == {"further effects": "the time was over"}
    return names(rounds.kept), rounds.first.notes


OVER, NO_LAW, UNFIT, UNSTABLE = "the time is over", "no law is left", "unfit", "unstable"
NOTHING = (ADEQUATE, None, 0.0)
UNFITTED = (ADEQUATE, None, None)  # by the first stage: no work was left for a simulation
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


def test_bug_the_model_of_the_result_kept_an_effect_that_was_dropped():
    answers = {
        "alone": (NEAREST, "coulomb_friction", 0.6),
        "coulomb_friction": (NEAREST, "cubic_spring", 0.6),
        "coulomb_friction_and_cubic_spring": NOTHING,
        "cubic_spring": (MISSING, "drive_dead_zone", 0.99),
        "drive_dead_zone": NOTHING,
    }
    rounds = judged(**answers)
    assert names(rounds.kept) == ["drive_dead_zone"]
    assert set(rounds.final.model.stack()) == {*GIVEN, "drive_dead_zone"}


def test_bug_without_a_further_law_to_look_for_the_first_effect_was_lost():
    rounds = judged(alone=COULOMB, coulomb_friction=(NO_LAW, None, 0.0))
    assert names(rounds.kept) == ["coulomb_friction"]
    assert rounds.first.not_tried == {"further effects": "no effect of the catalogue can be fitted"}


def test_bug_laws_that_cannot_be_simulated_at_their_values_ended_the_diagnosis():
    """A drag without the damping beside it (blind trial 110047 34, damping taken out)."""
    rounds = judged(alone=COULOMB, coulomb_friction=(UNSTABLE, None, 0.0))
    assert names(rounds.kept) == ["coulomb_friction"]
    assert rounds.first.not_tried == {"further effects": "the plant cannot be simulated (status -4)"}


def test_of_several_effects_with_one_id_as_many_are_left_out_as_are_named():
    """A bug: of two further modes only one was left out."""
    model = plant(GIVEN)
    for f_hz in (50.0, 60.0, 70.0):
        model = model.with_effect("flexible_mode", {"f_hz": f_hz, "zeta": 0.01, "residue": 0.1})
    left = without(model, ["flexible_mode", "flexible_mode"])
    assert [one.params["f_hz"].value for one in left.effects if one.id == "flexible_mode"] == [50.0]


def test_bug_a_second_effect_was_lost_beside_values_that_were_not_fitted():
    """A cubic spring was found beside Coulomb friction, and was unknown when it was judged again."""
    answers = {
        "alone": COULOMB,
        "coulomb_friction": CUBIC,
        "coulomb_friction_and_unfit": (UNKNOWN, "cubic_spring", 0.1),
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


def test_bug_a_review_without_a_fit_ended_the_diagnosis():
    answers = {
        "alone": (NEAREST, "coulomb_friction", 0.6),
        "coulomb_friction": (NEAREST, "cubic_spring", 0.6),
        "coulomb_friction_and_cubic_spring": NOTHING,
        "cubic_spring": UNFITTED,
    }
    assert found(**answers) == ([], ["play"])


def test_an_unknown_effect_beside_the_first_leaves_the_first():
    answers = {
        "alone": COULOMB,
        "coulomb_friction": (UNKNOWN, "cubic_spring", 0.6),
        "coulomb_friction_and_cubic_spring": NOTHING,
    }
    assert found(**answers) == (["coulomb_friction"], [])


NEAREST_CUBIC = {
    "alone": (NEAREST, "coulomb_friction", 0.6),
    "coulomb_friction": (NEAREST, "cubic_spring", 0.9),
    "cubic_spring": COULOMB,
    "coulomb_friction_and_cubic_spring": NOTHING,
}
WITHOUT, DEAD_ZONE = "-cubic_spring", "drive_dead_zone_and_-cubic_spring"


def test_a_nearest_effect_beside_a_named_one_stays_in_the_answer():
    """A bug: a second effect without a name took the name of the first with it."""
    rounds = judged(**NEAREST_CUBIC, **{WITHOUT: COULOMB, DEAD_ZONE: COULOMB})
    assert (names(rounds.kept), names(rounds.near)) == (["coulomb_friction"], ["cubic_spring"])
    assert [effect.id for effect in rounds.final.model.effects if effect.id not in GIVEN] == [
        "coulomb_friction"
    ]
    joint = {effect.id for effect in rounds.joint.model.effects}
    assert {"coulomb_friction", "cubic_spring"} < joint


def test_bug_without_work_for_the_fit_of_the_named_effects_the_summary_failed(monkeypatch):
    """The fit in its place had no effect, whose name the summary takes."""
    monkeypatch.setattr(Run, "simulations", lambda run: Fits(has_work=False))
    rounds = judged(**NEAREST_CUBIC, **{WITHOUT: COULOMB, DEAD_ZONE: COULOMB})
    assert rounds.final.effects == ("coulomb_friction",)
    assert "cubic_spring" not in rounds.final.model.stack()


def test_a_name_does_not_depend_on_which_law_a_nearest_effect_is():
    """The nearest effect may be its best rival, a dead zone: beside that Coulomb friction is not named."""
    for doubt in (WITHOUT, DEAD_ZONE):
        answers = {WITHOUT: COULOMB, DEAD_ZONE: COULOMB} | {doubt: (NEAREST, "coulomb_friction", 0.8)}
        rounds = judged(**NEAREST_CUBIC, **answers)
        assert rounds.kept == []
        assert names(rounds.near) == ["coulomb_friction", "cubic_spring"]


def test_a_first_effect_that_others_replace_loses_its_name():
    """A bug: where two effects are missing, a law that stands for both kept the name that it has alone."""
    answers = {
        "alone": (MISSING, "motor_cogging", 0.9),
        "motor_cogging": (NEAREST, "coulomb_friction", 0.9),
        "coulomb_friction": (NEAREST, "cubic_spring", 0.9),
        "cubic_spring": (NEAREST, "coulomb_friction", 0.9),
        "coulomb_friction_and_motor_cogging": NOTHING,
    }
    rounds = judged(**answers)
    assert (rounds.kept, names(rounds.near)) == ([], ["cubic_spring", "coulomb_friction"])


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


def test_bug_the_fit_without_a_dropped_effect_had_no_name_for_the_one_that_stays():
    """The summary takes the names of the kept effects from their fits."""
    fit = Simulated((), SimpleNamespace(), True, 1.0, 0.0, 0.0)
    rounds = Rounds(SimpleNamespace(decision=Decision(MISSING, ("coulomb_friction",)), settings=DEFAULTS))
    first, second = (
        SimpleNamespace(final=replace(fit, effects=(name,))) for name in ("coulomb_friction", "motor_lag")
    )
    rounds.kept = [first, second]
    rounds.drop([second], replace(fit, kept=1.5))
    assert rounds.kept == [first]
    assert (first.final.effects, first.final.kept) == (("coulomb_friction",), 1.5)
