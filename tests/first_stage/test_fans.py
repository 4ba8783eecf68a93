"""Periodic disturbances between the lines, of signals made sample by sample and in a diagnosis."""

from dataclasses import replace
from types import SimpleNamespace

import hard
import numpy as np
import pytest
from from_records_study import record_of
from test_steps import BODY, SPRING, VISCOUS, model

import gsid
from gsid.diagnosis.from_records.fans import subtract_fans
from gsid.spectrum.fan import ALPHA, find_fans, without_fans
from gsid.spectrum.spectra import Spectra

FS_HZ, N, P = 1000.0, 1000, 8  # lines of 1 Hz
LINES = np.arange(1, 121, 2)
FAN = (30.37, 0.6, 1.1)  # Hz, amplitude, phase


def record(seed, fan=FAN, periods=P, settle=0, coloured=False):
    rng = np.random.default_rng(seed)
    t_s = np.arange(settle + periods * N) / FS_HZ
    phases = rng.uniform(0, 2 * np.pi, len(LINES))
    one_period = np.outer(np.arange(N), LINES) * (2 * np.pi / N) + phases
    n = (periods + 1, len(t_s))
    u = np.tile(np.cos(one_period).sum(axis=1), n[0])[: n[1]]
    y = np.tile(np.cos(one_period - 0.3) @ (3.0 / LINES), n[0])[: n[1]]
    noise = rng.standard_normal(len(t_s))
    y += np.convolve(noise, [1.0, 0.8, 0.5], mode="same") if coloured else noise
    if fan:
        y += fan[1] * np.cos(2 * np.pi * fan[0] * t_s + fan[2])
    return gsid.Record(u, y, FS_HZ, N, settle, hold="zoh")


@pytest.mark.parametrize("settle", [0, 300])
@pytest.mark.parametrize("periods", [2, 3, 8])
def test_a_fan_is_found_with_its_frequency_amplitude_and_phase(periods, settle):
    one = gsid.spectra(record(1, periods=periods, settle=settle))
    (tone,) = find_fans(one)
    f_hz, amplitude, phase = FAN
    spread = amplitude * np.sqrt(2 / (periods * N)) / amplitude  # of amplitude and phase, relative
    assert tone.f_hz == pytest.approx(f_hz, abs=0.05 / periods)
    assert tone.amplitude == pytest.approx(amplitude, abs=5 * amplitude * spread + 0.02)
    middle_s = periods * N / FS_HZ / 2
    angle = 2 * np.pi * (f_hz * (middle_s + settle / FS_HZ) - tone.f_hz * middle_s) + phase - tone.phase_rad
    assert abs(np.angle(np.exp(1j * angle))) < 0.3


@pytest.mark.parametrize("settle", [0, 300])
def test_the_lines_are_those_without_the_fan(settle):
    """The same noise without it, beside all lines that stay."""
    one, quiet = gsid.spectra(record(2, settle=settle)), gsid.spectra(record(2, fan=None, settle=settle))
    cleaned = without_fans(one, find_fans(one))
    stays = ~cleaned.left_out
    stays[0] = False
    noise = np.sqrt(2 / N * 2)  # of a line of one period
    assert np.max(np.abs(cleaned.Y - quiet.Y)[:, stays]) < 0.3 * noise
    assert np.max(np.abs(one.Y - quiet.Y)[:, stays]) > noise
    np.testing.assert_array_equal(one.f_hz[cleaned.left_out], [30.0, 31.0])


def test_bug_a_fan_made_the_noise_of_the_lines_beside_it_many_times_too_large():
    """And so the p-values of nulls with a fan too large: 2.4 % of them were below 0.05, 0.17 below 0.5."""
    beside = slice(26, 36)
    ratio = {"with": [], "without": []}
    for seed in range(20):
        one, quiet = gsid.spectra(record(seed)), gsid.spectra(record(seed, fan=None))
        ratio["with"].append(one.noise_y[beside] / quiet.noise_y[beside])
        cleaned = without_fans(one, find_fans(one))
        left = np.where(cleaned.left_out, np.nan, cleaned.noise_y / quiet.noise_y)
        ratio["without"].append(left[beside])
    assert np.mean(ratio["with"]) > 5
    assert np.nanmean(ratio["without"]) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("coloured", [False, True])
def test_noise_alone_has_no_fan(coloured):
    """400 records at a rate of 1e-4: two of them have a probability of 8e-4."""
    seed = 5150
    found = sum(bool(find_fans(gsid.spectra(record(seed + i, None, coloured=coloured)))) for i in range(400))
    print("seed", seed)
    assert found <= 1, ALPHA


def test_an_input_that_differs_between_the_periods_may_contain_the_fan():
    """As in a closed loop: it is not subtracted from the output alone."""
    one = gsid.spectra(record(3))
    other = replace(one, U=one.U * (1 + 1e-6 * np.arange(P)[:, None]))
    assert find_fans(one)
    assert not find_fans(other)


def test_a_period_that_was_lost_leaves_no_common_phase():
    one = replace(gsid.spectra(record(4)), n_spoiled=1)
    assert not find_fans(one)


def test_lines_that_were_left_out_stay_left_out():
    one = gsid.spectra(record(5))
    known = np.arange(len(one.line)) == 60
    found = without_fans(replace(one, left_out=known), find_fans(one))
    assert set(np.flatnonzero(found.left_out)) == {30, 31, 60}
    assert isinstance(found, Spectra)


def test_a_sine_above_the_excited_band_stays():
    one = gsid.spectra(record(6, fan=(250.37, 5.0, 0.0)))
    assert find_fans(one) == []
    assert without_fans(one, []) is one


# ---- in a diagnosis ----------------------------------------------------------------------------------

LOW, HIGH = (
    {"flexible_mode": {"f_hz": f_hz, "zeta": 1e-4, "residue": 0.1}} for f_hz in (0.8 * FAN[0], 2 * FAN[0])
)


def prepared(stack, records):
    measured = [gsid.spectra(one) for one in records]
    run = SimpleNamespace(loop=None, in_closed_loop=False, stack=stack, measured=measured, judged=measured)
    run.known_fits, run.notes = {"a": "fit"}, []
    return run


def test_it_is_subtracted_from_what_is_measured_and_what_is_judged():
    run = prepared(model(BODY, VISCOUS), [record(1), record(2, fan=None)])
    run.judged = [replace(one, Y=one.Y - 1.0) for one in run.measured]
    before = run.measured[0]
    subtract_fans(run)
    assert run.measured[0].left_out[[30, 31]].all()
    assert run.measured[1].left_out is None
    np.testing.assert_allclose(run.judged[0].Y, run.measured[0].Y - 1.0, atol=1e-12)
    assert abs(before.Y[:, 30] - run.measured[0].Y[:, 30]).max() > 0.3
    assert run.known_fits == {}
    (note,) = run.notes
    assert note.startswith("A periodic disturbance of 30.37 Hz (0.")
    assert note.endswith(" is subtracted, and the lines beside it left out.")


@pytest.mark.parametrize(("mode", "stays"), [(LOW, True), (HIGH, False)])
def test_near_a_sharp_resonance_it_may_be_noise_that_rings(mode, stays):
    """At 1e-4 of 24 Hz the mode decays by e in 65 s, the record lasts 8 s; twice as high it is far away."""
    run = prepared(model(BODY, VISCOUS, mode), [record(1)])
    subtract_fans(run)
    assert (run.measured[0].left_out is None) is stays
    assert bool(run.notes) is not stays


def test_in_a_closed_loop_it_is_in_the_input_too():
    run = prepared(model(BODY, VISCOUS, SPRING), [record(1)])
    run.in_closed_loop = True
    subtract_fans(run)
    assert run.measured[0].left_out is None


def test_a_diagnosis_states_the_fan_that_was_drawn():
    trial = hard.make_hard(110120, 4, "null")
    found = gsid.diagnose_records([record_of(u, y) for u, y in trial.records])
    f_hz, amplitude = trial.key["noise"]["fan"]
    (note,) = [one for one in found.notes if "periodic disturbance" in one]
    assert f"{f_hz:.4g} Hz ({amplitude:.1g}" in note
    assert found.verdict == "adequate"
