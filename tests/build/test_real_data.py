"""docs/how-to/real_data.md on the measured records: its commands print its text, and the answers are right.

Blocks marked `console` run here; those marked `shell-session` take minutes and run by `make test-data`.
"""

import json
import os
import re
import shlex
import sys

import numpy as np
import pytest
from pages import assert_same_text, commands

from measured import DATA

SLOW = os.environ.get("GSID_SLOW_DATA") == "1"


@pytest.fixture
def page(run, root, tmp_path):
    """Run a section's commands in a folder of its own: `page("EMPS")`; gives that folder."""
    if not DATA.is_dir():
        pytest.skip(f"the measured records are not in {DATA}: set GSID_DATA")
    folder = tmp_path / "clone"
    folder.mkdir()
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared/data").symlink_to(DATA)

    def follow(title, language="console"):
        text = (root / "docs/how-to/real_data.md").read_text()
        (section,) = re.findall(rf"^## {title}.*?(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)
        for name, body in re.findall(
            r"`(\w+\.\w+)`:\n\n```(?:json|python)\n(.*?)^```$", section, re.DOTALL | re.MULTILINE
        ):
            (folder / name).write_text(body)
        programs = {"gsid": [sys.executable, "-m", "gsid.cli.main"], "python": [sys.executable]}
        for block in re.findall(rf"^```{language}\n(.*?)^```$", section, re.DOTALL | re.MULTILINE):
            for command, shown in commands(block):
                program, *arguments = shlex.split(command)
                result = run(*programs[program], *arguments, cwd=folder)
                assert result.returncode == 0, f"{command}\n{result.stderr}"
                assert_same_text(result.stdout, shown)
        return folder

    return follow


needs_time = pytest.mark.skipif(not SLOW, reason="takes minutes: make test-data")


def parameters(path):
    effects = json.loads(path.read_text())["effects"]
    return {e["effect"]: {name: p["value"] for name, p in e["params"].items()} for e in effects}


@pytest.mark.long
def test_silverbox_has_a_hardening_spring(page):
    """Below 1.2 % of the output on the section kept out, sample by sample, with its numbers written anew."""
    folder = page("Silverbox")
    found = parameters(folder / "silverbox.json")
    assert found["cubic_spring"]["stiffness"] > 0
    assert "flexible_mode" not in found
    from gsid.models.load import load_model
    from gsid.records.files import read_record
    from gsid.spectrum.realisation import spectra

    record = read_record(folder / "silverbox_new.npz", settle=2048)
    measured = record.y[2048:].reshape(-1, 1024)
    for name in (
        "silverbox.json",
        "equal.json",
    ):  # fitted up to 165 Hz by noise, up to 200 Hz with equal weights
        error = measured - load_model(folder / name).predict(spectra(record)).y
        assert error.std() < 0.012 * measured.std(), name


@pytest.mark.long
def test_emps_has_the_published_friction(page):
    """Within 2 % of the benchmark's published values."""
    found = parameters(page("EMPS") / "emps_fitted.json")
    mass = 35.15065188 / found["rigid_body"]["gain"]
    assert mass == pytest.approx(95.1089, rel=0.02)
    assert mass * found["viscous_friction"]["rate"] == pytest.approx(203.5034, rel=0.02)
    assert mass * found["coulomb_friction"]["level"] == pytest.approx(20.3935, rel=0.02)
    assert mass * found["torque_bias"]["level"] == pytest.approx(-3.1648, rel=0.02)


def test_the_bench_pulls_its_shaft_back(page):
    """The error falls on the periods kept out, and on the other record."""
    rungs = json.loads((page("Motor bench") / "bench_spring.json").read_text())["history"]
    held_out = rungs[-1]["rung"]["held_out"]
    assert held_out["after"] < 0.75 * held_out["before"]


def test_distortion_is_what_a_linear_model_leaves(page):
    """The mirror's distortion foretells the error of its best linear approximation on a new realisation."""
    folder = page("Distortion")
    whole = np.load(folder.parent / "shared/data/fsm_cubespec/200mV.npz")
    line = np.arange(1, 3840)

    def lines(name):  # (realisation of three experiments, line, channel, experiment), mean over the periods
        mean = whole[name].mean(axis=3, dtype=float)
        matrices = np.fft.rfft(mean, axis=0)[line].reshape(len(line), 3, -1, 3)
        return np.moveaxis(matrices, 2, 0)

    bla = np.mean(lines("y_train") @ np.linalg.inv(lines("u_train")), axis=0)
    measured = lines("y_test")[0]
    error = measured - bla @ lines("u_test")[0]
    share = np.sqrt(np.sum(np.abs(error) ** 2, axis=(0, 2)) / np.sum(np.abs(measured) ** 2, axis=(0, 2)))
    # the mean of two realisations scatters itself: by half of the power of one
    np.testing.assert_allclose(share, np.array([0.0338, 0.0387, 0.0348]) * np.sqrt(1.5), rtol=0.1)


@needs_time
def test_what_emps_misses_at_60_hz(page):
    page("EMPS", "shell-session")


@needs_time
def test_what_the_bench_misses(page):
    page("Motor bench", "shell-session")


@needs_time
def test_bouc_wen_is_named_with_its_parameters(page):
    """From rough values; only noise is left, also on the validation record."""
    page("Bouc-Wen", "shell-session")


PUBLISHED_MIRROR = np.array([0.0389, 0.0587, 0.0421])  # 28 states, at 300 mV


def mirror_error(folder, name):
    import gsid
    from gsid.fitting.validation import nrmse

    channels = ["u1", "u2", "u3"], ["y1", "y2", "y3"]
    test = [gsid.read_mimo_record(folder / f"test{e}.npz", *channels) for e in (1, 2, 3)]
    return nrmse(gsid.load_model(folder / name), test)


@pytest.mark.long
def test_a_model_of_the_mirror(page):
    """At most the published error on experiments kept out, output by output."""
    folder = page("A model of the mirror")
    assert np.all(mirror_error(folder, "mirror.json") <= PUBLISHED_MIRROR)
    assert (folder / "mirror.png").stat().st_size > 50_000


@needs_time
def test_a_model_of_the_mirror_with_a_delay(page):
    page("A model of the mirror")
    folder = page("A model of the mirror", "shell-session")
    assert np.all(mirror_error(folder, "mirror_delay.json") <= mirror_error(folder, "mirror.json"))
