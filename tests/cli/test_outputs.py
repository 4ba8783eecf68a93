"""What an output may replace: nothing that the command reads, and nothing but a regular file."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.records.files import write_record

COMMAND = Path(sys.executable).parent / "gsid"


@pytest.fixture
def files(rec_csv):
    """rec.csv, a stack of effects m.json, a transfer function tf.json; and what each file holds."""
    effects = [{"effect": "rigid_body", "params": {"gain": 7.4}}]
    PlantModel.from_dict({"gsid_model": 1, "fs_hz": 1000, "effects": effects}).save("m.json")
    RationalModel([7.4], [1, 11], 0.0051, fs_hz=1000, hold="zoh").save("tf.json")
    Path("meta.json").write_text('{"files": ["rec.csv"], "fs_hz": 1000}')
    Path("soft.csv").symlink_to("rec.csv")
    os.link("rec.csv", "hard.csv")
    return {path: path.read_bytes() for path in Path().iterdir()}


OVER_AN_INPUT = {
    "frf": ["frf", "rec.csv", "-o", "rec.csv"],
    "frf_output_first": ["frf", "-o", "rec.csv", "rec.csv"],
    "frf_by_a_link": ["frf", "rec.csv", "-o", "soft.csv"],
    "frf_of_a_link": ["frf", "soft.csv", "-o", "rec.csv"],
    "frf_by_a_hard_link": ["frf", "rec.csv", "-o", "hard.csv"],
    "frf_by_a_path": ["frf", "rec.csv", "-o", "../{here}/rec.csv"],
    "frf_second_record": ["frf", "hard.csv", "rec.csv", "-o", "rec.csv"],
    "fit": ["fit", "rec.csv", "--order", "1/0", "-o", "rec.csv"],
    "fit_held_out": ["fit", "rec.csv", "--order", "1/0", "--held-out", "m.json", "-o", "m.json"],
    "fit_model": ["fit", "--model", "m.json", "rec.csv", "-o", "m.json"],
    "fit_plot": ["fit", "rec.csv", "--order", "1/0", "--plot", "rec.csv"],
    "fit_keys_beside": ["fit", "rec.csv", "--order", "1/0", "-o", "meta.json"],
    "report": ["report", "rec.csv", "-o", "rec.csv"],
    "report_model": ["report", "rec.csv", "--model", "tf.json", "-o", "tf.json"],
    "compare_plot": ["compare", "rec.csv", "--model", "tf.json", "--plot", "tf.json"],
    "frf_plot": ["frf", "rec.csv", "--plot", "rec.csv"],
    "distortion_plot": ["distortion", "rec.csv", "--plot", "rec.csv"],
    "noise_plot": ["noise", "rec.csv", "--plot", "rec.csv"],
    "diagnose": ["diagnose", "--model", "m.json", "rec.csv", "-o", "m.json"],
    "diagnose_curve": ["diagnose", "--model", "m.json", "rec.csv", "--curve", "rec.csv"],
    "add": ["add", "coulomb_friction", "--model", "m.json", "rec.csv", "-o", "m.json"],
    "add_undo": ["add", "--undo", "--model", "m.json", "-o", "m.json"],
    "add_held_out": ["add", "torque_bias", "--model", "m.json", "hard.csv", "--held-out", "rec.csv",
                     "-o", "rec.csv"],
    "add_table": ["add", "--table", "tf.json", "--model", "m.json", "rec.csv", "-o", "tf.json"],
    "design_model": ["design", "multisine", "--fs", "1000", "--period", "400", "--band", "5:90",
                     "--model", "tf.json", "-o", "tf.json"],
    "run_u": ["run", "--port", "none", "--u", "rec.csv", "-o", "rec.csv"],
    "export": ["export-c", "tf.json", "-o", "tf.json"],
    "library": ["--library", "tf.json:f", "export-c", "tf.json", "-o", "tf.json"],
}  # fmt: skip


@pytest.mark.parametrize("case", OVER_AN_INPUT)
def test_an_input_is_not_replaced(gsid, files, case):
    """Bug: `gsid frf rec.csv -o rec.csv` replaced the measurement."""
    arguments = [word.format(here=Path.cwd().name) for word in OVER_AN_INPUT[case]]
    result = gsid(*arguments)
    assert {path: path.read_bytes() for path in Path().iterdir()} == files
    if case == "library":
        assert result.code != 0  # tf.json is no library
        return
    assert result.code == 3, result.err
    assert "replace an input" in result.err
    assert "hint: give the output another name, for example" in result.err
    assert result.out == ""


def test_the_hint_names_another_model(gsid, files):
    result = gsid("add", "coulomb_friction", "--model", "m.json", "rec.csv", "-o", "m.json")
    assert "m2.json" in result.err


@pytest.mark.parametrize("model", ["rig.h", "rig.c", "rig"])
def test_the_header_does_not_replace_the_model(gsid, model):
    """Bug: `export-c rig.h` and `export-c rig.c` wrote C over the model."""
    RationalModel([7.4], [1, 11], 0.0051, fs_hz=1000, hold="zoh").save(model)
    before = Path(model).read_bytes()
    result = gsid("export-c", model, "-o", "rig.c")
    assert Path(model).read_bytes() == before
    assert result.code == (0 if model == "rig" else 3)
    assert gsid("export-c", model).code == (0 if model == "rig" else 3)
    assert Path(model).read_bytes() == before


def test_a_source_is_not_replaced_by_its_header(gsid, files):
    result = gsid("export-c", "tf.json", "-o", "x.h")
    assert result.code == 2
    assert "-o names the C file" in result.err
    assert not Path("x.h").exists()


@pytest.mark.parametrize("names", [["x.csv", "x.csv"], ["x.csv", "./x.csv"], ["hard.csv", "soft.csv"]])
def test_two_outputs_are_two_files(gsid, files, names):
    arguments = ["diagnose", "--model", "m.json", "x_rec.csv", "-o", names[0], "--curve", names[1]]
    result = gsid(*arguments)
    assert (result.code, "two outputs" in result.err) == (3, True)
    assert {path: path.read_bytes() for path in Path().iterdir()} == files


@pytest.mark.parametrize("verb", ["frf", "fit", "report", "design", "export-c", "truth", "plot"])
def test_a_device_is_not_replaced(gsid, files, verb):
    """Bug: as root `-o /dev/null` was replaced by a file."""
    os.mkfifo("pipe.png")
    arguments = {
        "frf": ["frf", "rec.csv", "-o"],
        "fit": ["fit", "rec.csv", "--order", "1/0", "-o"],
        "report": ["report", "rec.csv", "-o"],
        "design": ["design", "multisine", "--fs", "1000", "--period", "400", "--band", "5:90", "-o"],
        "export-c": ["export-c", "tf.json", "-o"],
        "truth": ["simulate", "--truth"],
        "plot": ["compare", "rec.csv", "--model", "tf.json", "--plot"],
    }[verb]
    for name in ("/dev/null", "pipe.png", "."):
        result = gsid(*arguments, name)
        assert result.code == 3
        assert "not a regular file" in result.err
    assert Path("/dev/null").is_char_device()
    assert Path("pipe.png").is_fifo()


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("frf.csv", ["frf", "rec.csv", "-o"]),
        ("fit.json", ["fit", "rec.csv", "--order", "1/0", "-o"]),
        ("u.csv", ["design", "multisine", "--fs", "1000", "--period", "400", "--band", "5:90", "-o"]),
    ],
)
def test_stdout_is_the_file_and_nothing_else(files, name, arguments):
    """`-o -` gives on stdout what `-o FILE` writes; the table that stands there else goes to stderr."""
    run = {"capture_output": True, "text": True, "timeout": 120, "check": True}
    written = subprocess.run([COMMAND, *arguments, name], **run)
    streamed = subprocess.run([COMMAND, *arguments, "-"], **run)
    assert streamed.stdout == Path(name).read_text()
    assert written.stdout in streamed.stderr
    assert set(Path().iterdir()) == {*files, Path(name)}


def test_stdout_takes_a_report(files):
    streamed = subprocess.run(
        [COMMAND, "report", "rec.csv", "-o", "-"], capture_output=True, text=True, timeout=120
    )
    assert streamed.stdout.startswith("<!DOCTYPE html>")
    assert streamed.stdout.endswith("</html>")
    assert set(Path().iterdir()) == files.keys()


@pytest.mark.parametrize(
    "arguments",
    [
        ["frf", "rec.csv", "-o", "-", "--json"],
        ["frf", "rec.csv", "--json", "-o", "-"],
        ["diagnose", "--model", "m.json", "rec.csv", "-o", "-", "--curve", "-"],
        ["export-c", "tf.json", "-o", "-"],
        ["compare", "rec.csv", "--model", "tf.json", "--plot", "-"],
        ["simulate", "--truth", "-"],
    ],
)
def test_stdout_takes_one_text(gsid, files, arguments):
    result = gsid(*arguments)
    assert (result.code, result.out) == (2, "")
    assert "standard output" in result.err
    assert {path: path.read_bytes() for path in Path().iterdir()} == files


def test_a_link_to_the_newest_result_stays_a_link(gsid, files, record):
    """Bug: a link was replaced by a file, and what it led to stayed old."""
    write_record("kept.csv", record)
    Path("latest.csv").symlink_to("kept.csv")
    assert gsid("frf", "rec.csv", "-o", "latest.csv").code == 0
    assert Path("latest.csv").is_symlink()
    assert "var_g" in Path("kept.csv").read_text()


@pytest.mark.skipif(not Path("/dev/stdout").exists(), reason="the system does not name its streams")
@pytest.mark.parametrize("name", ["out.csv", "/dev/stdout", "/dev/fd/1"])
def test_a_file_that_takes_the_table_is_not_replaced(files, name):
    """Bug: with `-o out.csv > out.csv` one of the two was lost, and nothing said so."""
    with open("out.csv", "w") as out:
        command = [COMMAND, "frf", "rec.csv", "-o", name]
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == 3
    assert "prints to the same file" in done.stderr


def test_the_trial_of_an_output_follows_no_link(gsid, files):
    """Bug: `gsid run` tried its output as .REC.probe.csv, and a link of that name led it to another file."""
    Path("kept.csv").write_text("kept")
    Path(".rig.probe.csv").symlink_to("kept.csv")
    gsid("run", "--port", "none", "-o", "rig.csv")
    assert Path("kept.csv").read_text() == "kept"
    assert Path(".rig.probe.csv").is_symlink()


def test_a_picture_is_written_as_every_output(gsid, files):
    """Bug: --plot wrote over what was there, in place: half a picture when the disk was full."""
    Path("tf.png").write_text("old")
    Path("tf.png").chmod(0o600)
    before = Path("tf.png").stat().st_ino
    assert gsid("compare", "rec.csv", "--model", "tf.json", "--plot", "tf.png").code == 0
    after = Path("tf.png").stat()
    assert (after.st_ino != before, after.st_mode & 0o777) == (True, 0o600)
    assert Path("tf.png").read_bytes().startswith(b"\x89PNG")
    for name in ("tf.SVG", "tf.pdf"):
        assert gsid("compare", "rec.csv", "--model", "tf.json", "--plot", name).code == 0
        assert Path(name).stat().st_size > 1000


def test_json_stays_on_stdout_beside_a_file(gsid, files):
    result = gsid("frf", "rec.csv", "-o", "frf.npz", "--json")
    assert json.loads(result.out)["n_periods"] == 6
