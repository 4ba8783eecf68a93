"""Drift and spikes of a measured output."""

import numpy as np
import pytest
from scipy import stats

import gsid
from gsid.records.condition import condition_of
from gsid.records.periods import split_periods

N, P, SEED = 400, 8, 20261124


def record_of(y, settle=0):
    u = np.sin(2 * np.pi * 7 * np.arange(len(y)) / N)
    return gsid.Record(u, y, 100.0, N, settle)


def noisy(seed=SEED, periods=P):
    print("seed", seed)
    rng = np.random.default_rng(seed)
    t = np.arange(N * periods)
    return np.cos(2 * np.pi * 7 * t / N) + 0.1 * rng.standard_normal(len(t))


def seen_in(y, settle=0):
    return condition_of(split_periods(record_of(y, settle)))


def test_the_drift_is_the_line_through_the_means_of_the_periods():
    y = noisy() + 0.5 * np.arange(N * P) / N
    means = y.reshape(P, N).mean(axis=1)
    line = stats.linregress(np.arange(P), means)
    seen = seen_in(y)
    assert seen.drift == pytest.approx(line.slope * (P - 1))
    assert seen.drift_error == pytest.approx(line.stderr * (P - 1))
    assert seen.drifts


def test_white_noise_alone_drifts_as_rarely_as_t_of_three_says():
    """Of 2000 records, the share beyond three standard errors with 6 degrees of freedom."""
    share = 2 * stats.t.sf(3, P - 2)
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    n = sum(
        condition_of(split_periods(record_of(np.tile(record_y, P) + rng.standard_normal(N * P)))).drifts
        for record_y in np.zeros((500, N))
    )
    low, high = stats.binom.interval(0.999, 500, share)
    assert low <= n <= high


def test_two_periods_have_no_error_of_the_drift_and_do_not_drift():
    seen = seen_in(noisy(periods=2) + np.arange(2 * N))
    assert np.isnan(seen.drift_error)
    assert not seen.drifts


def test_spikes_are_found_at_their_samples_after_the_settling():
    y = noisy()
    y[[1000, 1001, 2500]] += 3.0
    y[20] += 50.0  # while it settles
    assert seen_in(y, settle=N).spikes.tolist() == [1000, 2500]


def test_noise_a_drift_and_a_disturbance_beside_the_period_are_no_spikes():
    t = np.arange(N * P)
    y = noisy() + 0.3 * t / N + np.sin(2 * np.pi * 30.87 * t / N)
    assert not len(seen_in(y).spikes)


def test_single_steps_of_a_quantized_record_are_no_spikes():
    y = np.round(np.tile(np.cos(2 * np.pi * 7 * np.arange(N) / N), P), 2)
    y[[300, 900, 1700]] += 0.01
    y[500] += 1.0
    assert seen_in(y).spikes.tolist() == [500]


def test_bug_a_large_spike_made_its_whole_period_stand_out():
    y = noisy()
    y[1007] += 1e5
    assert seen_in(y).spikes.tolist() == [1007]


def test_bug_the_refreshes_of_a_free_running_gyro_were_spikes():
    """The gyro holds its output for 7.5 samples by its own clock: its steps shift over the periods."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    refresh = np.arange(0, 20 * N, 7.497)
    measured = np.cos(2 * np.pi * 7 * refresh / N) + 0.01 * rng.standard_normal(len(refresh))
    held = measured[np.searchsorted(refresh, np.arange(20 * N), side="right") - 1]
    assert not len(seen_in(held).spikes)
    held[[2000, 2001, 5555]] += 3.0
    assert seen_in(held).spikes.tolist() == [2000, 5555]


@pytest.mark.parametrize("periods", [2, 3, 4, 5])
def test_bug_noise_of_three_periods_had_spikes(periods):
    """The median of three is one of them: a third of all deviations from it are 0."""
    rng = np.random.default_rng(SEED)
    found = [seen_in(noisy(int(rng.integers(2**31)), periods)).spikes for _ in range(30)]
    assert not len(np.concatenate(found))
