"""Noise that rings with a resonance narrower than the bins of a record."""

import dataclasses

import numpy as np
import pytest

from gsid.diagnosis.from_records.ringing_lines import _rings
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.greybox.weights import pooled_variance
from gsid.spectrum.lines import bins_between_lines, lines_of
from gsid.spectrum.ringing import bin_power, noise_ratio
from gsid.spectrum.spectra import Spectra

FS_HZ, N, P = 200.0, 400, 8  # lines every 0.5 Hz, a record of 16 s


def spectra_of_periods(periods):
    Y = np.array([lines_of(one) for one in periods])
    line = np.arange(N // 2 + 1)
    return Spectra(FS_HZ, N, line, np.ones_like(Y), Y, 0, 0, line > 0)


def ringing_noise(rng, f_hz, decay_per_s, n_runs):
    """A resonance that white noise excites, (n_runs, P N): a complex recursion, stationary from the start."""
    pole = np.exp((-decay_per_s + 2j * np.pi * f_hz) / FS_HZ)
    white = rng.normal(size=(2, n_runs, P * N))
    kicks = white[0] + 1j * white[1]
    state = kicks[:, 0] / np.sqrt(1 - abs(pole) ** 2)
    out = np.empty((n_runs, P * N))
    for i in range(P * N):
        state = state * pole + kicks[:, i]
        out[:, i] = state.real
    return out


@pytest.mark.parametrize(("f_hz", "decay_per_s"), [(6.003, 0.02), (6.0, 0.3), (6.02, 0.05), (6.2, 0.02)])
def test_the_ratio_is_that_of_simulated_noise(f_hz, decay_per_s):
    seed = 20261126
    print("seed", seed)
    noise = ringing_noise(np.random.default_rng(seed), f_hz, decay_per_s, 3000)
    line = np.array([11, 12, 13])
    at, between = np.zeros(3), np.zeros(3)
    for one in noise:
        lines = np.array([lines_of(period) for period in one.reshape(P, N)])
        at += P * np.abs(lines.mean(axis=0)[line]) ** 2
        between += np.mean(np.abs(bins_between_lines(lines, N, 0)[line]) ** 2, axis=1)
    found = noise_ratio(spectra_of_periods(one.reshape(P, N)), line, f_hz, decay_per_s)
    # 3000 runs: the power in a bin is exponential, so that its mean scatters by 2 %. 8 % is four times that.
    np.testing.assert_allclose(found, at / between, rtol=0.08)


def test_a_wide_resonance_leaves_the_ratio_at_one():
    white = np.random.default_rng(1).normal(size=(P, N))
    ratio = noise_ratio(spectra_of_periods(white), np.arange(1, 100), 20.0, 300.0)
    np.testing.assert_allclose(ratio, 1, atol=0.01)


@pytest.mark.parametrize("is_white", [False, True])
def test_bug_a_peak_of_the_noise_was_spread_over_its_neighbours(is_white):
    """A cogging was nearest in place of a lag (seed 110034, single 34): it explained the noise of one line.

    The noise of the line is 3.3 times that between the lines, which is three times the mean over neighbours.
    """
    seed, f_hz, decay_per_s = 20261128, 6.0, 0.485
    print("seed", seed)
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(20, P * N)) if is_white else ringing_noise(rng, f_hz, decay_per_s, 20)
    records = [spectra_of_periods(one.reshape(P, N)) for one in noise]
    stack = {"flexible_mode": {"f_hz": f_hz, "zeta": decay_per_s / (2 * np.pi * f_hz), "residue": 1.0}}
    assert noise_ratio(records[0], np.array([12]), f_hz, decay_per_s)[0] < DEFAULTS.ringing
    found = []
    for i in range(0, 20, 2):  # two records of one level
        pair = records[i : i + 2]
        taken = pooled_variance(pair)
        found += [
            _rings(one, variance, stack, DEFAULTS) for one, (variance, _) in zip(pair, taken, strict=True)
        ]
    lines = np.flatnonzero(np.sum(found, axis=0))
    share = np.mean(found, axis=0)[12]
    print("lines", lines, "share of the records", share)
    if is_white:
        assert share <= 0.4
    else:
        assert share >= 0.9
        assert lines.tolist() == [12]


def rings(excited, **changes):
    """Lines left out of a record of noise with a resonance of 6 Hz and 0.05 1/s, line 12."""
    noise = ringing_noise(np.random.default_rng(20261129), 6.0, 0.05, 1)[0]
    one = spectra_of_periods(noise.reshape(P, N))
    one = dataclasses.replace(one, excited=np.isin(one.line, excited), **changes)
    stack = {"flexible_mode": {"f_hz": 6.0, "zeta": 0.05 / (2 * np.pi * 6.0), "residue": 1.0}}
    return np.flatnonzero(_rings(one, np.full(len(one.line), one.noise_y.mean()), stack, DEFAULTS))


def test_bug_a_record_lost_its_only_excited_line():
    assert rings([11, 12, 13]).tolist() == [12]
    assert rings([12]).tolist() == []


def test_bug_a_record_that_lost_periods_was_judged_by_the_noise_between_its_lines():
    """Its noise is that of the periods that are left, at the lines themselves."""
    assert rings([11, 12, 13], n_spoiled=1).tolist() == []


def test_an_oscillation_without_decay_has_all_its_power_in_one_bin():
    """Its bins are those of a sine: at the multiples of 1/T beside it there is nothing."""
    powers = bin_power(np.arange(4) / 16, 1e-9, 16.0)
    assert powers[0] == pytest.approx(8.0)  # T/2
    np.testing.assert_allclose(powers[1:], 0, atol=1e-6)
