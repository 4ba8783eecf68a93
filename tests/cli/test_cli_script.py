"""`gsid -C DIR script`: the script that repeats a study, run in a copy of it."""

import ast
import json
import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gsid.cli.in_study import STEPS
from gsid.cli.study_script import MEASURES, WRITERS, python_script, shell_script
from gsid.models.load import load_model
from gsid.plant.model import PlantModel
from gsid.records.files import read_record, write_record
from gsid.study.folder import Step, Study

GSID = [sys.executable, "-m", "gsid.cli.main"]
LAW = "c*w"
STORY = [
    ["look"],
    ["frf", "--band", "5:400"],
    ["distortion"],
    ["noise", "--alpha", "0.02"],
    ["start"],
    ["compare", "--alpha", "0.01"],
    ["predict"],
    ["fit", "--order", "2/0", "--delay", "0.0015"],
    ["fit", "--order", "auto", "--band", "20:120"],
    ["fit", "--model", "models/5-start.json"],
    ["add", "--torque", LAW, "--param", "c=1,-9:9", "--model", "models/5-start.json"],
    ["add", "coulomb_friction", "--model", "models/5-start.json", "--param", "level=2"],
    ["add", "--undo", "--model", "models/12-add.json"],
    ["diagnose", "--fast", "--model", "models/5-start.json"],
    ["cut", "--to", "1.6"],
    ["fit", "--order", "2/0"],
    ["design", "multisine", "--fs", "1000", "--period", "400", "--band", "5:100"],
]


# Files that are made and used again: each line of the script in sh is a process.
SHORT_STORY = [
    ["cut", "--to", "1.6"],
    ["fit", "--order", "2/0"],
    ["design", "multisine", "--fs", "1000", "--period", "400", "--band", "5:100"],
]


@pytest.fixture
def told(gsid, record, tmp_path):
    """Make a study of steps."""

    def make(story):
        write_record(tmp_path / "angle.csv", replace(record, y_unit="deg"))
        gsid("-C", "my study", "open", "angle.csv")
        for words in story:
            result = gsid("-C", "my study", *words)
            assert result.code == 0, (words, result.err)
        return Study("my study")

    return make


def numbers_of(path):
    """All numbers of a model that a fit determines."""
    model = load_model(path)
    if isinstance(model, PlantModel):
        return [param.value for effect in model.effects for param in effect.params.values()]
    return [*model.num, *model.den, model.delay_s]


def repeated(study, name, command):
    """A copy of a study, without what its steps made, after its script."""
    copy = study.folder.parent / name
    shutil.copytree(study.folder, copy)
    for step in study.steps:
        for made in step.outputs:
            (copy / made).unlink()
    environment = os.environ | {"PATH": _path(study.folder.parent)}
    run = subprocess.run(command, cwd=copy, capture_output=True, text=True, env=environment, timeout=300)
    assert run.returncode == 0, run.stderr
    return copy


def _path(folder):
    """PATH with a gsid of this Python first."""
    (folder / "bin").mkdir(exist_ok=True)
    (folder / "bin/gsid").write_text(f'#!/bin/sh\nexec {shlex.join(GSID)} "$@"\n')
    (folder / "bin/gsid").chmod(0o755)
    return f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"


def check_files(study, copy, n_models):
    """The files of a copy are those of the study."""
    models = [name for name in study.models if not name.startswith("models/14-")]  # nothing is missing
    assert len(models) == n_models
    for name in models:
        expected = numbers_of(study.folder / name)
        np.testing.assert_allclose(numbers_of(copy / name), expected, rtol=1e-9, atol=1e-300, err_msg=name)
    outputs = [name for step in study.steps for name in step.outputs]
    (cut,) = (name for name in outputs if name.startswith("records/"))
    np.testing.assert_array_equal(read_record(study.folder / cut).y, read_record(copy / cut).y)
    (design,) = (name for name in outputs if name.startswith("excitation/"))
    assert (copy / design).read_bytes() == (study.folder / design).read_bytes()


def test_the_script_in_sh_makes_the_models_of_the_study(gsid, told, tmp_path):
    study = told(SHORT_STORY)
    assert gsid("-C", "my study", "script", "-o", "commands.sh").code == 0
    check_files(study, repeated(study, "copy", ["sh", "-e", str(tmp_path / "commands.sh")]), 1)


def test_the_script_in_python_makes_the_models_of_the_study(gsid, told, tmp_path):
    """Every verb that has a function of the package, and one that has none."""
    study = told(STORY)
    assert gsid("-C", "my study", "script", "-o", "study.py").code == 0
    check_files(study, repeated(study, "copy", [sys.executable, str(tmp_path / "study.py")]), 8)
    text = (tmp_path / "study.py").read_text()  # only verbs without a function call the command
    assert [line for line in text.splitlines() if line.startswith("command(")] == [
        f"command({study.steps[-1].command.removeprefix('gsid ')!r})"
    ]


def test_every_step_is_written(gsid):
    """Verbs that are neither written nor measured are a deliberate list."""
    assert set(STEPS) - {*WRITERS, *MEASURES} == {"design", "export-c", "join", "next", "report"}


def test_what_cannot_be_repeated_is_a_comment(gsid, rec_csv, tmp_path):
    gsid("-C", "st", "open", rec_csv)
    study = Study("st")
    (study.folder / "records/1-run.csv").write_bytes((tmp_path / rec_csv).read_bytes())
    study.add_step(
        ["run", "--port", "/dev/x", "-o", "records/1-run.csv"], 0, outputs=["records/1-run.csv"], number=1
    )
    study.add_step(["look", "records/none.csv"], 3, words=["error: no such file"])
    (study.folder / "models/3-diagnose.json").write_text("{}")
    study.add_step(["diagnose", "records/rec.csv"], 130, outputs=["models/3-diagnose.json"], number=3)
    shell, python = tmp_path / "a.sh", tmp_path / "a.py"
    for path in (shell, python):
        assert gsid("-C", "st", "script", "-o", path).code == 0
        text = path.read_text()
        digests = json.loads((study.folder / "session.json").read_text())["files"]
        for name in ("records/rec.csv", "records/1-run.csv", "models/3-diagnose.json"):
            assert f"{digests[name]}  {name}" in text
        commands = [line for line in text.splitlines() if line and not line.startswith(("#", "import"))]
        assert commands == []
        assert ("measured" in text, "stopped" in text, "failed" in text) == (True, True, True)
    assert subprocess.run(["sh", shell], cwd="st").returncode == 0


def test_a_failed_criterion_does_not_end_the_script(gsid, rec_csv, tmp_path):
    gsid("-C", "st", "open", rec_csv)
    gsid("-C", "st", "fit", "--order", "1/0", "--delay", "none")
    assert gsid("-C", "st", "compare", "--check").code == 1
    gsid("-C", "st", "script", "-o", "a.sh")
    repeated(Study("st"), "copy", ["sh", str(tmp_path / "a.sh")])


def test_a_failed_criterion_of_a_command_does_not_end_the_script_in_python(gsid, rec_csv, tmp_path):
    """Its subprocess was run with check=True."""
    lines = (tmp_path / rec_csv).read_text().splitlines()
    values = [line if line[0] == "#" else f"{line},{line.split(',')[1]}" for line in lines]
    (tmp_path / rec_csv).write_text("\n".join(values).replace("u,y,u\n", "u,y,r\n"))
    gsid("-C", "st", "open", rec_csv)
    gsid("-C", "st", "fit", "--order", "1/0", "--delay", "none")
    assert gsid("-C", "st", "compare", "--check", "--r", "r").code == 1  # --r: no function of the package
    gsid("-C", "st", "script", "-o", "a.py")
    assert "', exit_code=1)" in (tmp_path / "a.py").read_text()
    repeated(Study("st"), "copy", [sys.executable, str(tmp_path / "a.py")])


def test_a_line_break_does_not_end_a_comment(tmp_path):
    """What followed it in a word, a name or a digest was a line of the script."""
    evil = "\n    touch owned\nimport owned\n"
    step = Step(1, "look", ("look", evil), 0, outputs=(evil,))
    steps = [step, replace(step, number=2, exit_code=3), replace(step, number=3, verb="run")]
    study = SimpleNamespace(files={f"records/{evil}": f"1{evil}"}, steps=steps)
    (tmp_path / "gsid").write_text("#!/bin/sh\n")
    (tmp_path / "gsid").chmod(0o755)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["sh", "-c", shell_script(study)], env={"PATH": path}, check=True)
    assert not (tmp_path / "owned").exists()
    imports = [node for node in ast.walk(ast.parse(python_script(study))) if isinstance(node, ast.Import)]
    assert [name.name for node in imports for name in node.names] == ["gsid"]


def test_inputs_that_no_line_writes_are_listed_with_their_digest(gsid, rec_csv, tmp_path):
    """A model that the page changed is an output of its step; in Python no table of responses is made."""
    gsid("-C", "st", "open", rec_csv)
    gsid("-C", "st", "frf")
    study = Study("st")
    (study.folder / "models/2-edited-from-1-start.json").write_text("{}")
    words = [
        "fit",
        "records/rec.csv",
        "--model",
        "models/2-edited-from-1-start.json",
        "-o",
        "models/2-fit.json",
    ]
    (study.folder / "models/2-fit.json").write_text("{}")
    outputs = ["models/2-edited-from-1-start.json", "models/2-fit.json"]
    study.add_step(words, 0, outputs=outputs, number=2)
    words = ["compare", "responses/1-frf.csv", "--model", "models/2-fit.json"]
    study.add_step(words, 0, number=3)
    listed = {}
    for name in ("a.sh", "a.py"):
        gsid("-C", "st", "script", "-o", name)
        lines = [line.split() for line in (tmp_path / name).read_text().splitlines()]
        listed[name] = {words[2] for words in lines if len(words) == 3 and words[1] in study.files.values()}
    used = {"records/rec.csv", "models/2-edited-from-1-start.json"}
    assert listed == {"a.sh": used, "a.py": used | {"responses/1-frf.csv"}}


@pytest.mark.parametrize(
    ("words", "hint"), [(["script"], "give -C DIR"), (["-C", "st", "script", "-o", "a.txt"], ".py or .sh")]
)
def test_misuse_has_a_hint(gsid, words, hint):
    gsid("-C", "st", "open")
    result = gsid(*words)
    assert result.code == 2
    assert hint in result.err


def test_names_that_need_quotes(gsid, rec_csv, tmp_path):
    name = 'it\'s a "record" $HOME #1.csv'
    (tmp_path / name).write_bytes((tmp_path / rec_csv).read_bytes())
    gsid("-C", "st", "open", name)
    assert gsid("-C", "st", "fit", "--order", "2/0").code == 0
    for script, command in (("a.sh", "sh"), ("a.py", sys.executable)):
        gsid("-C", "st", "script", "-o", script)
        copy = repeated(Study("st"), f"copy {command[-2:]}", [command, str(tmp_path / script)])
        np.testing.assert_allclose(
            numbers_of(copy / "models/1-fit.json"), numbers_of("st/models/1-fit.json"), rtol=1e-9
        )
