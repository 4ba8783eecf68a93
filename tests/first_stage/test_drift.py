"""Drift of the output, estimated from the bins between the lines, against signals whose drift is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_steps import BODY, VISCOUS, model

import gsid
from gsid.diagnosis.from_records.disturbances import subtract_disturbances
from gsid.spectrum import drift as drift_module
from gsid.spectrum.drift import find_drift, without_drift

FS_HZ, N = 1000.0, 2000


def record(rng, periods, walk=0.0, ramp=0.0, decay=0.0, share=0.2, settle=0):
    """White noise, a random walk, a ramp and a decaying transient; also what they drift by over a period.

    A ramp that the means of the periods show is subtracted when a record is read (`gsid.records.turn`).
    """
    n = settle + periods * N
    u = np.tile(rng.standard_normal(N), periods + 1)[:n]
    random = walk * np.cumsum(rng.standard_normal(n))
    slow = random + ramp * np.arange(n) / N + decay * np.exp(-np.arange(n) / (share * N))
    y = 0.5 * u + rng.standard_normal(n) + slow
    one = gsid.spectra(gsid.Record(u, y, FS_HZ, N, settle, hold="zoh"))
    return one, (random[-1] - random[settle]) / periods + ramp


@pytest.mark.parametrize("settle", [0, 700])
@pytest.mark.parametrize("periods", [2, 3, 8])
def test_a_ramp_is_found_and_leaves_the_lines(periods, settle):
    rng = np.random.default_rng(periods)
    one, truth = record(rng, periods, ramp=1.6 / periods, settle=settle)
    # What `turn` has subtracted already, from the means of the periods, is not found again.
    assert find_drift(one) == pytest.approx(truth - one.turn, abs=0.3)
    flat, _ = record(np.random.default_rng(periods), periods, settle=settle)
    cleaned = without_drift(one, truth - one.turn)
    np.testing.assert_allclose(cleaned.Y[:, 1:], flat.Y[:, 1:], atol=1e-9)
    assert np.ptp(cleaned.Y[:, 0].real - flat.Y[:, 0].real) < 1e-9


@pytest.mark.parametrize("walk", [0.05, 1.0])
@pytest.mark.parametrize("periods", [2, 3, 8])
def test_the_intervals_of_a_random_walk_cover_its_drift(monkeypatch, walk, periods):
    """Its ramp and the rest are independent. 300 draws: 3 standard deviations of their rms are 12 %."""
    seed = 9 * periods + round(walk)
    rng = np.random.default_rng(seed)
    stds = []
    mean = drift_module._weighted_mean
    monkeypatch.setattr(drift_module, "SIGNIFICANT", 0.0)
    monkeypatch.setattr(drift_module, "SAME", 1e9)
    monkeypatch.setattr(drift_module, "_weighted_mean", lambda x, w: stds.append(mean(x, w)) or stds[-1])
    errors = []
    for _ in range(300):
        one, truth = record(rng, periods, walk)
        if one.turn == 0:  # else taken for an angle that turns on and on: its ramp is subtracted already
            stds.clear()
            errors.append((find_drift(one) - truth) / stds[0][1])
    # The weights come from 31 bins each, those of the first bins from fewer: up to 15 % more.
    assert 0.85 < np.std(errors) < 1.3, f"seed {seed}"


def test_noise_without_a_drift_shows_none():
    """At three standard deviations 0.3 % of records: of 300 at most 6 (99.9 %)."""
    rng = np.random.default_rng(41)
    assert sum(find_drift(record(rng, 4)[0]) != 0 for _ in range(300)) <= 6


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("periods", [2, 3, 8])
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_bug_a_record_without_noise_overflowed(periods, offset):
    """Its weights were one over nothing; what rounding leaves, 1e-13 of the output, is no drift either."""
    rng = np.random.default_rng(2)
    u = rng.standard_normal(N)
    walk = 1e-13 * np.cumsum(rng.standard_normal(periods * N))
    for more in (0.0, walk):
        y = np.tile(offset + 0.5 * u, periods) + more
        one = gsid.spectra(gsid.Record(np.tile(u, periods), y, FS_HZ, N, 0, hold="zoh"))
        assert find_drift(one) == 0


@pytest.mark.filterwarnings("error")
def test_an_output_of_zeros_has_no_drift():
    one, _ = record(np.random.default_rng(3), 4)
    assert find_drift(replace(one, Y=np.zeros_like(one.Y))) == 0


@pytest.mark.parametrize("walk", [0.0, 1.0])
@pytest.mark.parametrize("decay", [3.0, 30.0])
@pytest.mark.parametrize("share", [0.003, 0.01, 0.03, 0.1, 1.0])
def test_a_transient_adds_no_more_than_chance_to_the_lines(share, decay, walk):
    """Above its corner it has the bins of a ramp, below it has not: without them the lines are better.

    The limit is 9 / (P - 1), that of a drift that is not significant, twice for the scatter of few draws.
    """
    rng, added = np.random.default_rng(17), []
    for _ in range(8):
        one, _ = record(rng, 4, walk, decay=decay, share=share)
        noise = np.convolve(one.noise_y / one.n_periods, np.ones(15) / 15, mode="same")
        lines = slice(1, 400)
        errors = [np.abs(s.y - 0.5 * s.u)[lines] ** 2 for s in (one, without_drift(one, find_drift(one)))]
        added.append(2 * np.sum((errors[1] - errors[0]) / noise[lines]))
    assert np.mean(added) < 6


def test_where_it_cannot_be_known_there_is_none():
    one, _ = record(np.random.default_rng(4), 4, ramp=0.4)
    assert find_drift(one) > 0.3
    one.n_spoiled = 1
    assert find_drift(one) == 0
    moving, _ = record(np.random.default_rng(4), 4, ramp=0.4)
    moving = replace(moving, U=moving.U * np.array([[1.001], [1.0], [1.0], [1.0]]))  # a closed loop
    assert find_drift(moving) == 0


def test_a_diagnosis_subtracts_it_from_what_is_measured_and_judged_and_states_it():
    rng = np.random.default_rng(5)
    measured = [record(rng, 4, ramp=-0.4)[0], record(rng, 4)[0]]
    run = SimpleNamespace(loop=None, in_closed_loop=False, stack=model(BODY, VISCOUS), notes=[])
    run.measured, run.judged, run.known_fits = measured, list(measured), {"a": "fit"}
    subtract_disturbances(run)
    assert abs(find_drift(run.measured[0])) < 1e-6
    assert run.measured[1] is measured[1]
    np.testing.assert_array_equal(run.judged[0].Y, run.measured[0].Y)
    assert run.known_fits == {}
    (note,) = run.notes
    assert note.startswith("The output drifts (in 1 of 2 records, by up to -0.")
    per_second = float(note.split("up to ")[1].split()[0])
    assert per_second == pytest.approx(-0.2, abs=0.05)  # a period has 2 s


def test_bug_the_leakage_of_a_fan_was_a_drift():
    """The rig of the tutorial has a fan and no drift; one was subtracted, before the fan."""
    rng = np.random.default_rng(23)
    n = 4 * N
    u = np.tile(rng.standard_normal(N), 4)
    fan = 5.0 * np.sin(2 * np.pi * 3.3 * np.arange(n) / FS_HZ + 1.5)
    one = gsid.spectra(gsid.Record(u, 0.5 * u + rng.standard_normal(n) + fan, FS_HZ, N, 0, hold="zoh"))
    run = SimpleNamespace(loop=None, in_closed_loop=False, stack=model(BODY, VISCOUS), notes=[])
    run.measured, run.judged, run.known_fits = [one], [one], {}
    subtract_disturbances(run)
    (note,) = run.notes
    assert note.startswith("A periodic disturbance of 3.3 Hz")
    assert find_drift(one) < -1  # beside the fan
