"""gsid cut"""

import json

import numpy as np
import pytest
from known_system import FS_HZ

from gsid.records.files import read_record


@pytest.mark.parametrize("kind", ["csv", "npz", "h5", "mat"])
def test_the_part_is_written_and_can_be_read(gsid, record, rec_csv, kind):
    result = gsid("cut", rec_csv, "--from", "0.1", "--to", "0.5", "-o", f"part.{kind}", "--json")
    assert result.code == 0
    part = read_record(f"part.{kind}")
    first, last = round(0.1 * FS_HZ), round(0.5 * FS_HZ)
    assert np.array_equal(part.y, record.y[first:last])
    assert part.y_unit == record.y_unit
    assert json.loads(result.out)["samples"] == last - first


def test_an_interval_outside_the_record_is_an_error_with_its_length(gsid, rec_csv):
    result = gsid("cut", rec_csv, "--from", "1e6", "-o", "part.csv")
    assert result.code == 3
    assert "the interval" in result.err
    assert "hint: the record has 0 to" in result.err
    empty = gsid("cut", rec_csv, "--from", "0.3", "--to", "0.3", "-o", "part.csv")
    assert "the interval has no sample" in empty.err
    assert "hint: the record has 0 to" in empty.err
    past = gsid("cut", rec_csv, "--from", "1e6", "--to", "2e6", "-o", "part.csv")
    assert "the interval is not in the record" in past.err


def test_one_record_at_a_time(gsid, rec_csv):
    assert gsid("cut", rec_csv, rec_csv, "-o", "part.csv").code == 2
