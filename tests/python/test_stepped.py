"""The response to a stepped sine: waiting time, P periods of each sine, variance."""

import logging

import joined_bands as bands
import numpy as np
import pytest
from scipy.signal import lfilter

from gsid.base.errors import InputError
from gsid.excitation.generators import SteppedSine
from gsid.records.files import read_record, write_record
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.stepped import STEP_KEYS, Steps
from gsid.response.streaming import StreamingFrf
from gsid.response.with_distortion import frf_with_distortion

FS_HZ, N = 1000.0, 500


def design(**options):
    return SteppedSine.design(FS_HZ, N, (4, 60), **({"settle_samples": 400, "n_periods": 3} | options))


def record(signal, noise=0.1, seed=1, n_sequences=1):
    u = np.tile(signal.table(), n_sequences)
    y = lfilter(bands.B, bands.A, u) + noise * np.random.default_rng(seed).standard_normal(len(u))
    return Record(u, y, FS_HZ, hold="none", meta={k: str(v) for k, v in signal.steps.keys().items()})


@pytest.mark.parametrize("n_periods", [2, 5])
def test_intervals_of_a_stepped_sine_cover_the_truth(n_periods):
    held = np.concatenate([bands.inside(bands.stepped_sine(seed, n_periods)) for seed in range(60)])
    low, high = bands.limits(len(held))
    assert low <= held.sum() <= high, "seeds 0 .. 59"


def test_each_sine_is_measured_as_the_core_measures_it_on_the_target():
    """Step by step through the streaming core, which discards the waiting time itself."""
    signal = design()
    one = record(signal)
    response = frf(one)
    steps = signal.steps
    for i, line in enumerate(signal.line):
        core = StreamingFrf(FS_HZ, N, np.array([line]), settle_samples=steps.settle_samples)
        part = slice(i * steps.step_samples, (i + 1) * steps.step_samples)
        core.step(one.u[part], one.y[part])
        result = core.result()
        at = np.flatnonzero(response.line == line)[0]
        assert response.g[at] == pytest.approx(result.g[0], rel=1e-9)
        assert response.var_g[at] == pytest.approx(result.var_g[0], rel=1e-6)
    assert response.n_dof == 2
    assert list(response.f_hz) == sorted(signal.f_hz)


def test_sequences_and_records_are_combined():
    signal = design(n_periods=2)
    twice = frf(record(signal, n_sequences=2))
    assert (twice.n_periods, twice.n_dof) == (4, 3)
    several = frf([record(signal, seed=1), record(signal, seed=2), record(signal, seed=3)])
    assert several.n_dof == 5
    assert several.var_g.mean() < twice.var_g.mean()


def test_a_lost_sample_spoils_its_period_of_its_sine_only():
    signal = design()
    one = record(signal)
    one.valid[signal.steps.step_samples + 400 + 10] = False
    response = frf(one)
    at = np.flatnonzero(response.line == signal.line[1])[0]
    assert response.n_spoiled == 1
    assert np.array_equal(np.flatnonzero(response.dof != 2), [at])
    assert response.dof[at] == 1
    one.valid[signal.steps.step_samples + 400 + N + 10] = False
    assert frf(one).rejected_hz == pytest.approx([signal.f_hz[1]])


def test_a_waiting_time_that_is_too_short_is_reported(caplog):
    with caplog.at_level(logging.WARNING):
        frf(record(design(settle_samples=0), noise=1e-3))
    assert "the waiting time is too short" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        frf(record(design(settle_samples=1500), noise=1e-3))
    assert caplog.text == ""


def test_the_layout_goes_from_the_design_to_the_record(tmp_path):
    signal = design()
    signal.write_table(tmp_path / "u.csv")
    text = (tmp_path / "u.csv").read_text()
    assert "# stepped_settle_samples: 400\n" in text
    write_record(tmp_path / "rec.csv", record(signal))
    again = read_record(tmp_path / "rec.csv")
    assert [again.meta[key] for key in STEP_KEYS] == [str(N), "400", "3"]
    assert frf_with_distortion(again).var_total is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda one: one.meta.pop(STEP_KEYS[0]), "layout of the stepped sine is not valid"),
        (lambda one: one.meta.update({STEP_KEYS[2]: "-1"}), "layout of the stepped sine is not valid"),
        (lambda one: setattr(one, "settle_samples", 900), "is not one sine"),
        (lambda one: one.meta.update({STEP_KEYS[1]: "999999"}), "no whole step"),
    ],
)
def test_a_record_that_contradicts_its_layout_is_refused(change, words):
    one = record(design(), noise=0)
    change(one)
    with pytest.raises(InputError, match=words):
        frf(one)


def test_bug_a_sine_whose_periods_are_all_lost_disappeared_in_silence(caplog):
    steps = Steps(100, 100, 3)
    t = np.arange(steps.step_samples)
    u = np.concatenate([np.cos(2 * np.pi * line * t / 100) for line in (3, 5)])
    y = u + 0.01 * np.random.default_rng(0).standard_normal(len(u))
    valid = np.arange(len(u)) < 500  # of the second sine the waiting time only
    meta = {key: str(value) for key, value in steps.keys().items()}
    found = frf(Record(u, y, 1000.0, valid=valid, meta=meta))
    assert found.f_hz == pytest.approx([30.0])
    assert found.n_spoiled == 3
    assert "all periods of the sine at sample 400 are lost" in caplog.text
