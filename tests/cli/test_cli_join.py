"""gsid join, and gsid fit of a joined response."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

from gsid.excitation.multisine import Multisine
from gsid.records.files import write_record
from gsid.records.record import Record

FS_HZ = 1000.0
B, A = [0, 0.3], [1, -0.97]


@pytest.fixture
def both():
    rng = np.random.default_rng(3)
    for name, n, band in (("low.csv", 4000, (0.5, 12)), ("high.csv", 1000, (4, 200))):
        u = np.tile(Multisine.design(FS_HZ, n, band, phases="random", seed=n).table(), 8)
        y = lfilter(B, A, u) + 0.1 * rng.standard_normal(len(u))
        write_record(name, Record(u, y, FS_HZ, n, n, hold="none", u_unit="A", y_unit="deg/s"))
    return "low.csv", "high.csv"


def test_two_records_are_joined_and_fitted_as_one(gsid, both):
    result = gsid("join", *both, "-o", "joined.csv", "--plot", "joined.svg")
    assert (result.code, result.out) == (0, "")
    assert "low.csv and high.csv agree at 9 common lines, 4 to 12 Hz" in result.err
    fitted = gsid("fit", "joined.csv", "--order", "1/0", "--domain", "z", "--delay", "0.001", "--json")
    assert fitted.code == 0, fitted.err
    values = json.loads(fitted.out)
    assert values["poles"][0][0] == pytest.approx(0.97, abs=1e-3)
    assert values["band_hz"] == [0.5, 200.0]


def test_a_written_response_joins_as_its_record(gsid, both):
    assert gsid("frf", both[0], "-o", "low_response.csv").code == 0
    one = json.loads(gsid("join", *both, "--json").out)
    other = json.loads(gsid("join", "low_response.csv", both[1], "--json").out)
    assert one["agree"] is True
    assert one["g_re"] == other["g_re"]
    assert len(one["overlaps"][0]["f_hz"]) == 9


def test_what_does_not_go_with_a_response_is_refused(gsid, both):
    gsid("frf", both[0], "-o", "a.csv")
    assert gsid("fit", "a.csv", "a.csv", "--order", "1/0").code == 2
    assert "gsid join" in gsid("fit", "a.csv", both[1], "--order", "1/0").err
    assert gsid("fit", "a.csv", "--order", "1/0", "--method", "all").code == 2
    assert gsid("join", "a.csv").code == 2
