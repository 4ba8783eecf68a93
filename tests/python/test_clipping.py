"""Ends of the range of an output at which its samples accumulate."""

import numpy as np
import pytest

import gsid
from gsid.records.clipping import clipped_ends, clipped_text

SEED = 20261127


def record_of(y, **more):
    return gsid.Record(np.arange(len(y)) % 7 - 3.0, y, 1000.0, **more)


def motion(rng):
    """Several periods of a sine, a multisine, a triangle or noise; some with noise, some held."""
    n, periods = int(rng.choice([256, 500, 1000, 2048])), int(rng.integers(2, 12))
    t = np.arange(n) / n
    kind = rng.integers(4)
    if kind == 0:
        y = np.cos(2 * np.pi * (rng.integers(1, 9) * t + rng.random()))
    elif kind == 1:
        lines = rng.integers(1, n // 6, size=(20, 1))
        y = np.cos(2 * np.pi * (lines * t + rng.random((20, 1)))).sum(axis=0)
    elif kind == 2:
        y = np.abs((rng.integers(1, 5) * t + rng.random()) % 1 - 0.5)
    else:
        y = rng.standard_normal(n)
    y = np.tile(y, periods) * 10 ** rng.uniform(-3, 3)
    if rng.random() < 0.6:
        y = y + rng.standard_normal(len(y)) * y.std() * 10 ** rng.uniform(-4, 0)
    if rng.random() < 0.5:
        hold = int(rng.integers(2, 9))
        y = np.repeat(y[::hold], hold)[: len(y)]
    return y


def rounded(y, rng):
    step = y.std() * 10 ** rng.uniform(-3, 0.3)
    return np.round(y / step) * step if rng.random() < 0.6 else y


def test_motion_within_the_range_has_no_clipped_end():
    """None of 4000, rounded to any number of steps: at most 0.1 % with 95 %."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    records = [record_of(rounded(motion(rng), rng)) for _ in range(4000)]
    assert [clipped_ends(one) for one in records if clipped_ends(one)] == []


@pytest.mark.parametrize("side", [-1, 1])
def test_the_clipped_end_and_its_share_are_those_of_the_clipping(side):
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    y = np.round(rng.standard_normal(20_000), 3)
    limit = 1.2
    ends = clipped_ends(record_of(side * np.minimum(y, limit)))
    assert [end.value for end in ends] == [side * limit]
    assert ends[0].share == pytest.approx(np.mean(y >= limit))


def test_both_ends_are_found_the_smallest_first():
    y = 5 * np.sin(2 * np.pi * np.arange(4000) / 400)
    assert [end.value for end in clipped_ends(record_of(np.clip(y, -3, 4)))] == [-3.0, 4.0]


def test_an_end_at_zero_is_not_minus_zero():
    y = np.maximum(np.sin(2 * np.pi * np.arange(4000) / 371), 0.0)
    (end,) = clipped_ends(record_of(y))
    assert f"{end.value:g}" == "0"


def test_lost_samples_do_not_count():
    """Their placeholders are 0, which would be the smallest value."""
    y = 2 + np.sin(2 * np.pi * np.arange(4000) / 371)
    valid = np.arange(4000) % 50 != 0
    assert clipped_ends(record_of(np.where(valid, y, 0.0), valid=valid)) == []


@pytest.mark.parametrize("y", [np.full(500, 3.0), np.array([1.0, 2.0, 1.0, 2.0])])
def test_a_constant_and_a_short_output_have_no_clipped_end(y):
    assert clipped_ends(record_of(y)) == []


def test_the_text_tells_the_record_the_value_and_the_share():
    y = np.clip(5 * np.sin(2 * np.pi * np.arange(4000) / 400), -9, 4)
    text = clipped_text([record_of(y, name="run1", y_unit="deg/s"), record_of(y / 2, name="run2")])
    assert "run1 at 4 deg/s (20.25% of its samples), run2 at 2 (20.25% of its samples)" in text
    assert clipped_text([record_of(np.sin(np.arange(500.0)))]) == ""
