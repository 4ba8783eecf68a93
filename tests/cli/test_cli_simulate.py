"""gsid simulate --effect: what is refused before a line is opened."""

import os
import select
import subprocess
import sys

import numpy as np
import pytest

from gsid.effects.types import catalogue
from gsid.records.files import read_record
from gsid.rig.axis import HIDDEN


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--effect", "cubic_sprint"), 3, "did you mean cubic_spring?"),
        (("--effect", "gear_backlash"), 3, "it has drive_dead_zone"),
        (("--effect", "coulomb_friction", "--param", "levle=1"), 3, "did you mean level?"),
        (("--effect", "coulomb_friction", "--param", "level=-1"), 2, "out of its range"),
        (("--effect", "coulomb_friction", "--param", "level"), 2, "is not NAME=VALUE"),
        (("--param", "level=1"), 2, "--param needs --effect"),
        (("--stops", "5:50"), 2, "with 0 between the ends"),
        (("--stops", "-5"), 2, "with 0 between the ends"),
        (("--stops", ":nan"), 2, "with 0 between the ends"),
        (("--gyro", "sometimes"), 2, "is not one of"),
        (("--torque-noise", "1", "--set", "torque_noise_hz=0"), 2, "out of its range"),
    ],
)
def test_an_effect_that_cannot_be_hidden_is_refused(gsid, arguments, code, words):
    result = gsid("simulate", *arguments)
    assert (result.code, words in result.err, result.out) == (code, True, ""), result.err
    assert "hint:" in result.err


def test_an_effect_without_a_law_of_the_axis_is_not_simulated(gsid):
    """A new effect is a file in src/effects; the axis, which tests it, gets its law separately or refuses."""
    without = [effect for effect in catalogue() if effect not in HIDDEN]
    assert "quadratic_drag" not in without
    for effect in without:
        result = gsid("simulate", "--effect", effect)
        assert result.code == 3, effect
        assert "does not have this effect" in result.err
        assert "hint: it has drive_dead_zone" in result.err


def refreshes(gsid, options, name):
    """Samples at which the output changes, with next to no command."""
    result = gsid(
        "run",
        "--simulate",
        f"{options} --set command_bits=0",
        "--amplitude",
        "1e-3",
        "--periods",
        "5",
        "-o",
        name,
    )
    assert result.code == 0, result.err
    return np.flatnonzero(np.diff(read_record(name).y)) + 1


def test_a_locked_gyro_repeats_with_the_ticks_and_a_free_running_one_does_not(gsid):
    """At 400 Hz every second refresh is 15 ticks after the one before it; at 400.02 Hz 14.99925 ticks: one
    of 14 ticks 0.15 times a second."""
    locked = refreshes(gsid, "--gyro locked", "locked.csv")
    assert set(np.diff(locked[::2])) == {15}
    free = refreshes(gsid, "--gyro free-running --seed 3", "free.csv")
    seconds = (free[-1] - free[0]) / 3000
    assert abs((len(free) - 1) / seconds - 400.02) < 1 / seconds
    assert set(np.diff(free[::2])) == {14, 15}
    early = np.count_nonzero(np.diff(free[::2]) == 14)
    assert abs(early - 0.02 / 400 * 3000 * seconds) <= 1
    other = refreshes(gsid, "--gyro free-running --seed 4", "other.csv")
    assert free[0] != other[0]


def test_a_stop_keeps_the_axis_on_its_side(gsid):
    """A slow sine moves the axis by more than 1.5 deg; a stop at +0.5 deg leaves the other side free."""
    options = "--linear --noise-scale 0 --set spring_stiffness=0 --set viscous_rate=20"
    design = ("--band", "0.9:1.1", "--amplitude", "60", "--periods", "3")
    travel = {}
    for name, stops in (("free", ""), ("stopped", " --stops :0.5")):
        result = gsid("run", "--simulate", options + stops, *design, "-o", f"{name}.csv")
        assert result.code == 0, result.err
        travel[name] = np.cumsum(read_record(f"{name}.csv").y) / 3000
    assert travel["free"].max() > 1.5
    assert travel["stopped"].max() < 0.7
    assert travel["stopped"].min() < travel["free"].min()


def test_torque_noise_is_seen_at_the_gyro(gsid):
    common = "--noise-scale 0 --set spring_stiffness=0 --linear"
    for name, noise in (("quiet", "0"), ("noisy", "20")):
        options = f"{common} --torque-noise {noise}"
        gsid("run", "--simulate", options, "--amplitude", "1e-3", "--periods", "5", "-o", f"{name}.csv")
    assert np.std(read_record("quiet.csv").y) < 1e-3 < 0.1 < np.std(read_record("noisy.csv").y)


def test_bug_in_a_bare_environment_the_port_was_printed_at_the_end_only(tmp_path):
    """`gsid demo` waited for the port for ever where the standard output is a pipe that nobody flushes."""
    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    command = [sys.executable, "-m", "gsid.cli.main", "simulate", "--once"]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as axis:
        ready, _, _ = select.select([axis.stdout], [], [], 30)
        axis.terminate()
    assert ready
