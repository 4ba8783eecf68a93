"""gsid run --attended and --simulate: who ends the run, and what another program reads."""

import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gsid.records.files import read_record

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md
GSID = [sys.executable, "-m", "gsid.cli.main"]
EXCITE = ["--period", "600", "--band", "5:500", "--amplitude", "2", "--settle", "1p"]
DEADLINE_S = 60


@pytest.fixture
def attended(tmp_path):
    """A run of the paced simulated axis without end."""
    words = ["run", "--simulate", "--paced", *EXCITE, "--periods", "1000", "--attended", "-o", "rec.csv"]
    process = subprocess.Popen(
        [*GSID, *words], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    yield process
    process.kill()
    process.communicate()


def until_moving(process):
    """Give signs of life until the axis moves."""
    while True:
        line = process.stderr.readline()
        process.stdin.write(b".")
        process.stdin.flush()
        if line.startswith(b'{"live":') and json.loads(line)["live"]["good"] > 0:
            return


def ended(process):
    """Its last lines; `communicate` would lose those that `readline` has read ahead."""
    end = threading.Timer(DEADLINE_S, process.kill)
    end.start()
    text = process.stderr.read()
    assert process.wait() == 130
    end.cancel()
    return text.decode()


def test_without_signs_of_life_for_3_s_the_run_ends(attended, tmp_path):
    until_moving(attended)
    begin_s = time.monotonic()
    while attended.stderr.readline().startswith(b'{"live":'):
        pass
    print(f"{time.monotonic() - begin_s:.2f} s after the last sign of life")
    assert time.monotonic() - begin_s > 2.5
    assert "no sign of life for 3 s" in ended(attended)
    assert int(read_record(tmp_path / "rec.csv").meta["good_periods"]) > 5


def test_the_end_of_the_program_that_attends_ends_the_run(attended, tmp_path):
    until_moving(attended)
    attended.stdin.close()
    attended.stdin = None
    text = ended(attended)
    assert "the program that attended the run has ended" in text
    record = read_record(tmp_path / "rec.csv")
    assert record.meta["command_zero_confirmed"] == "yes"
    (written,) = (json.loads(line)["record"] for line in text.splitlines() if line.startswith('{"record":'))
    good, spoiled = (int(record.meta[name]) for name in ("good_periods", "spoiled_periods"))
    assert written == {"path": "rec.csv", "samples": len(record), "good": good, "spoiled": spoiled}


def test_a_reader_that_hangs_does_not_delay_the_axis(attended, tmp_path):
    """The figures of 2 s fill the pipe; nobody reads them."""
    until_moving(attended)
    end = time.monotonic() + 10
    while time.monotonic() < end:
        attended.stdin.write(b".")
        attended.stdin.flush()
        time.sleep(0.2)
    attended.send_signal(signal.SIGINT)
    ended(attended)
    record = read_record(tmp_path / "rec.csv")
    assert record.meta["command_zero_confirmed"] == "yes"
    assert len(record) > 20_000
    print("longest silence of the host", record.meta["longest_host_silence_s"], "s")


def test_the_simulated_axis_ends_with_the_run(attended):
    until_moving(attended)
    (axis,) = Path(f"/proc/{attended.pid}/task/{attended.pid}/children").read_text().split()
    attended.kill()
    end = time.monotonic() + DEADLINE_S
    while is_running(axis):
        assert time.monotonic() < end
        time.sleep(0.05)


def is_running(pid):
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ((), "give --port, --simulate or --recover: one of them"),
        (("--port", "x", "--simulate", ""), "give --port, --simulate or --recover: one of them"),
        (("--simulate", "--truth t.json"), "--simulate has no --truth"),
        (("--simulate", "--once"), "--simulate has no --once"),
        (("--simulate", "'"), "--simulate: No closing quotation"),
        (("--simulate", "--set fs_hz"), "--set fs_hz is not NAME=VALUE"),
        (("--simulate", "--nonsense"), "No such option"),
    ],
)
def test_options_that_do_not_fit_are_refused(gsid, words, text):
    result = gsid("run", *words)
    assert result.code == 2, result.err
    assert text in result.err


def test_a_lock_step_axis_with_an_effect_is_measured(gsid, tmp_path):
    words = ("--simulate", "--effect coulomb_friction --seed 3", *EXCITE, "--periods", "4")
    result = gsid("run", *words, "-o", str(tmp_path / "rec.csv"), "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["n_periods"] == 4
