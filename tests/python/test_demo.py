"""The demo runs whole, over a real pseudo-terminal, and must show what it claims."""

import json
import subprocess
import sys

import numpy as np
import pytest

from gsid.demo import beside_truth, mode_pole
from gsid.model import RationalModel


def test_demo_shows_what_it_claims(tmp_path):
    command = [
        sys.executable,
        "-m",
        "gsid.cli.main",
        "demo",
        "--folder",
        str(tmp_path),
        "--json",
        "--seed",
        "11",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["passed"]
    assert all(result["checks"].values())
    assert result["linear"]["adequate"]
    assert not result["friction"]["adequate"]
    for name in ("report.html", "linear.csv", "friction.csv", "linear_model.json", "friction_model.json"):
        assert (tmp_path / name).stat().st_size > 0


def test_a_wrong_model_stands_out_beside_the_truth():
    truth = {"num": [2.0, 0.0], "den": [1.0, 3.0, 900.0], "delay_s": 0.005, "parameters": {"mode_f_hz": 4.7}}
    cov = np.diag([0.01, 1.0, 0.01, 0.01, 1e-10])
    model = RationalModel([2.5, 0.0], [1.0, 3.0, 900.0], 0.005, cov=cov, free_delay=True)
    rows = {row.name: row for row in beside_truth(model, truth)}
    assert rows["num, s¹"].n_sigma == pytest.approx(5)
    assert rows["delay"].n_sigma == pytest.approx(0)
    assert rows["mode"].estimate == pytest.approx(30 / (2 * np.pi))


def test_a_model_without_complex_poles_has_no_mode():
    with pytest.raises(ValueError, match="complex"):
        mode_pole(np.array([-1.0, -2.0]), 179.0)
