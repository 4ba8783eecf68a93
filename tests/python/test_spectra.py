"""Variance of the mean of a wandering output: from between the lines, not from period to period."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from gsid.base.errors import InputError
from gsid.records import periods
from gsid.records.record import Record
from gsid.spectrum.line_test import exponential_score
from gsid.spectrum.lines import bins_between_lines, covariance, period_lines, variance_between_lines
from gsid.spectrum.realisation import realisations, spectra, spectra_of

N, P, SEED = 600, 4, 41


def mean_and_variances(disturbance, settle=0):
    lines = period_lines(disturbance.reshape(P, N), np.arange(N // 2 + 1, dtype=np.uint32), settle)
    between = variance_between_lines(lines, N, settle)
    return lines.mean(axis=0)[1:-1], between[1:-1], covariance(lines, lines).real[1:-1]


def test_white_noise_gives_the_same_as_the_scatter_of_the_periods():
    rng = np.random.default_rng(SEED)
    ratio = []
    for _ in range(100):
        _, between, scatter = mean_and_variances(rng.standard_normal(P * N))
        ratio.append(between.mean() / scatter.mean())
    # 299 lines of 3 complex degrees of freedom: each ratio is good to 5 %, their mean to 0.5 %.
    assert abs(np.mean(ratio) - 1) < 0.015


def test_a_wandering_output_is_not_counted_by_its_jumps():
    """A bug: nulls whose noise wandered were rejected in 3 % of trials, not in 5 %.

    The jumps between periods leak into each of them, and out of the mean.
    """
    rng = np.random.default_rng(SEED)
    mean_square, between, scatter = (np.zeros(N // 2 - 1) for _ in range(3))
    n_repeats = 400
    for _ in range(n_repeats):
        # First order, corner at a fifth of the first line: 1/f^2 at all of them.
        white = rng.standard_normal((P + 20) * N)
        wander = lfilter([1], [1, -np.exp(-2 * np.pi * 0.2 / N)], white)[20 * N :]
        mean, one, other = mean_and_variances(wander)
        mean_square += P * np.abs(mean) ** 2 / n_repeats
        between += one / n_repeats
        scatter += other / n_repeats
    low = slice(0, 40)  # well below half the sample rate
    found = np.mean(mean_square[low] / between[low]), np.mean(mean_square[low] / scatter[low])
    print(f"seed {SEED}: mean square over variance {found[0]:.3f} between lines, {found[1]:.3f} by scatter")
    # Leakage of a whole record hits all lines alike: the mean over lines is good to 1 / sqrt(400) = 5 %.
    assert abs(found[0] - 1) < 0.15
    assert found[1] < 0.75


@pytest.mark.parametrize("n_periods", [2, 3, 4, 8])
def test_bug_falling_noise_was_underestimated_with_an_even_number_of_periods(n_periods):
    """Nulls of two periods were rejected in 7 % of trials, not in 5 %.

    One bin more above a line than below it: with two periods the scores of this noise had a mean of 1.055.
    """
    rng = np.random.default_rng(SEED)
    lines = np.arange(N // 2 + 1, dtype=np.uint32)
    scores = []
    for _ in range(600):
        white = rng.standard_normal((n_periods + 20) * N)
        noise = lfilter([1], [1, -np.exp(-2 * np.pi * 3 / N)], white)[20 * N :]  # corner at line 3
        measured = period_lines(noise.reshape(n_periods, N), lines, 0)
        t = n_periods * np.abs(measured.mean(axis=0)) ** 2 / variance_between_lines(measured, N, 0)
        scores.append(exponential_score(t[2:21], n_periods - 1))
    mean = np.mean(scores)
    print(f"seed {SEED}: mean score {mean:.3f} with {n_periods} periods")
    # 11400 scores of standard deviation 1: 0.028 are three standard errors.
    assert abs(mean - 1) < 0.028


@pytest.mark.filterwarnings("error")
def test_a_single_period_has_no_bins_between_its_lines():
    lines = period_lines(np.arange(N, dtype=float)[None], np.arange(N // 2 + 1, dtype=np.uint32), 0)
    assert bins_between_lines(lines, N, 0).shape == (N // 2 + 1, 0)


def test_the_digest_is_of_the_measurement():
    rng = np.random.default_rng(SEED)
    u = np.tile(np.sin(2 * np.pi * 7 * np.arange(N) / N), P)
    record = Record(u, u + rng.standard_normal(P * N), 1e3, N, 0, hold="zoh", name="a.csv")
    digest = spectra(record).digest
    assert len(digest) == 16
    assert spectra(replace(record, name="b.csv"), settle=100).digest == digest
    assert spectra(replace(record, y=u + rng.standard_normal(P * N))).digest != digest


def test_settling_of_a_fraction_of_a_period_changes_nothing():
    wander = np.cumsum(np.random.default_rng(SEED).standard_normal(P * N))
    # Turned and turned back: rounding alone.
    turned = mean_and_variances(wander, settle=N + 77)[1]
    np.testing.assert_allclose(turned, mean_and_variances(wander)[1], rtol=1e-9)


def test_bug_a_record_given_twice_counted_as_two_realisations():
    """Its scatter over realisations was 0, and an effect was named that one record does not show."""
    rng = np.random.default_rng(20261127)
    u, y = np.tile(rng.standard_normal(100), 4), rng.standard_normal(400)
    one, copy = Record(u, y, 1000.0, 100, 0, name="a"), Record(u, y.copy(), 1000.0, 100, 0, name="b")
    other = Record(u, y + 1e-9, 1000.0, 100, 0, name="c")
    assert len(realisations([one, other])) == 2
    for same in ([one, other, copy], [spectra(one), spectra(copy)]):
        with pytest.raises(InputError, match=r"given twice(.|\n)*b: a"):
            realisations(same)
    assert len(spectra_of([one, copy])) == 2  # to predict, not to measure


def test_bug_lost_samples_were_called_a_wrong_period(monkeypatch):
    """The hint was to give the period that had been found."""
    u = np.random.default_rng(20261128).standard_normal(600)
    monkeypatch.setattr(periods, "find_period", lambda *_, **__: 200)
    with pytest.raises(InputError, match="samples may be lost"):
        spectra(Record(u, u, 1000.0))
    with pytest.raises(InputError, match="u repeats every 200 samples"):
        spectra(Record(u, u, 1000.0), period=150)
