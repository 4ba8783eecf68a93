"""Steps and messages as JSON lines, for a program that reads stderr."""

import json
import subprocess
import sys

import pytest

from gsid.base.deadline import Deadline
from gsid.base.progress import ProgressText
from gsid.diagnosis.from_records.steps import Steps

GSID = [sys.executable, "-m", "gsid.cli.main"]


@pytest.fixture(autouse=True)
def lines(monkeypatch):
    monkeypatch.setenv("GSID_PROGRESS", "json")


def parsed(text):
    return [json.loads(line) for line in text.splitlines()]


def test_every_line_is_an_object(gsid, rec_csv):
    result = gsid("fit", rec_csv, "--order", "2/0", "-o", "m.json")
    assert result.code == 0
    found = parsed(result.err)
    assert {"step": None, "words": "fitting 2/0 to rec.csv", "seconds_left": None} in found
    assert {"message": "wrote m.json"} in found
    assert all(set(one) in ({"message"}, {"step", "words", "seconds_left"}) for one in found)
    assert result.out.startswith("ml fit")


def test_an_added_effect_reports_its_steps(gsid, rec_csv):
    assert gsid("start", rec_csv, "-o", "m.json").code == 0
    words = ["add", "viscous_friction", rec_csv, "--model", "m.json", "-o", "m2.json"]
    steps = [one["words"] for one in parsed(gsid(*words).err) if "words" in one]
    assert steps[0] == "fitting the given model"


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(["look", "none.csv"], 3), (["look"], 2), (["nonsense"], 2), ([], 2), (["fit", "a", "--x"], 2)],
)
def test_errors_are_lines_too(gsid, arguments, code):
    result = gsid(*arguments)
    assert result.code == code
    assert all("message" in one for one in parsed(result.err))


def test_names_with_control_codes_are_one_line(gsid, rec_csv, tmp_path):
    (tmp_path / "a\nb\x1b[2J.csv").write_bytes((tmp_path / rec_csv).read_bytes())
    result = gsid("frf", "a\nb\x1b[2J.csv")
    assert result.code == 0
    assert "\x1b" not in result.err
    assert any("a\\nb" in one["message"] for one in parsed(result.err))


def test_steps_of_a_run_have_their_number_and_the_time_left(tmp_path):
    axis = subprocess.Popen(
        [*GSID, "simulate", "--once"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=tmp_path,
    )
    try:
        port = axis.stdout.readline().strip()
        excite = ["--period", "600", "--band", "10:600", "--periods", "4", "--settle", "1p"]
        run = subprocess.run(
            [*GSID, "run", "--port", port, *excite, "-o", "rec.csv"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
        )
        axis.wait(timeout=60)
    finally:
        axis.kill()
        axis.communicate()
    assert run.returncode == 0, run.stderr
    steps = [one for one in parsed(run.stderr) if "words" in one]
    assert [one["step"] for one in steps] == [f"{n}/4" for n in range(5)]
    assert steps[-1]["words"] == "4 good periods, 0 lost"
    left = [one["seconds_left"] for one in steps]
    assert left == sorted(left, reverse=True)
    assert left[0] <= 5 * 600 / 3000  # settling and four periods
    assert left[-1] == pytest.approx(0, abs=600 / 3000)


def test_a_value_that_is_not_known_is_an_error(gsid, rec_csv, monkeypatch):
    monkeypatch.setenv("GSID_PROGRESS", "xml")
    result = gsid("look", rec_csv)
    assert result.code == 2
    assert "GSID_PROGRESS is xml" in result.err


def test_steps_of_a_diagnosis_keep_their_parts():
    steps = []
    report = Steps(steps.append, Deadline(52.4))
    report("scanning the laws")
    (step,) = steps
    assert isinstance(step, ProgressText)
    assert (step.words, step.part) == ("scanning the laws", "1/8")
    assert step.seconds_left == pytest.approx(52.4, abs=1)
    assert step == f"[1/8] scanning the laws, {step.seconds_left:.0f} s left"
