"""`gsid predict`: numbers on the standard output, and the picture."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from gsid.models.rational import RationalModel


@pytest.fixture
def models(rec_csv, gsid):
    """The fit of rec.csv, and the same with 20 % more gain."""
    assert gsid("fit", rec_csv, "--order", "2/0", "-o", "tf.json").code == 0
    fitted = RationalModel.load("tf.json")
    replace(fitted, num=1.2 * fitted.num).save("off.json")


def test_a_gain_that_is_off_by_a_fifth_leaves_a_fifth(gsid, rec_csv, models):
    good = json.loads(gsid("predict", rec_csv, "--model", "tf.json", "--json").out)["records"][0]
    off = json.loads(gsid("predict", rec_csv, "--model", "off.json", "--json").out)["records"][0]
    assert good["fit_percent"] == pytest.approx(good["fit_percent_of_noise"], abs=1.0)
    assert off["fit_percent"] == pytest.approx(80, abs=1.0)  # noise and the other error add in squares
    assert off["rms_output"] == good["rms_output"]


def test_it_prints_a_row_for_each_record(gsid, rec_csv, models):
    result = gsid("predict", rec_csv, rec_csv, "--model", "tf.json")
    assert result.code == 0
    assert len([line for line in result.out.splitlines() if line.startswith("rec.csv")]) == 2


def test_it_draws(gsid, rec_csv, models):
    result = gsid("predict", rec_csv, "--model", "tf.json", "--plot", "p.png")
    assert result.code == 0
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")


def test_a_model_that_is_not_there(gsid, rec_csv):
    result = gsid("predict", rec_csv, "--model", "none.json")
    assert (result.code, result.out) == (3, "")
