"""gsid design: each kind of excitation, its limits and files."""

import json
from pathlib import Path

import numpy as np
import pytest

COMMON = ["--fs", 3000, "--band", "1:250"]
KINDS = {"multisine": 3000, "prbs": 4 * 751, "sweep": 3000, "stepped-sine": 300}
PLANT = {
    "gsid_model": 1,
    "fs_hz": 3000,
    "effects": [
        {"effect": "rigid_body", "params": {"gain": 7}},
        {"effect": "viscous_friction", "params": {"rate": 10}},
    ],
}


@pytest.fixture
def axis_json(tmp_path):
    (tmp_path / "axis.json").write_text(json.dumps(PLANT))
    return "axis.json"


def band(kind):
    return ["--fs", 3000, "--band", "10:250"] if kind == "stepped-sine" else COMMON


@pytest.mark.parametrize("kind", KINDS)
def test_keys_limits_and_files(gsid, axis_json, tmp_path, kind):
    limits = ["--limit-command", 179, "--limit-travel-deg", 0.5, "--limit-slew", 2e5, "--model", axis_json]
    result = gsid("design", kind, *band(kind), "--period", KINDS[kind], *limits, "-o", "u.npz", "--json")
    assert result.code == 0, result.err
    figures = json.loads(result.out)
    keys = {"crest_factor", "crest_factor_fine", "p_int_over_p_tot", "period_samples", "n_lines", "peak"}
    assert keys | {"travel_deg", "rms", "slew"} <= figures.keys()
    used = [figures["peak"] / 179, figures["travel_deg"] / 0.5, figures["slew"] / 2e5]
    assert max(used) == pytest.approx(1, rel=1e-3)
    u = np.load(tmp_path / "u.npz")["u"]
    assert len(u) == figures["period_samples"]
    assert np.abs(u).max() == pytest.approx(figures["peak"])


@pytest.mark.parametrize("end", [".csv", ".mat", ".h"])
def test_other_files(gsid, tmp_path, end):
    result = gsid("design", "prbs", *COMMON, "--period", KINDS["prbs"], "-o", f"u{end}")
    assert result.code == 0, result.err
    assert (tmp_path / f"u{end}").stat().st_size > 1000


def test_optimised_phases(gsid, axis_json):
    asked = ["design", "multisine", *COMMON, "--period", 3000, "--optimise", "--json"]
    plain = json.loads(gsid(*asked).out)
    assert plain["crest_factor_fine"] < 1.45
    limited = json.loads(
        gsid(*asked, "--limit-command", 50, "--limit-travel-deg", 2, "--model", axis_json).out
    )
    assert limited["peak"] <= 50.001
    assert limited["travel_deg"] <= 2.001
    at_peak = json.loads(gsid(*asked, "--peak", 7).out)
    assert at_peak["peak"] == pytest.approx(7)


def test_an_axis_that_friction_holds_and_nothing_brings_back(gsid, axis_json):
    """Bug: ZeroDivisionError where friction holds it at amplitude 1, and nothing was said of its drift."""
    friction = {"effect": "coulomb_friction", "params": {"level": 2000}}
    Path(axis_json).write_text(json.dumps(PLANT | {"effects": [*PLANT["effects"], friction]}))
    asked = ["design", "multisine", *COMMON, "--period", 3000, "--limit-travel-deg", 0.5]
    result = gsid(*asked, "--model", axis_json, "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["travel_deg"] == pytest.approx(0.5, rel=1e-3)
    assert result.err.count("drifts by") == 1


def test_misuse(gsid, axis_json):
    asked = ["design", "multisine", *COMMON, "--period", 3000]
    for more, words in (
        (["--limit-travel-deg", 2], "--limit-travel-deg needs --model"),
        (["--limit-command", 5, "--peak", 3], "limits set the amplitude"),
        (["--limit-command", -5], "is not in the range x>0"),
        (["--optimise", "--peak", -3], "peak must be a positive number"),  # was taken, and turned round
        (["--optimise", "--peak", 3, "--amplitude", 2], "give one of"),
    ):
        result = gsid(*asked, *more)
        assert result.code == 2
        assert words in result.err
    loop = {"effect": "position_velocity_loop", "params": {"kp": 20, "kv": 1}}
    body = {"effect": "rigid_body", "params": {"gain": 7}}
    Path("loop.json").write_text(json.dumps({"gsid_model": 1, "fs_hz": 1000, "effects": [loop, body]}))
    result = gsid(*asked, "--model", "loop.json")
    assert result.code == 2
    assert "controller runs at 1000 Hz" in result.err
    nearest = gsid("design", "prbs", *COMMON, "--period", 3000)
    assert nearest.code == 2
    assert "the nearest valid request is" in nearest.err


def test_budget(gsid, rec_csv):
    plan = json.loads(gsid("design", "budget", rec_csv, "--sigma", 0.001, "--json").out)
    assert plan["n_periods"] > 6
    assert plan["time_s"] == pytest.approx(plan["n_periods"] * 0.4)
    assert gsid("design", "budget", rec_csv, "--sigma", 3).code == 2


def test_signals_of_the_thesis_as_it_names_them(gsid):
    """Sections 3.5 and 3.7: an offset of 0.2793 rad, and a cosine at 45 degrees, without its mean."""
    band = ("--fs", "3000", "--period", "6000", "--band", "0.5:250")
    offset = json.loads(gsid("design", "multisine", *band, "--offset-phase", "0.2793", "--json").out)
    assert offset["crest_factor"] == pytest.approx(1.734, abs=0.0005)
    sweep = ("design", "sweep", *band, "--kind", "log", "--phase-deg", "45", "--phase-of", "cosine", "--jump")
    values = json.loads(gsid(*sweep, "--no-mean", "--json").out)
    assert values["crest_factor"] == pytest.approx(1.51, abs=0.005)
    assert values["mean"] == pytest.approx(0, abs=1e-12)
    assert abs(json.loads(gsid(*sweep, "--json").out)["mean"]) > 0.01


def test_a_transient_is_written_run_and_checked_against_the_limits(gsid):
    band = ("--fs", "3000", "--period", "6000", "--band", "1:100")
    doublets = ("design", "transient", *band, "--kind", "3-2-1-1")
    made = gsid(*doublets, "--limit-command", "20", "-o", "u.csv", "--json")
    assert made.code == 0, made.err
    assert json.loads(made.out)["peak"] == pytest.approx(20)
    run = ("run", "--simulate", "", "--u", "u.csv", "--periods", "2")
    refused = gsid(*run, "--limit-command", "19")
    assert (refused.code, "the planned command exceeds its limit" in refused.err) == (3, True)
    assert gsid(*run, "--limit-command", "20.1", "-o", "rec.csv").code == 0  # the drive rounds up
    assert gsid(*run, "--offset-phase", "1").code == 2  # of a multisine
    stopped = gsid(*run, "--limit-travel-deg", "0.01", "-o", "stopped.csv")
    assert (stopped.code, "the axis exceeds a limit" in stopped.err) == (3, True)


def test_the_course_of_the_search_is_drawn(gsid, tmp_path):
    band = ("--fs", "1000", "--period", "500", "--band", "2:100", "--phases", "random")
    assert gsid("design", "multisine", *band, "--optimise", "--plot-search", "s.png").code == 0
    assert (tmp_path / "s.png").stat().st_size > 5000
    assert gsid("design", "multisine", *band, "--plot-search", "s.png").code == 2
    assert gsid("design", "multisine", *band, "--optimise", "--plot-search", "s.txt").code == 2


def test_a_seed_of_a_pulse_is_refused(gsid):
    pulse = ("design", "transient", "--fs", 1000, "--period", 1000, "--band", "2:100", "--kind", "pulse")
    assert gsid(*pulse).code == 0
    assert gsid(*pulse, "--seed", 4).code == 2
