"""`--plot`: every verb that measures or judges draws its result; the others name the verbs that do."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from gsid.excitation.multisine import Multisine
from gsid.records.files import write_record
from gsid.records.record import Record

PNG = b"\x89PNG"


@pytest.fixture
def axis_files():
    """Two realisations of a held command on a first-order axis, with noise; and a model 20 % off."""
    gain, rate, fs_hz = 40.0, 25.0, 1000.0
    pole = np.exp(-rate / fs_hz)
    for seed in (1, 2):
        u = np.tile(Multisine.design(fs_hz, 500, (2, 200), rms=1.0, phases="random", seed=seed).table(), 8)
        y = lfilter([0, gain / rate * (1 - pole)], [1, -pole], u)
        y += 1e-3 * np.random.default_rng(seed).normal(size=u.size)
        write_record(f"axis{seed}.csv", Record(u, y, fs_hz, 500, 1000, hold="zoh", y_unit="deg/s"))
    effects = {"rigid_body": {"gain": 1.2 * gain}, "viscous_friction": {"rate": 0.8 * rate}}
    stack = [{"effect": effect, "params": params} for effect, params in effects.items()]
    Path("axis.json").write_text(json.dumps({"gsid_model": 1, "fs_hz": fs_hz, "effects": stack}))


FITS = {
    "one_model": ["rec.csv", "--order", "2/0"],
    "pieces": ["rec.csv", "--order", "1/0", "--piecewise", "2"],
    "pieces_auto": ["rec.csv", "--order", "2/0", "--piecewise", "auto"],
    "every_method": ["rec.csv", "--order", "2/0", "--method", "all"],
    "every_method_held_out": ["axis1.csv", "--order", "1/0", "--method", "all", "--held-out", "axis2.csv"],
    "stack": ["axis1.csv", "--model", "axis.json"],
    "stack_two_records": ["axis1.csv", "axis2.csv", "--model", "axis.json", "--method", "nls-output"],
}


@pytest.mark.parametrize("kind", FITS)
def test_every_kind_of_fit_is_drawn(gsid, rec_csv, axis_files, kind):
    """Bug: --plot was refused with --piecewise, --method all and --model."""
    plain = gsid("fit", *FITS[kind], "--json")
    drawn = gsid("fit", *FITS[kind], "--json", "--plot", "fit.png")
    assert drawn.code == 0, drawn.err
    assert "wrote fit.png" in drawn.err
    assert Path("fit.png").read_bytes().startswith(PNG)
    assert _without_times(drawn.out) == _without_times(plain.out)


def _without_times(text):
    values = json.loads(text)
    for row in values.get("estimators", ()):
        del row["seconds"]
    return values


@pytest.mark.parametrize(
    "arguments",
    [
        ["doctor"],
        ["effects"],
        ["simulate"],
        ["export-c", "tf.json"],
        ["report", "rec.csv"],
        ["design", "budget", "rec.csv"],
    ],
)
def test_a_verb_without_a_picture_names_those_that_draw(gsid, rec_csv, arguments):
    result = gsid(*arguments, "--plot", "result.png")
    assert (result.code, result.out) == (2, "")
    assert "No such option '--plot'" in result.err
    for verb in ("frf", "noise", "distortion", "fit", "compare", "diagnose", "add", "run"):
        assert verb in result.err.split("hint: ")[1]


def test_several_records_of_noise_have_no_one_picture(gsid, rec_csv):
    result = gsid("noise", rec_csv, rec_csv, "--plot", "noise.png")
    assert result.code == 2
    assert "one record" in result.err
    assert "hint: run `gsid noise` once for each record" in result.err
