"""Columns of a record in other units than the file states."""

import numpy as np
import pytest

import gsid
from gsid.base.errors import InputError
from gsid.records.files import write_record
from gsid.records.record import Record

RAD = 57.29577951308232


@pytest.fixture
def path(tmp_path):
    rng = np.random.default_rng(3)
    u, y, r = rng.normal(size=(3, 40))
    record = Record(u, y, 100.0, 10, 0, u_unit="V", y_unit="rad/s", columns={"r": r})
    write_record(tmp_path / "rec.csv", record)
    return tmp_path / "rec.csv"


def test_a_factor_converts_a_column_and_states_its_unit(path):
    plain = gsid.read_record(path)
    found = gsid.read_record(path, units={"y": "deg/s"}, factors={"y": RAD, "r": 2.0})
    np.testing.assert_array_equal(found.y, plain.y * RAD)
    np.testing.assert_array_equal(found.columns["r"], 2 * plain.columns["r"])
    np.testing.assert_array_equal(found.u, plain.u)
    assert (found.u_unit, found.y_unit) == ("V", "deg/s")
    assert found.period_samples == 10


def test_a_unit_alone_replaces_that_of_the_file(path):
    assert gsid.read_record(path, units={"u": "A"}).u_unit == "A"


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"factors": {"y": 2.0}}, "unit after the factor"),
        ({"factors": {"gyro": 2.0}}, "no column named gyro"),
        ({"units": {"gyro": "V"}}, "no column named gyro"),
        ({"units": {"r": "V"}}, "of input and output only"),
        ({"factors": {"r": 0.0}}, "other than 0"),
        ({"factors": {"r": float("nan")}}, "other than 0"),
    ],
)
def test_a_conversion_that_is_not_clear_is_refused(path, how, words):
    with pytest.raises(InputError, match=words):
        gsid.read_record(path, **how)


def test_a_matrix_of_responses_has_converted_inputs_and_outputs(path):
    found = gsid.read_mimo_record(path, ["u", "r"], ["y"], units={"r": "A", "y": "deg/s"}, factors={"r": 3.0})
    assert found.u_units == ["V", "A"]
    assert found.y_units == ["deg/s"]
    np.testing.assert_allclose(found.u[:, 1], 3 * gsid.read_record(path).columns["r"])
    with pytest.raises(InputError, match="of inputs and outputs only"):
        gsid.read_mimo_record(path, ["u"], ["y"], units={"r": "A"})
