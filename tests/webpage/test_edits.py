"""Changes of a model on the page, and the commands that fit the changed model."""

import pytest

from gsid.base.errors import InputError
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.study.folder import Study
from gsid.webpage.edits import Added, Edit, edit_of, edited, law_of, step_command, unedited

RUNG = {
    "params": {}, "before": {"cost_per_dof": 2.0, "rms_error": 2.0, "noise_floor_rms": 1.0},
    "after": {"cost_per_dof": 1.0, "rms_error": 1.0, "noise_floor_rms": 1.0},
    "held_out": {"before": 2.0, "after": 1.0}, "noise_floor_rms": 1.0, "kept_out": "later periods",
    "y_unit": "deg/s",
}  # fmt: skip


def params(**values):
    return {name: Param(value, std=0.1) for name, value in values.items()}


@pytest.fixture
def model():
    effects = [
        Effect("rigid_body", params(gain=7.4)),
        Effect("viscous_friction", params(rate=11.0)),
        Effect("coulomb_friction", params(level=15.0)),
    ]
    history = [
        {"add": effect, "rung": RUNG | {"effect": effect}}
        for effect in ("viscous_friction", "coulomb_friction")
    ]
    return PlantModel(3000.0, effects, y_unit="deg/s", history=history, fit={"cost_per_dof": 1.0})


@pytest.fixture
def study(tmp_path, model):
    study = Study(tmp_path / "study")
    (tmp_path / "rec.csv").write_text("u,y\n1,2\n")
    study.add_file(tmp_path / "rec.csv")
    model.save(study.folder / "models/2-start.json")
    return study


def request_of(**edit):
    return {"records": ["records/rec.csv"], "model": "models/2-start.json", "edit": edit}


def test_a_moved_value_is_fitted_from_a_model_of_its_own(study):
    number, arguments, outputs = step_command(study, request_of(values={"coulomb_friction.level": 3.5}))
    name = f"models/{number}-edited-from-2-start.json"
    assert arguments[:4] == ["fit", "records/rec.csv", "--model", name]
    assert outputs[0] == name
    saved = PlantModel.load(study.folder / name)
    assert saved["coulomb_friction.level"].value == 3.5
    assert saved["coulomb_friction.level"].std is None
    assert saved.fit is None
    assert unedited(name) == "models/2-start.json"
    assert len(saved.history) == 2


def test_the_ladder_of_an_edited_model_ends_before_the_first_effect_that_is_out(model):
    part = edited(model, Edit(out=("coulomb_friction",)))
    assert [effect.id for effect in part.effects] == ["rigid_body", "viscous_friction"]
    assert [entry["add"] for entry in part.history] == ["viscous_friction"]
    assert edited(model, Edit(out=("viscous_friction",))).history == []
    assert len(model.history) == 2


def test_one_added_effect_is_added_to_the_model_as_it_is(study):
    edit = {"added": [{"effect": "cable_spring"}], "values": {"cable_spring.stiffness": 50.0}}
    _, arguments, outputs = step_command(study, request_of(**edit))
    expected = ["add", "cable_spring", "--param=stiffness=50.0", "records/rec.csv", "--model"]
    assert arguments[:6] == [*expected, "models/2-start.json"]
    assert not any("edited" in name for name in outputs)


def test_of_several_added_effects_the_last_that_is_in_is_the_step(study):
    added = [{"effect": "cable_spring"}, {"law": "c*w^3", "params": {"c": 2.0}}, {"effect": "torque_bias"}]
    _, arguments, outputs = step_command(study, request_of(added=added, out=["torque_bias"]))
    assert arguments[:3] == ["add", "--torque=c*w^3", "--param=c=2.0"]
    saved = PlantModel.load(study.folder / outputs[0])
    assert [effect.id for effect in saved.effects][-1] == "cable_spring"


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ({"values": {"coulomb_friction.level": -1}}, "out of its range"),
        ({"values": {"coulomb_friction.level": [1]}}, "out of its range"),
        ({"values": {"nothing.level": 1}}, "no such parameter"),
        ({"values": [1]}, "another form"),
        ({"out": ["rigid_body"]}, "cannot be left out"),
        ({"out": ["nothing"]}, "no such effect"),
        ({"out": [["rigid_body"]]}, "another form"),
        ({"added": [{"effect": "nothing"}]}, "no such effect"),
        ({"added": [{"effect": "cable_spring", "library": "./evil.so:f"}]}, "another form"),
        ({"added": [{"law": "__import__('os').system('id')"}]}, "unknown function"),
        ({"added": [{"law": "c*w", "params": {"c": "__import__('os')"}}]}, "not numbers"),
        ({"added": [{"effect": "cable_spring"}] * 21}, "another form"),
    ],
)
def test_changes_that_are_not_possible_are_refused_and_nothing_is_written(study, edit, words):
    before = sorted(study.folder.rglob("*"))
    with pytest.raises(InputError, match=words):
        step_command(study, request_of(**edit))
    assert sorted(study.folder.rglob("*")) == before


def test_a_typed_law_has_its_parameters_or_an_error_with_its_column():
    assert law_of({"law": "c*tanh(w/width) + 2*sin(24*theta*rad)"}) == {
        "law": "c*tanh(w/width) + 2*sin(24*theta*rad)", "params": {"c": 1.0, "width": 1.0}
    }  # fmt: skip
    assert law_of({"law": "3*w"})["params"] == {}
    for text, words in [
        ("c*tanh(w", "not an expression"),
        ("__import__('os').system('id')", "unknown function"),
        ("(lambda: 1)()", "unknown function"),
        ("w.__class__", "must not contain"),
        ("[c for c in w]", "must not contain"),
        ("c*sign(w)", "discontinuous"),
        ("c*sin(t)", "time"),
        ("c*open(w)", "unknown function"),
        ("a+b+c+d+e1", "too many parameters"),
        ("", "empty"),
        ("(" * 400, "law"),
    ]:
        assert words in law_of({"law": text})["error"], text


def test_an_added_law_is_an_effect_with_its_parameters():
    assert Added(law="c*w", params={"c": 2.0}).type().names == ("c",)
    assert edit_of({}) == Edit()


LINES = "c*(w+\nreboot\n)"


def test_a_law_of_several_lines_is_refused(study):
    """The log of the study has one command a line."""
    assert "cannot be printed" in law_of({"law": LINES})["error"]
    request = {"verb": "add", "law": LINES, "params": {"c": 1.0, "reboot": 1.0}}
    with pytest.raises(InputError, match="cannot be printed"):
        step_command(study, request | {"records": ["records/rec.csv"], "model": "models/2-start.json"})
    with pytest.raises(InputError, match="cannot be printed"):
        step_command(study, request_of(added=[{"law": LINES, "params": {"c": 1.0, "reboot": 1.0}}]))


def test_a_model_of_moved_values_gets_its_hash_in_the_session(study):
    request = request_of(values={"coulomb_friction.level": 3.5})
    number, arguments, outputs = step_command(study, request)
    study.add_step(arguments, 3, outputs=outputs, number=number)
    assert f"models/{number}-edited-from-2-start.json" in study.files
