"""Ctrl-C during `gsid diagnose`: a real SIGINT to a process of its own, in each stage.

Before the first draft there is no result and the command says so. After it, the best so far is printed.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gsid.excitation.multisine import Multisine
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis

SEED, FS_HZ, N, PERIODS = 20261124, 3000.0, 6000, 8
PATIENCE_S = 120  # of a busy computer, until a step begins
ENDS_WITHIN_S = 20  # the result itself needs the missing torque, and for --json nothing more


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two records of an axis with dry friction."""
    place = tmp_path_factory.mktemp("interrupted")
    print("seed", SEED)
    for i in range(2):
        u = Multisine.design(FS_HZ, N, (0.5, 195), grid="odd", phases="random", seed=SEED + i, amplitude=5.0)
        u, y, _ = SimulatedAxis(coulomb_level=2.0, seed=SEED + i).step(np.tile(u.table(), 2 + PERIODS))
        write_record(place / f"r{i}.npz", Record(u, y, FS_HZ, N, 2 * N, hold="zoh", y_unit="deg/s"))
    return place


def interrupted(folder, step, *options):
    """Exit code, output and messages of a diagnosis that gets SIGINT when a step begins."""
    words = [sys.executable, "-m", "gsid.cli.main", "diagnose", "r0.npz", "r1.npz", *options]
    process = subprocess.Popen(
        words,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    lines, begin = [], time.monotonic()
    for line in process.stderr:
        lines.append(line)
        if step in line:
            break
        assert time.monotonic() < begin + PATIENCE_S, "".join(lines)
    else:
        raise AssertionError(f"no step {step}: {''.join(lines)}")
    time.sleep(0.2)  # within the step, not before it
    process.send_signal(signal.SIGINT)
    sent = time.monotonic()
    out, rest = process.communicate(timeout=PATIENCE_S)
    assert time.monotonic() < sent + ENDS_WITHIN_S
    err = "".join(lines) + rest
    assert "Traceback" not in err
    return process.returncode, out, err


@pytest.mark.parametrize("step", ["transforming the records", "finding the linear structure"])
def test_before_the_first_draft_the_command_stops_without_a_result(folder, step):
    code, out, err = interrupted(folder, step, "-o", "early.json")
    assert (code, out) == (130, "")
    assert err.splitlines()[-1] == "stopped"
    assert not (folder / "early.json").exists()


@pytest.mark.parametrize(
    "step", ["fitting the linear part by simulation", "fitting coulomb_friction by simulation"]
)
def test_after_the_first_draft_the_best_so_far_is_printed(folder, step):
    code, out, _ = interrupted(folder, step)
    assert code == 130
    assert "coulomb_friction" in out.splitlines()[0]
    assert "The diagnosis was interrupted: this is the state it had reached." in out


def test_an_interruption_of_the_last_fits_keeps_the_law_that_was_fitted(folder):
    code, out, err = interrupted(folder, "fitting stribeck_friction by simulation", "--json", "-o", "m.json")
    found = json.loads(out)
    assert code == 130
    assert found["interrupted"]
    assert found["effects"] == ["coulomb_friction"]
    assert found["ranking"][0]["confirmed"]
    assert "wrote m.json" in err
    effects = json.loads(Path(folder, "m.json").read_text())["effects"]
    assert "coulomb_friction" in [one["effect"] for one in effects]
