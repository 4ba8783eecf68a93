"""The folder of a study."""

import hashlib
import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

import gsid
from gsid.base.errors import InputError
from gsid.study import folder as study_folder
from gsid.study.folder import FOLDERS, LOCK, LOG, SESSION, VERSION, Step, Study, usable_name


@pytest.fixture
def study(tmp_path):
    return Study(tmp_path / "study")


def file_of(folder, name, text):
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    return folder / name


def test_a_new_study_has_its_folders(study):
    assert {path.name for path in study.folder.iterdir()} - {LOCK} == {*FOLDERS, SESSION}
    assert json.loads((study.folder / SESSION).read_text())["gsid_study"] == VERSION
    assert (study.files, study.steps) == ({}, [])


def test_a_file_is_copied_and_the_same_content_is_kept_once(study, tmp_path):
    source = file_of(tmp_path / "a", "rec.csv", "u,y\n1,2\n")
    assert study.add_file(source) == "records/rec.csv"
    assert study.add_file(file_of(tmp_path / "b", "other.csv", "u,y\n1,2\n")) == "records/rec.csv"
    assert study.add_file(file_of(tmp_path / "c", "rec.csv", "u,y\n3,4\n")) == "records/rec-2.csv"
    source.unlink()
    assert study.path("records/rec.csv").read_text() == "u,y\n1,2\n"


def test_steps_and_their_commands_are_kept(study):
    number = study.begin_step()
    (study.folder / "models/1-start.json").write_text("{}")
    step = study.add_step(
        ["start", "records/a b.csv"],
        0,
        words=["found"],
        outputs=["models/1-start.json", "none"],
        number=number,
    )
    assert step.outputs == ("models/1-start.json",)
    again = Study(study.folder)
    assert again.steps == [step]
    assert (again.folder / LOG).read_text() == "gsid start 'records/a b.csv'\n"
    assert again.begin_step() == 2


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


@pytest.mark.parametrize("rest", ['"files": {}, "steps": []', '"records": [], "steps": 3'])
def test_another_version_is_refused_whatever_else_it_has(study, rest):
    (study.folder / SESSION).write_text(f'{{"gsid_study": {VERSION + 1}, {rest}}}')
    with pytest.raises(gsid.InputError, match="another version"):
        Study(study.folder)


@pytest.mark.parametrize(
    "name",
    [
        "../secret",
        "/etc/hostname",
        "records/../../secret",
        "records",
        "records/none",
        "records/a\0b",
        "a" * 5000,
        "",
    ],
)
def test_paths_outside_the_study_are_refused(study, name):
    (study.folder.parent / "secret").write_text("secret")
    with pytest.raises(gsid.InputError, match="no such file in the study"):
        study.path(name)


def test_a_link_to_the_outside_is_refused(study):
    (study.folder.parent / "secret").write_text("secret")
    os.symlink(study.folder.parent / "secret", study.folder / "records/link.csv")
    os.symlink("loop.csv", study.folder / "records/loop.csv")
    for name in ("records/link.csv", "records/loop.csv"):
        with pytest.raises(gsid.InputError, match="no such file in the study"):
            study.path(name)


@pytest.mark.parametrize("name", [SESSION, LOG, LOCK, *FOLDERS])
def test_nothing_is_written_through_links(study, tmp_path, name):
    source = file_of(tmp_path / "a", "rec.csv", "u,y\n1,2\n")
    place, outside = study.folder / name, tmp_path / "outside"
    if place.exists():
        place.rename(outside)
    else:
        outside.write_text("mine")
    before = outside.read_text() if outside.is_file() else None
    os.symlink(outside, place)
    for attempt in (
        lambda: Study(study.folder),
        lambda: study.add_file(source),
        lambda: study.add_step(["look"], 0),
    ):
        with pytest.raises(gsid.InputError, match="no symbolic links"):
            attempt()
    if before is None:
        assert list(outside.iterdir()) == []
    else:
        assert outside.read_text() == before


def test_a_study_whose_first_write_failed_can_begin_again(tmp_path):
    for name in FOLDERS[:3]:
        (tmp_path / "study" / name).mkdir(parents=True)
    (tmp_path / "study" / LOCK).touch()
    assert Study(tmp_path / "study").steps == []


def test_a_folder_that_holds_a_file_in_records_is_not_taken(tmp_path):
    file_of(tmp_path / "records", "mine.csv", "u,y\n")
    with pytest.raises(gsid.InputError, match="holds files but no study"):
        Study(tmp_path)


def test_empty_folders_that_a_copy_has_lost_are_made_again(study):
    (study.folder / "verdicts").rmdir()
    Study(study.folder)
    assert (study.folder / "verdicts").is_dir()


@pytest.mark.parametrize("change", ["edit", "remove"])
def test_a_known_file_that_has_changed_is_not_taken_for_the_content(study, tmp_path, change):
    source = file_of(tmp_path / "a", "rec.csv", "u,y\n1,2\n")
    kept = study.folder / study.add_file(source)
    if change == "edit":
        kept.write_text("u,y\n9,9\n")
    else:
        kept.unlink()
    assert study.path(study.add_file(source)).read_text() == "u,y\n1,2\n"


def test_the_digest_is_that_of_the_copy(study, tmp_path, monkeypatch):
    source = file_of(tmp_path / "a", "rec.csv", "u,y\n1,2\n")
    copyfile = shutil.copyfile

    def still_growing(one, other):
        with open(one, "a") as file:
            file.write("3,4\n")
        return copyfile(one, other)

    monkeypatch.setattr("shutil.copyfile", still_growing)
    name = study.add_file(source)
    assert study.files[name] == hashlib.sha256((study.folder / name).read_bytes()).hexdigest()


def test_a_copy_does_not_lock_the_study(study, tmp_path, monkeypatch):
    source = file_of(tmp_path / "a", "rec.csv", "u,y\n1,2\n")
    copyfile = shutil.copyfile

    def slow(one, other):
        Study(study.folder).add_step(["look"], 0)
        return copyfile(one, other)

    monkeypatch.setattr(study_folder, "LOCK_TIME_S", 0.1)
    monkeypatch.setattr("shutil.copyfile", slow)
    assert study.add_file(source) == "records/rec.csv"
    assert len(study.steps) == 1


def test_a_failed_copy_leaves_nothing(study, tmp_path):
    before = sorted(study.folder.rglob("*"))
    with pytest.raises(FileNotFoundError):
        study.add_file(tmp_path / "none.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(gsid.InputError, match="not a regular file"):
        study.add_file(tmp_path / "pipe.csv")
    assert sorted(study.folder.rglob("*")) == before


def test_no_command_is_logged_that_the_session_lacks(study, monkeypatch):
    def full(path, write):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(study_folder, "write_atomically", full)
    with pytest.raises(OSError, match="No space"):
        study.add_step(["look"], 0)
    assert not (study.folder / LOG).exists()


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a/..", ".hidden", "a\nb", "a\0b", "a\x7f", "\udcff.csv", "ü" * 101]
)
def test_names_that_are_not_usable_are_refused(study, tmp_path, name):
    with pytest.raises(gsid.InputError, match="no usable name"):
        usable_name(name)
    source = file_of(tmp_path / "a", "rec.csv", "")
    if name:  # empty: that of the source
        with pytest.raises(gsid.InputError, match="no usable name"):
            study.add_file(source, name)


@pytest.mark.parametrize("name", ["a b.csv", "-x.csv", "größe.csv", "a" * 200])
def test_usable_names_are_kept(name):
    assert usable_name(f"/some/where/{name}") == name


def with_meta(folder, values, **more):
    file_of(folder, "meta.json", json.dumps({"files": ["rec.csv", "other.csv"], **more}))
    return file_of(folder, "rec.csv", "u,y\n" + "\n".join(f"{one},0" for one in values))


def test_rate_and_units_in_a_meta_file_beside_a_record_are_kept(study, tmp_path):
    channels = [{"name": "u", "unit": "A"}, {"name": "y", "unit": "rad/s"}]
    one = study.add_file(with_meta(tmp_path / "a", range(9), fs_hz=500, channels=channels))
    record = gsid.read_record(study.path(one))
    assert (record.fs_hz, record.u_unit, record.y_unit) == (500, "A", "rad/s")
    assert list(study.files) == [one]
    hashed = json.loads((study.folder / SESSION).read_text())["files"]
    assert set(hashed) == {one, "records/rec/meta.json"}


def test_what_a_meta_file_states_of_each_record_is_kept(study, tmp_path):
    source = file_of(tmp_path / "a", "rec.csv", "u,y\n1,2\n")
    files = {"rec.csv": {"level": 2}, "other.csv": {"level": 3}}
    file_of(tmp_path / "a", "meta.json", json.dumps({"files": files, "fs_hz": 50}))
    one = study.add_file(source)
    kept = json.loads((study.folder / one).with_name("meta.json").read_text())
    assert kept == {"files": {"rec.csv": {"level": 2}}, "fs_hz": 50}
    assert study.add_file(source) == one


def test_two_experiments_keep_their_own_rates(study, tmp_path):
    kept = [
        study.add_file(with_meta(tmp_path / name, range(9), fs_hz=rate))
        for name, rate in (("a", 500), ("b", 1000), ("c", 500))
    ]
    assert [gsid.read_record(study.path(one)).fs_hz for one in kept] == [500, 1000, 500]
    assert kept[0] == kept[2]


def test_a_meta_file_of_another_purpose_is_not_copied(study, tmp_path):
    file_of(tmp_path / "a", "meta.json", '{"files": ["other.csv"], "fs_hz": 3}')
    assert study.add_file(file_of(tmp_path / "a", "rec.csv", "u,y\n")) == "records/rec.csv"
    assert [path.name for path in (study.folder / "records").iterdir()] == ["rec.csv"]


# ---- experiments, models, answers ------------------------------------------------------------------------


def test_records_that_are_opened_together_are_one_experiment(study, tmp_path):
    files = [file_of(tmp_path / "a", f"{name}.csv", f"u,y\n1,{name}\n") for name in range(4)]
    assert study.last_experiment == []
    study.open_files(files[:2])
    assert study.last_experiment == ["records/0.csv", "records/1.csv"]
    study.add_file(files[2])
    assert study.last_experiment == ["records/2.csv"]
    study.add_file(files[3], experiment="last")
    study.add_file(files[0], experiment=None)
    assert study.last_experiment == ["records/2.csv", "records/3.csv"]
    study.open_files(files[:2])  # known: the study keeps one copy
    assert Study(study.folder).last_experiment == ["records/0.csv", "records/1.csv"]


def model_of(study, name):
    (study.folder / name).write_text(f'{{"name": "{name}"}}')
    return name


def test_the_newest_model_is_the_one_made_or_opened_last(study, tmp_path):
    assert study.newest_models == []
    study.add_step(["start"], 0, outputs=[model_of(study, "models/1-start.json")])
    assert study.newest_models == ["models/1-start.json"]
    study.open_files([file_of(tmp_path / "a", "a.json", "{}")], "models")
    assert study.newest_models == ["models/a.json"]
    study.open_files([file_of(tmp_path / "a", "b.json", "[]")], "models")
    assert study.newest_models == ["models/a.json", "models/b.json"]
    study.add_step(["fit"], 0, outputs=[model_of(study, "models/2-fit.json")])
    assert study.newest_models == ["models/2-fit.json"]
    study.open_files([tmp_path / "a/a.json"], "models")
    assert study.newest_models == ["models/a.json"]


def test_the_answer_of_a_step_is_kept(study):
    step = study.add_step(["look", "records/a.csv"], 0, answer=b'{"sentences": ["a"]}\n')
    assert step.answer == "verdicts/1-look.answer.json"
    assert (step.picture, Study(study.folder).answer(step)) == ("", {"sentences": ["a"]})
    assert step.answer in study.files
    (study.folder / step.answer).write_text("{")
    assert study.answer(step) is None


@pytest.mark.parametrize("answer", [b"", b"interrupt\n", b"[1]", b'{"a": ', b"\xff"])
def test_an_answer_that_is_no_object_is_not_kept(study, answer):
    step = study.add_step(["look"], 130, answer=answer)
    assert (step.answer, study.answer(step)) == ("", None)


@pytest.mark.parametrize(
    ("exit_code", "outputs", "is_kept"),
    [
        (0, [], True),
        (1, [], True),
        (130, [], False),
        (130, ["models/m.json"], True),
        (3, [], False),
        (-9, [], False),
    ],
)
def test_the_log_has_the_commands_with_a_result(study, exit_code, outputs, is_kept):
    for name in outputs:
        model_of(study, name)
    study.add_step(["look"], exit_code, outputs=outputs)
    assert len(study.steps) == 1
    assert (study.folder / LOG).read_text() == ("gsid look\n" if is_kept else "")


def test_a_number_that_was_given_back_is_used_again(study):
    first, second = study.begin_step(), study.begin_step()
    study.cancel_step(first)  # another has begun since: its number stays
    assert study.begin_step() == second + 1
    study.cancel_step(second + 1)
    assert study.begin_step() == second + 1


def test_files_of_a_step_that_was_not_noted_are_kept(study):
    model_of(study, "models/1-start.json")
    assert study.begin_step() == 2


# ---- versions --------------------------------------------------------------------------------------------

FIRST = {
    "gsid_study": 1,
    "files": {"records/a.csv": "0" * 64, "records/b/meta.json": "1" * 64, "records/b/b.csv": "2" * 64},
    "steps": [
        {
            "number": 1,
            "verb": "look",
            "arguments": ["look", "records/a.csv", "--json"],
            "exit_code": 0,
            "words": ["a.csv: 9 samples"],
            "outputs": [],
        }
    ],
}


def test_a_study_of_the_first_version_is_read_and_then_written_as_the_present_one(study):
    """Its records, which had no experiments, are one."""
    (study.folder / SESSION).write_text(json.dumps(FIRST))
    old = Study(study.folder)
    assert json.loads((study.folder / SESSION).read_text()) == FIRST  # reading changes nothing
    assert old.last_experiment == ["records/a.csv", "records/b/b.csv"]
    expected = Step(1, "look", ("look", "records/a.csv", "--json"), 0, ("a.csv: 9 samples",))
    assert old.steps == [expected]
    assert old.begin_step() == 2
    known = json.loads((study.folder / SESSION).read_text())
    assert known["gsid_study"] == VERSION
    assert (Study(study.folder).steps, known["files"]) == ([expected], FIRST["files"])
    assert known["experiments"] == [["records/a.csv", "records/b/b.csv"]]


@pytest.mark.parametrize("version", [0, VERSION + 1, "1.5", None, [1]])
def test_an_unknown_version_is_refused_and_kept(study, version):
    text = json.dumps(FIRST | {"gsid_study": version})
    (study.folder / SESSION).write_text(text)
    with pytest.raises(gsid.InputError, match="another version") as caught:
        Study(study.folder)
    assert f"this one reads 1, {VERSION}" in caught.value.hint
    assert (study.folder / SESSION).read_text() == text


def test_no_study_is_made_where_one_is_expected(tmp_path):
    (tmp_path / "empty").mkdir()
    for name in ("empty", "none"):
        with pytest.raises(gsid.InputError, match="not a study"):
            Study(tmp_path / name, create=False)
    assert list((tmp_path / "empty").iterdir()) == []
    assert not (tmp_path / "none").exists()


EVIL = "look\ntouch owned"


@pytest.mark.parametrize(
    "place",
    [("steps", 0, "arguments", 0), ("steps", 0, "verb"), ("experiments", 0, 0), ("files", "records/a.csv")],
)
def test_a_session_with_a_line_break_in_a_word_is_refused(tmp_path, place):
    """A script of the study had what followed it as a line of its own."""
    study = Study(tmp_path / "st")
    (tmp_path / "a.csv").write_text("u,y\n1,2\n")
    study.open_files([tmp_path / "a.csv"])
    study.add_step(["look", "records/a.csv"], 0)
    known = json.loads((study.folder / SESSION).read_text())
    entry = known
    for key in place[:-1]:
        entry = entry[key]
    entry[place[-1]] = EVIL
    (study.folder / SESSION).write_text(json.dumps(known))
    with pytest.raises(InputError, match="not the session of a study"):
        Study(study.folder)


def test_a_step_with_a_line_break_is_not_noted(tmp_path):
    """The log of commands had two lines, and the next reader no session."""
    study = Study(tmp_path / "st")
    with pytest.raises(InputError, match="cannot be printed"):
        study.add_step([EVIL], 0)
    assert Study(study.folder).steps == []
