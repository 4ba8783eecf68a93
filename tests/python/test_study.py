"""The folder of a study."""

import json
import os
from concurrent.futures import ThreadPoolExecutor

import pytest

import gsid
from gsid.study.folder import FOLDERS, LOG, SESSION, Study


@pytest.fixture
def study(tmp_path):
    return Study(tmp_path / "study")


def file_of(folder, name, text):
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    return folder / name


def test_a_new_study_has_its_folders(study):
    assert {path.name for path in study.folder.iterdir()} == {*FOLDERS, SESSION}
    assert json.loads((study.folder / SESSION).read_text())["gsid_study"] == 1
    assert (study.files, study.steps) == ({}, [])


def test_a_file_is_copied_and_the_same_content_is_kept_once(study, tmp_path):
    source = file_of(tmp_path / "a", "rec.csv", "u,y\n1,2\n")
    assert study.add_file(source) == "records/rec.csv"
    assert study.add_file(file_of(tmp_path / "b", "other.csv", "u,y\n1,2\n")) == "records/rec.csv"
    assert study.add_file(file_of(tmp_path / "c", "rec.csv", "u,y\n3,4\n")) == "records/rec-2.csv"
    source.unlink()
    assert study.path("records/rec.csv").read_text() == "u,y\n1,2\n"


def test_steps_and_their_commands_are_kept(study):
    (study.folder / "models/1-start.json").write_text("{}")
    step = study.add_step(
        ["start", "records/a b.csv"], 0, words=["found"], outputs=["models/1-start.json", "none"]
    )
    assert step.outputs == ("models/1-start.json",)
    again = Study(study.folder)
    assert again.steps == [step]
    assert (again.folder / LOG).read_text() == "gsid start 'records/a b.csv'\n"
    assert again.next_number() == 2


def test_steps_of_several_processes_are_all_kept(study):
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda i: Study(study.folder).add_step(["look", str(i)], 0), range(12)))
    assert [step.number for step in study.steps] == list(range(1, 13))
    assert len((study.folder / LOG).read_text().splitlines()) == 12


def test_a_folder_with_other_files_is_refused(tmp_path):
    file_of(tmp_path / "mine", "thesis.txt", "")
    with pytest.raises(gsid.InputError, match="holds files but no study"):
        Study(tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"gsid_study": 1, "files": [], "steps": 3}'])
def test_a_broken_session_is_refused_and_kept(study, text):
    (study.folder / SESSION).write_text(text)
    with pytest.raises(gsid.InputError, match="not the session of a study"):
        Study(study.folder)
    assert (study.folder / SESSION).read_text() == text


def test_a_later_version_is_refused(study):
    (study.folder / SESSION).write_text('{"gsid_study": 2, "files": {}, "steps": []}')
    with pytest.raises(gsid.InputError, match="another version"):
        Study(study.folder)


@pytest.mark.parametrize(
    "name", ["../secret", "/etc/hostname", "records/../../secret", "records", "records/none"]
)
def test_paths_outside_the_study_are_refused(study, name):
    (study.folder.parent / "secret").write_text("secret")
    with pytest.raises(gsid.InputError, match="no such file in the study"):
        study.path(name)


def test_a_link_to_the_outside_is_refused(study):
    (study.folder.parent / "secret").write_text("secret")
    os.symlink(study.folder.parent / "secret", study.folder / "records/link.csv")
    with pytest.raises(gsid.InputError, match="no such file in the study"):
        study.path("records/link.csv")
