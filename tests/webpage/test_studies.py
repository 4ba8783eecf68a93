"""Studies beside each other: found, summarised, compared; and asked for over the server."""

import json

import numpy as np
import pytest

import gsid
from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.models.load import load_plant
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.study.folder import Study
from gsid.webpage.studies import (
    comparison_of,
    differences_sd,
    responses_of,
    studies_beside,
    summary_of,
)

FS, N, SEED = 1000.0, 500, 20261123


def make_study(folder, gain=7.0, std=0.1, seed=SEED):
    """A study with one record and a model of the axis, whose gain has an uncertainty."""
    print("seed", seed)
    effects = [
        Effect("rigid_body", {"gain": Param(gain, std=std)}),
        Effect("viscous_friction", {"rate": Param(11.0, std=0.5)}),
    ]
    model = PlantModel(FS, effects, y_unit="deg/s", u_unit="A")
    u = Multisine.design(FS, N, (2, 200), rms=2.0, phases="random", seed=seed).table()
    y = np.tile(model.simulate(u).y, 4)
    y += np.random.default_rng(seed).normal(0, 0.02 * np.std(y), len(y))
    record = Record(np.tile(u, 4), y, FS, N, 0, hold="zoh", u_unit="A", y_unit="deg/s")
    study = Study(folder)
    place = folder.parent / f"{folder.name}.csv"
    write_record(place, record)
    study.open_files([place])
    model.save(folder.parent / f"{folder.name}.json")
    study.open_files([folder.parent / f"{folder.name}.json"], "models")
    return study


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    folder = tmp_path_factory.mktemp("axes")
    return [make_study(folder / name, gain) for name, gain in (("az", 7.0), ("el", 7.5), ("roll", 7.0))]


def test_studies_in_the_same_folder_and_those_that_are_named_are_found(three, tmp_path):
    other = make_study(tmp_path / "az")
    (three[0].folder.parent / "notes").mkdir(exist_ok=True)
    found = studies_beside(three[0], [other.folder, three[1].folder])
    assert found == {
        f"{tmp_path.name}/az": other.folder,
        "el": three[1].folder,
        "roll": three[2].folder,
    }


def test_a_link_to_a_study_elsewhere_is_not_listed(three, tmp_path):
    own = make_study(tmp_path / "own")
    (tmp_path / "link").symlink_to(three[0].folder)
    assert studies_beside(own) == {}


def test_a_summary_has_the_parameters_and_the_fit_of_the_newest_model(three):
    found = summary_of(three[0], "az")
    model = load_plant(three[0].path(three[0].models[-1]))
    record = gsid.read_record(three[0].path(three[0].last_experiment[0]))
    assert found.parameters["rigid_body.gain"] == (7.0, 0.1, model.unit_of(model.effects[0], "gain"))
    assert found.fit_percent == pytest.approx(gsid.predict(model, record)[0].fit_percent)
    assert found.note == ""
    assert np.all(np.abs(found.curve.measured / found.curve.model - 1) < 0.3)
    response = gsid.frf(record)
    np.testing.assert_allclose(found.curve.f_hz, response.f_hz)
    np.testing.assert_allclose(found.curve.measured, response.g)


def test_the_difference_is_in_standard_deviations_of_the_difference(three):
    rows = comparison_of([summary_of(one, one.folder.name) for one in three])["rows"]
    gain = next(row for row in rows if row["name"] == "rigid_body.gain")["cells"]
    assert gain[0]["differs_sd"] is None
    assert gain[1]["differs_sd"] == pytest.approx(0.5 / np.hypot(0.1, 0.1))
    assert gain[2]["differs_sd"] == 0


@pytest.mark.parametrize("other", [(1.0, None, "A"), (1.0, 0.1, "V")])
def test_without_uncertainty_or_in_another_unit_no_difference_is_given(other):
    assert differences_sd((1.0, 0.1, "A"), other) is None


def test_a_study_that_cannot_be_summarised_has_a_note(tmp_path):
    study = make_study(tmp_path / "bad")
    study.path(study.last_experiment[0]).write_text("nothing\n")
    assert summary_of(study, "bad").note
    assert json.dumps(comparison_of([summary_of(study, "bad")]))


def test_an_empty_study_is_compared_too(tmp_path):
    empty = summary_of(Study(tmp_path / "new"), "new")
    assert comparison_of([empty])["studies"][0]["verdict"] == ""


def test_records_are_read_as_the_last_step_read_them(tmp_path):
    study = make_study(tmp_path / "own")
    name = study.last_experiment[0]
    columns = study.path(name).read_text().replace("u,y", "drive,gyro", 1)
    study.path(name).write_text(columns)
    assert "drive" in columns
    study.add_step(
        number=study.begin_step(),
        verb="look",
        arguments=["look", "--u=drive", "--y", "gyro", name, "--factor=gyro=2.0", "--unit=gyro=deg/s"],
        exit_code=0,
        words=["seen"],
        outputs=[],
    )
    assert summary_of(study, "own").fit_percent == pytest.approx(50, abs=1)  # twice the output of the model


def test_several_responses_are_one_picture_and_too_many_are_refused(three):
    names = three[0].last_experiment
    assert [one["name"] for one in responses_of(three[0], names)["curves"]] == ["az.csv"]
    with pytest.raises(InputError, match="fit into one picture"):
        responses_of(three[0], names * 7)


def test_the_server_compares_listed_studies_and_refuses_paths(ask, server):
    make_study(server.folder.parent / "beside")
    names = [one["name"] for one in json.loads(ask("GET", "/studies").text)["studies"]]
    assert names == ["beside"]
    answer = ask("POST", "/studies/compare", json.dumps({"names": names}))
    assert [one["name"] for one in json.loads(answer.text)["studies"]] == ["st", "beside"]
    for wrong in ("../beside", "/etc", str(server.folder), ""):
        assert ask("POST", "/studies/compare", json.dumps({"names": [wrong]})).code == 400
        assert ask("GET", f"/studies/steps?name={wrong}").code == 400
    assert json.loads(ask("GET", "/studies/steps?name=beside").text) == {"steps": []}
    for path in ("session.json", "verdicts/../session.json", "../st/session.json", "verdicts/none.json"):
        assert ask("GET", f"/studies/file?name=beside&path={path}").code == 400
