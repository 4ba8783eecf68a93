"""`gsid -C DIR VERB`: a verb in the folder of a study."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from known_system import response

from gsid.cli.files_in_use import InputPath
from gsid.cli.in_study import COPIED_TO, OWN, STEPS, Typed
from gsid.cli.main import VERBS
from gsid.cli.main import gsid as group
from gsid.models.load import load_single
from gsid.records.files import write_record
from gsid.study.folder import LOG, SESSION, Study

GSID = [sys.executable, "-m", "gsid.cli.main"]
FIT = ("--order", "2/0")
DEADLINE_S = 60


@pytest.fixture
def study(gsid, rec_csv):
    """A study with one record, made by the command."""
    assert gsid("-C", "st", "open", rec_csv).code == 0
    return Study("st")


def shape_of(model):
    f_hz = np.linspace(5, 400, 40)
    return model.response(f_hz)


# ---- beginning a study -----------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", [("look",), ("frf",), ("run", "--port", "none")])
def test_a_folder_that_is_no_study_has_a_hint(gsid, tmp_path, verb):
    (tmp_path / "a b").mkdir()
    result = gsid("-C", "a b", *verb)
    assert result.code == 3
    assert "the folder is not a study" in result.err
    assert "hint: `gsid -C 'a b' open [FILES]...` makes one" in result.err
    assert list((tmp_path / "a b").iterdir()) == []


def test_open_makes_a_study_and_copies_records(gsid, rec_csv, record, tmp_path):
    write_record(tmp_path / "b.csv", record)
    result = gsid("-C", "new/study", "open", rec_csv, "b.csv", "--json")
    assert result.code == 0
    values = json.loads(result.out)
    assert values["opened"] == ["records/rec.csv"] * 2  # the same content is kept once
    assert values["last_experiment"] == ["records/rec.csv"]
    assert Study(tmp_path / "new/study", create=False).last_experiment == ["records/rec.csv"]


def test_open_without_files_makes_an_empty_study(gsid):
    assert gsid("-C", "st", "open").code == 0
    result = gsid("-C", "st", "look")
    assert result.code == 3
    assert "the study has no records" in result.err


def test_open_without_a_study_has_a_hint(gsid, rec_csv):
    result = gsid("open", rec_csv)
    assert result.code == 2
    assert "hint: give -C DIR" in result.err


def test_open_refuses_what_no_verb_reads(gsid, tmp_path):
    (tmp_path / "notes.txt").write_text("notes")
    (tmp_path / "no_model.json").write_text("[]")
    for name in ("notes.txt", "no_model.json", "none.json"):
        assert gsid("-C", "st", "open", name).code == 3
    assert not (tmp_path / "st").exists()


@pytest.mark.parametrize("verb", sorted({*VERBS} - {*STEPS, *OWN}))
def test_verbs_without_a_study_refuse_it(gsid, study, verb):
    result = gsid("-C", "st", verb)
    assert result.code == 2
    assert "hint: leave out -C" in result.err


# ---- records, model and outputs that are not named -------------------------------------------------------


def test_the_loop_without_naming_a_file(gsid, study):
    assert gsid("-C", "st", "frf").code == 0
    assert gsid("-C", "st", "fit", *FIT).code == 0
    result = gsid("-C", "st", "compare", "--fitted", "--json")
    assert result.code == 0
    assert "records of the last experiment: records/rec.csv" in result.err
    assert "newest model: models/2-fit.json" in result.err
    used = {"step": 3, "records": ["records/rec.csv"], "model": "models/2-fit.json"}
    assert json.loads(result.out)["study"] == used | {"outputs": ["verdicts/3-compare.json"]}
    assert [(one.verb, one.exit_code, one.outputs) for one in study.steps] == [
        ("frf", 0, ("responses/1-frf.csv", "verdicts/1-frf.json")),
        ("fit", 0, ("models/2-fit.json", "verdicts/2-fit.json")),
        ("compare", 0, ("verdicts/3-compare.json",)),
    ]
    assert study.answer(study.steps[-1]) == json.loads(result.out)
    model = load_single("st/models/2-fit.json")
    f_hz = np.array([30.0, 60.0, 90.0])
    np.testing.assert_allclose(model.response(f_hz), response(f_hz), rtol=0.02)


def test_the_last_experiment_is_what_was_opened_or_named_together_last(gsid, study, record, tmp_path):
    for name in ("b.csv", "c.csv", "d.csv"):
        record.y[:] += 1e-3
        write_record(tmp_path / name, record)
    gsid("-C", "st", "open", "b.csv", "c.csv")
    assert study.last_experiment == ["records/b.csv", "records/c.csv"]
    gsid("-C", "st", "look", "st/records/rec.csv")
    assert study.last_experiment == ["records/b.csv", "records/c.csv"]
    assert gsid("-C", "st", "look", "d.csv").code == 0
    assert study.last_experiment == ["records/d.csv"]
    assert gsid("-C", "st", "fit", *FIT, "records/rec.csv", "--held-out", "b.csv").code == 0
    assert study.last_experiment == ["records/d.csv"]


def test_a_failed_criterion_is_a_step(gsid, study):
    gsid("-C", "st", "fit", "--order", "1/0", "--delay", "none")
    assert gsid("-C", "st", "compare", "--check").code == 1
    assert study.steps[-1].exit_code == 1
    assert len((study.folder / LOG).read_text().splitlines()) == 2


def test_a_usage_error_is_no_step(gsid, study):
    for words in (["fit"], ["fit", "--nonsense"], ["look", "--fs", "x"], ["design"], ["look", "--help"]):
        assert gsid("-C", "st", *words).code == (0 if "--help" in words else 2)
    assert study.steps == []
    assert gsid("-C", "st", "look").code == 0
    assert study.steps[0].number == 1


def test_bad_input_is_in_the_session_but_not_in_the_log(gsid, study, tmp_path):
    (tmp_path / "bad.csv").write_text("u,y\n1,x\n")
    assert gsid("-C", "st", "look", "bad.csv").code == 3
    (step,) = study.steps
    assert step.exit_code == 3
    assert step.words[0].startswith("error:")
    assert (study.folder / LOG).read_text() == ""


def test_two_models_that_were_opened_last_are_ambiguous(gsid, study, tmp_path):
    for order, name in (("2/0", "a.json"), ("1/0", "b.json")):
        assert gsid("fit", "rec.csv", "--order", order, "-o", name).code == 0
    gsid("-C", "st", "open", "a.json", "b.json")
    result = gsid("-C", "st", "compare")
    assert result.code == 3
    assert "several models were opened last" in result.err
    assert "models/a.json, models/b.json" in result.err
    assert gsid("-C", "st", "compare", "--model", "models/a.json", "--fitted").code == 0
    assert gsid("-C", "st", "fit", *FIT).code == 0
    assert gsid("-C", "st", "compare", "--fitted").code == 0
    assert study.steps[-1].arguments[-3:-1] == ("--model", "models/2-fit.json") or "models/2-fit.json" in (
        study.steps[-1].arguments
    )


def test_an_excitation_is_kept(gsid, study):
    design = ("design", "multisine", "--fs", 3000, "--period", 600, "--band", "5:250")
    assert gsid("-C", "st", *design).code == 0
    assert study.steps[0].outputs == ("excitation/1-design.csv",)
    assert "crest factor" in study.steps[0].words[0]


def test_export_and_report_are_kept(undrawn, gsid, study, tmp_path):
    gsid("-C", "st", "fit", *FIT)
    assert gsid("-C", "st", "export-c", "--fs", "1000").code == 0
    assert study.steps[-1].outputs == ("models/2-export-c/model.c", "models/2-export-c/model.h")
    assert gsid("-C", "st", "export-c", "--fs", "1000", "-o", "rig.c").code == 0
    assert "rig_step" in (tmp_path / "rig.h").read_text()
    assert (tmp_path / "rig.c").read_bytes() == (study.folder / "models/3-export-c/rig.c").read_bytes()
    assert gsid("-C", "st", "report", "--model", "models/1-fit.json").code == 0
    assert study.steps[-1].outputs == ("verdicts/4-report.html",)


def test_add_names_its_records_in_both_forms(gsid):
    """With a law of the user the first name is a record, otherwise an effect."""
    context = click.Context(group, info_name="gsid", help_option_names=["-h", "--help"])
    for words, records in (
        (["add", "coulomb_friction"], []),
        (["add", "coulomb_friction", "a.csv"], ["a.csv"]),
        (["add", "--torque", "c*w", "a.csv", "b.csv"], ["a.csv", "b.csv"]),
        (["add", "--torque", "c*w"], []),
    ):
        typed = Typed.read(context, words)
        assert typed.values.get("records", []) == records


# ---- names and folders -----------------------------------------------------------------------------------


def test_names_with_spaces_and_files_from_elsewhere(gsid, record, tmp_path, monkeypatch):
    (tmp_path / "my data").mkdir()
    (tmp_path / "work").mkdir()
    write_record(tmp_path / "my data/first try.csv", record)
    monkeypatch.chdir(tmp_path / "work")
    assert gsid("-C", "../my study", "open", "../my data/first try.csv").code == 0
    assert gsid("-C", "../my study", "fit", *FIT, "-o", "out model.json").code == 0
    study = Study(tmp_path / "my study", create=False)
    assert (tmp_path / "work/out model.json").read_bytes() == (
        study.folder / "models/1-fit.json"
    ).read_bytes()
    log = (study.folder / LOG).read_text()
    assert shlex.split(log)[:3] == ["gsid", "fit", "records/first try.csv"]
    assert str(tmp_path) not in log + (study.folder / SESSION).read_text()
    assert Path.cwd() == tmp_path / "work"


def test_a_name_is_first_that_of_the_callers_folder(gsid, study, record, tmp_path):
    (tmp_path / "records").mkdir()
    record.y[:] *= 2
    write_record(tmp_path / "records/rec.csv", record)
    assert gsid("-C", "st", "look", "records/rec.csv").code == 0
    assert study.last_experiment == ["records/rec-2.csv"]


def test_the_commands_of_the_log_repeat_the_study(gsid, study, tmp_path):
    gsid("-C", "st", "fit", *FIT)
    gsid("-C", "st", "compare", "--fitted", "--band", "20:200")
    shutil.copytree("st", "copy")
    (tmp_path / "copy/models/1-fit.json").unlink()
    subprocess.run(["sh", "-e", LOG], cwd="copy", check=True, env=os.environ | {"PATH": _path(tmp_path)})
    one, other = (load_single(f"{folder}/models/1-fit.json") for folder in ("st", "copy"))
    np.testing.assert_allclose(shape_of(one), shape_of(other), rtol=1e-9)


def _path(tmp_path):
    """PATH with a gsid of this Python first."""
    folder = tmp_path / "bin"
    folder.mkdir(exist_ok=True)
    (folder / "gsid").write_text(f'#!/bin/sh\nexec {shlex.join(GSID)} "$@"\n')
    (folder / "gsid").chmod(0o755)
    return f"{folder}{os.pathsep}{os.environ['PATH']}"


def test_an_output_cannot_replace_an_input(gsid, study):
    before = (study.folder / "records/rec.csv").read_bytes()
    result = gsid("-C", "st", "frf", "-o", "st/records/rec.csv")
    assert result.code == 3
    assert "the output would replace an input" in result.err
    assert (study.folder / "records/rec.csv").read_bytes() == before


@pytest.mark.parametrize("name", [SESSION, LOG])
def test_an_output_cannot_replace_the_session(gsid, study, name):
    text = (study.folder / SESSION).read_text()
    gsid("-C", "st", "frf", "-o", f"st/{name}")
    assert (
        json.loads((study.folder / SESSION).read_text())["files"].items() >= json.loads(text)["files"].items()
    )
    assert Study("st", create=False).steps is not None


def test_the_standard_output_stays(study):
    run = subprocess.run([*GSID, "-C", "st", "frf", "-o", "-"], capture_output=True, text=True)
    assert run.returncode == 0
    assert run.stdout.startswith("# n_periods")
    assert study.steps[0].outputs == ("verdicts/1-frf.json",)


def test_suggested_commands_name_the_study(gsid, study):
    result = gsid("-C", "st", "start")
    assert "hint: `gsid -C st diagnose --model models/1-start.json records/rec.csv`" in result.err


# ---- ends that are not planned ---------------------------------------------------------------------------


def test_processes_at_the_same_time_have_steps_of_their_own(study):
    running = [
        subprocess.Popen([*GSID, "-C", "st", "fit", *FIT], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        for _ in range(3)
    ]
    for process in running:
        assert process.wait(timeout=DEADLINE_S) == 0, process.stderr.read()
        process.stderr.close()
    assert [step.number for step in study.steps] == [1, 2, 3]
    assert [step.outputs[0] for step in study.steps] == [f"models/{n}-fit.json" for n in (1, 2, 3)]
    assert len((study.folder / LOG).read_text().splitlines()) == 3


def test_ctrl_c_is_noted_as_a_stopped_step(study):
    waits = "import time, gsid.response.estimate as e\n"
    waits += "e.frf = lambda *_, **__: print('-', flush=True) or time.sleep(60)\n"
    code = f"{waits}import sys; from gsid.cli.main import main; sys.exit(main(['-C', 'st', 'frf']))"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline() == b"-\n"
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 130
    (step,) = study.steps
    assert (step.exit_code, step.words[0]) == (130, "The step was stopped.")
    assert (study.folder / LOG).read_text() == ""


def test_a_study_that_cannot_be_written_is_an_error(study):
    root = os.geteuid() == 0  # may write everywhere, unless it gives this up
    command = [*(["setpriv", "--bounding-set=-dac_override"] if root else []), *GSID, "-C", "st", "look"]
    folders = [study.folder, *(path for path in study.folder.rglob("*") if path.is_dir())]
    for path in folders:
        path.chmod(0o555)
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
    finally:
        for path in folders:
            path.chmod(0o755)
    assert run.returncode == 3, run.stderr
    assert "the study cannot be written" in run.stderr
    assert "hint: make the folder writable" in run.stderr


def test_studio_takes_the_study_of_the_command(study):
    process = subprocess.Popen(
        [*GSID, "-C", "st", "studio", "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert "127.0.0.1" in process.stdout.readline()
        assert not Path("study").exists()
        assert (study.folder / ".server.lock").exists()
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=DEADLINE_S)


# ---- completeness ----------------------------------------------------------------------------------------


def commands(command, name):
    if isinstance(command, click.Group):
        context = click.Context(command)
        for one in command.list_commands(context):
            yield from commands(command.get_command(context, one), f"{name} {one}")
    else:
        yield name, command


@pytest.mark.parametrize("verb", STEPS)
def test_every_input_of_a_step_has_a_folder(verb):
    for _, command in commands(group.get_command(click.Context(group), verb), verb):
        inputs = {param.name for param in command.params if isinstance(param.type, InputPath)}
        assert inputs <= set(COPIED_TO)
        assert not any(param.secondary_opts for param in command.params)  # written back as they were typed
        assert all(param.nargs == 1 or param.name == "records" for param in command.params)


# ---- measuring -------------------------------------------------------------------------------------------


def test_a_run_is_the_last_experiment(gsid, study):
    axis = subprocess.Popen(
        [*GSID, "simulate", "--once"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        port = axis.stdout.readline().strip()
        excite = ("--period", "600", "--band", "10:600", "--periods", "3", "--settle", "1p")
        assert gsid("-C", "st", "run", "--port", port, *excite).code == 0
        axis.wait(timeout=DEADLINE_S)
    finally:
        axis.kill()
        axis.communicate()
    assert study.steps[0].outputs == ("records/1-run.csv", "verdicts/1-run.json")
    assert study.last_experiment == ["records/1-run.csv"]
    assert study.steps[0].words == ("Measured records/1-run.csv: 3 good periods, 0 lost.",)
    assert gsid("-C", "st", "look").code == 0
    assert study.steps[1].arguments[:2] == ("look", "records/1-run.csv")


def test_a_part_of_a_record_is_the_last_experiment(gsid, study):
    assert gsid("-C", "st", "cut", "--to", "1.2").code == 0
    assert study.last_experiment == ["records/1-cut.csv"]


@pytest.mark.parametrize("character", ["\n", "\t", "\x85", "\u2028", "\u202e", "\x1b"])
def test_a_word_with_a_line_break_is_refused_before_the_step(gsid, study, character):
    """commands.log has one command a line."""
    result = gsid("-C", "st", "look", "--u", f"u{character}reboot")
    assert result.code == 3
    assert "cannot be printed" in result.err
    assert (study.steps, study.begin_step()) == ([], 1)


def test_a_column_with_a_non_breaking_space_is_selected(gsid, tmp_path, record):
    """Spreadsheets and translated programs write such names; the study refused them as not printable."""
    write_record(tmp_path / "a.csv", record)
    text = (tmp_path / "a.csv").read_text().replace("t_s,u,", "t_s,Drive\u00a0[V],")
    (tmp_path / "a\u202fb.csv").write_text(text)
    assert gsid("-C", "st", "open", "a\u202fb.csv").code == 0
    assert gsid("-C", "st", "look", "--u", "Drive\u00a0[V]").code == 0
    study = Study("st")  # its session is read again
    assert study.steps[0].arguments[:4] == ("look", "records/a\u202fb.csv", "--u", "Drive\u00a0[V]")
    assert (study.folder / LOG).read_text().count("\n") == len(study.steps)


def test_a_port_in_the_callers_folder_is_not_searched_in_the_study(gsid, study, tmp_path):
    """The path that `gsid simulate` or a link names was taken from the folder of the study."""
    (tmp_path / "axis").write_text("no serial port")
    result = gsid("-C", "st", "run", "--port", "axis")
    assert result.code == 3
    (step,) = study.steps
    assert f"--port {tmp_path / 'axis'}" in step.command
    assert "No such file" not in result.err


def test_the_version_in_a_deleted_folder_is_no_traceback(gsid, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    result = gsid("--version")
    assert (result.code, result.out[:5]) == (0, "gsid ")
    assert gsid("look", "none.csv").code == 3
