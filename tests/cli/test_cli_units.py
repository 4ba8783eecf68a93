"""--unit and --factor: columns of records in other units, also in studies and their scripts."""

import json
import subprocess
import sys

import pytest

from gsid.cli.study_script import python_script, shell_script
from gsid.models.load import load_model
from gsid.records.files import read_record, write_record
from gsid.study.folder import Study

TURNED = ("--factor", "y=57.29577951308232", "--unit", "y=deg/s")


@pytest.fixture
def rate(record):
    write_record("rate.csv", record)
    return "rate.csv"


def test_a_record_is_seen_in_the_unit_that_is_stated(gsid, rate):
    plain = json.loads(gsid("frf", rate, "--json").out)
    found = json.loads(gsid("frf", rate, *TURNED, "--json").out)
    assert found["y_unit"] == "deg/s"
    assert found["g_re"][3] == pytest.approx(57.29577951308232 * plain["g_re"][3])


def test_a_factor_without_a_unit_is_bad_input_with_a_hint(gsid, rate):
    result = gsid("look", rate, "--factor", "y=2")
    assert result.code == 3
    assert "--unit 'y=UNIT'" in result.err


@pytest.mark.parametrize("wrong", [("--unit", "y"), ("--unit", "=V"), ("--factor", "y=two")])
def test_what_is_not_a_column_with_a_value_is_a_usage_error(gsid, rate, wrong):
    assert gsid("look", rate, *wrong).code == 2


def test_the_script_of_a_study_repeats_the_conversion(gsid, rate):
    assert gsid("-C", "st", "open", rate).code == 0
    assert gsid("-C", "st", "look", *TURNED).code == 0
    assert gsid("-C", "st", "fit", "--order", "2/0", *TURNED).code == 0
    study = Study("st")
    assert "--factor y=57.29577951308232 --unit y=deg/s" in shell_script(study)
    text = python_script(study)
    assert "units={'y': 'deg/s'}, factors={'y': 57.29577951308232}" in text
    model = study.path(study.models[-1])
    before, first = json.loads(model.read_text()), load_model(model)
    model.unlink()
    subprocess.run([sys.executable, "-c", text], cwd=study.folder, check=True, capture_output=True)
    after = json.loads(model.read_text())
    assert after["y_unit"] == before["y_unit"] == "deg/s"
    f_hz = [10.0, 50.0, 120.0]
    assert load_model(model).response(f_hz) == pytest.approx(first.response(f_hz), rel=1e-6)


def test_a_part_is_written_in_the_unit_that_is_stated(gsid, rate):
    assert gsid("cut", rate, "--to", "1.5", *TURNED, "-o", "part.csv").code == 0
    part, whole = read_record("part.csv"), read_record(rate)
    assert part.y_unit == "deg/s"
    assert part.y[0] == pytest.approx(57.29577951308232 * whole.y[0])
