"""A part of a record in time."""

import numpy as np
import pytest

import gsid

FS_HZ, N = 100.0, 1000


@pytest.fixture
def record():
    t = np.arange(N)
    return gsid.Record(
        t * 1.0, -t, FS_HZ, 200, 50, u_unit="A", hold="zoh", name="rec", columns={"angle": t * 2.0}
    )


def test_the_part_has_the_samples_of_the_interval(record):
    part = gsid.cut(record, 2.0, 7.0)
    assert part.u == pytest.approx(np.arange(200, 700))
    assert part.y == pytest.approx(-np.arange(200, 700))
    assert part.columns["angle"] == pytest.approx(2 * np.arange(200, 700))
    assert (part.fs_hz, part.u_unit, part.hold, part.name) == (FS_HZ, "A", "zoh", "rec 2 to 7 s")


def test_a_time_between_samples_begins_at_the_next(record):
    assert gsid.cut(record, 1.001, 1.055).u == pytest.approx([101, 102, 103, 104, 105])


@pytest.mark.parametrize(("end", "period"), [(4.0, None), (4.01, 200)])
def test_a_period_stays_if_the_part_has_more_than_one(record, end, period):
    part = gsid.cut(record, 2.0, end)
    assert part.period_samples == period
    assert part.settle_samples is None


def test_lost_samples_stay_lost(record):
    record.valid[[250, 800]] = False
    assert np.flatnonzero(~gsid.cut(record, 2.0, 7.0).valid).tolist() == [50]


@pytest.mark.parametrize(("begin", "end"), [(-1, 5), (2, 10.5), (5, 5), (5, 2), (np.nan, 5), (0, np.inf)])
def test_an_interval_without_samples_or_outside_is_an_error(record, begin, end):
    with pytest.raises(gsid.InputError, match="interval"):
        gsid.cut(record, begin, end)
