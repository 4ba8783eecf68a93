"""Columns of times: jitter and coarse stamps beside a stated rate, and gaps among them."""

import logging
from types import SimpleNamespace

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.records.files import read_record
from gsid.records.time_stamps import rate_of_times

SEED = 20261128
FS_HZ = 3000.0
N = 6000
RAW = SimpleNamespace(where=lambda name, at: f"column {name}, sample {at}")


def stamps(rng, jitter_s=0.0, resolution_s=0.0, lost=(), n=N):
    """Times of samples, of which some are lost; late by a random time, and rounded."""
    number = np.delete(np.arange(n + len(lost)), lost)
    t = number / FS_HZ + jitter_s * rng.standard_normal(n)
    return np.floor(t / resolution_s + 1e-9) * resolution_s if resolution_s else t


@pytest.fixture
def rng():
    print("seed", SEED)
    return np.random.default_rng(SEED)


@pytest.mark.parametrize(
    "clock",
    [
        {"jitter_s": 5e-5},  # bug: two stamps in 6000 were more than half a step closer, and refused
        {"jitter_s": 5e-4},  # of more than a step: stamps go back
        {"resolution_s": 1e-3},  # bug: of three steps; "the times do not increase", whatever rate was stated
        {"resolution_s": 1e-2},
        {"jitter_s": 1e-4, "resolution_s": 1e-3},
    ],
)
def test_the_stated_rate_holds_beside_jitter_and_coarse_stamps(rng, clock):
    for _ in range(100):
        found = rate_of_times(RAW, "t", stamps(rng, **clock), is_stated=True)
        assert found == pytest.approx(FS_HZ, rel=1e-2 if clock.get("resolution_s") == 1e-2 else 1e-3)


@pytest.mark.parametrize(
    ("clock", "n_lost", "near"),
    [
        ({}, 1, 0),
        ({"jitter_s": 2e-5}, 1, 2),
        ({"jitter_s": 5e-5}, 1, 30),
        ({"resolution_s": 1e-3}, 3, 120),
        ({"jitter_s": 5e-5}, 50, 30),
    ],
)
def test_a_gap_is_found_beside_them(rng, clock, n_lost, near):
    """Where it is, within the number of samples that the jitter leaves uncertain."""
    for _ in range(20):
        at = int(rng.integers(1000, 5000))
        t = stamps(rng, lost=tuple(range(at, at + n_lost)), **clock)
        with pytest.raises(InputError, match="unequal time steps") as caught:
            rate_of_times(RAW, "t", t, is_stated=True)
        place = int(caught.value.where.rpartition(" ")[2])
        assert abs(place - at) <= near
        assert caught.value.where.startswith("column t,")


def test_rows_in_disorder_are_refused_though_the_rate_is_stated(rng):
    """Bug: their jitter left no gap to be seen, and they were read as they stood."""
    with pytest.raises(InputError, match="unequal time steps"):
        rate_of_times(RAW, "t", np.concatenate([[0.0], rng.permutation(stamps(rng))[1:-1], [2.0]]), True)


def test_a_warning_tells_that_a_lost_sample_would_not_show(rng, caplog):
    with caplog.at_level(logging.WARNING):
        rate_of_times(RAW, "t", stamps(rng, resolution_s=1e-3), is_stated=True)
        assert caplog.messages == []
        rate_of_times(RAW, "t", stamps(rng, resolution_s=1e-2), is_stated=True)
    assert caplog.messages == ["the times are too coarse to show a lost sample"]


def test_stamps_that_are_coarser_than_a_sample_ask_for_the_rate(rng):
    with pytest.raises(InputError, match="coarser than a sample") as caught:
        rate_of_times(RAW, "t_s", stamps(rng, resolution_s=1e-3), is_stated=False)
    assert caught.value.hint == "they are rounded to 0.001 s: give the rate with --fs"


@pytest.mark.parametrize("is_stated", [False, True])
def test_stamps_that_go_back_are_no_coarse_ones(rng, is_stated):
    with pytest.raises(InputError, match="do not increase") as caught:
        rate_of_times(RAW, "t_s", stamps(rng)[::-1], is_stated)
    assert caught.value.hint == "sort the rows by time"


@pytest.mark.parametrize(
    ("name", "fs_hz", "warned"), [("t", None, True), ("t_s", None, False), ("t", 3.0, False)]
)
def test_a_column_t_in_milliseconds_is_pointed_out(tmp_path, caplog, name, fs_hz, warned):
    """Bug: 3 kHz became 3 Hz in silence, and a delay of 5.3 ms one of 5.3 s."""
    path = tmp_path / "rec.csv"
    rows = [f"{1e3 * n / FS_HZ:.6f},{n % 7},{n % 5}" for n in range(300)]
    path.write_text("\n".join([f"{name},u,y", *rows]))
    with caplog.at_level(logging.WARNING):
        assert read_record(path, fs_hz=fs_hz).fs_hz == pytest.approx(3.0)
    assert any("if it is in milliseconds" in text for text in caplog.messages) == warned
