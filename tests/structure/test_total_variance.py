"""Total variance of the best linear approximation, against noise and distortion of known size."""

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.response.total_variance import local_variance, total_variance

SEED = 20261122
N, P, FS_HZ = 2000, 4, 1000.0
SIGMA = 0.05  # of the noise, per sample


def odd_lines(rng, share=1.0):
    odd = np.arange(1, 600, 2)
    return odd[rng.random(len(odd)) < share]


def period_of(lines, phases):
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[lines] = np.exp(1j * phases)
    return np.fft.irfft(spectrum, N) * N / 2


def filtered(u):
    """A first-order lag at 40 Hz, periodic."""
    f = np.arange(N // 2 + 1) * FS_HZ / N
    return np.fft.irfft(np.fft.rfft(u) / (1 + 1j * f / 40.0), N)


def record(rng, lines, law=lambda u: u, sigma=SIGMA):
    u = period_of(lines, 2 * np.pi * rng.random(len(lines)))
    y = np.tile(filtered(law(u)), P) + sigma * rng.standard_normal(N * P)
    return Record(np.tile(u, P), y, FS_HZ, period_samples=N, settle_samples=0)


@pytest.fixture
def rng():
    print("seed", SEED)
    return np.random.default_rng(SEED)


def test_noise_and_local_model_agree_with_white_noise(rng):
    found = total_variance(record(rng, odd_lines(rng)))
    true = 4 * SIGMA**2 / (N * P)  # lines have amplitude 1
    for source in ("noise", "local_model"):
        assert np.mean(found.sources[source]) == pytest.approx(true, rel=0.25), source
    assert np.median(found.var_total / true) < 2


def test_scatter_over_realisations_with_lines_of_their_own(rng):
    """Each line is averaged over the realisations that excite it, and its variance is that of this mean."""
    records = [record(rng, odd_lines(rng, 0.7)) for _ in range(5)]
    found = total_variance(records)
    excited = [set(np.flatnonzero(np.abs(np.fft.rfft(r.u[:N])) > 1)) for r in records]
    assert set(found.line) == set.union(*excited)
    count = [sum(k in one for one in excited) for k in found.line]
    assert np.array_equal(found.n_realisations, count)
    true = 4 * SIGMA**2 / (N * P) / np.array(count)
    assert np.median(found.sources["realisations"] / true) == pytest.approx(1, rel=0.2)
    assert found.largest_source in ("realisations", "noise")
    f_hz = found.f_hz
    error = np.abs(found.g - 1 / (1 + 1j * f_hz / 40.0)) ** 2
    assert np.mean(error / true) == pytest.approx(1, rel=0.25)


def test_distortion_is_in_the_total_variance_and_not_in_the_noise(rng):
    def cubic(u):
        return u + 0.02 * (u / np.std(u)) ** 3 * np.std(u)

    lines = odd_lines(rng, 0.75)
    realisations = [record(rng, lines, cubic, sigma=1e-4) for _ in range(30)]
    true = total_variance(realisations).var_total * 30  # of one realisation
    for source in ("local_model", "detection_lines"):
        one = total_variance(realisations[0]).sources[source]
        assert 0.4 < np.median(one / true) < 2.5, source
    assert np.median(total_variance(realisations[0]).var_noise / true) < 1e-2


def test_bug_the_variance_at_the_first_lines_of_a_slope_was_that_of_larger_responses(rng):
    """Behind a spring the response rises from the first line on, and so does the distortion."""
    line = np.arange(1, 200, 2)
    true = 1 / (1j * line + 12.0 + 150.0 / (1j * line))
    share = 0.2 * (rng.standard_normal((200, len(line))) + 1j * rng.standard_normal((200, len(line))))
    found = np.array([local_variance(line, true * (1 + one / np.sqrt(2))) for one in share])
    ratio = np.median(found, axis=0) / (0.2 * np.abs(true)) ** 2
    assert ratio[:8].max() < 1.6
    assert ratio.min() > 0.6


def test_smooth_phases_are_recognised(rng):
    multisine = Multisine.design(FS_HZ, N, (1, 300), grid="odd")
    u = np.tile(multisine.table(), P)
    noisy = Record(u, u + SIGMA * rng.standard_normal(len(u)), FS_HZ, period_samples=N, settle_samples=0)
    assert total_variance(noisy).smooth_phases
    assert not total_variance(record(rng, odd_lines(rng))).smooth_phases


def test_the_same_phases_twice_are_one_realisation(rng):
    """Their scatter is noise alone: distortion repeats."""
    one = record(rng, odd_lines(rng), lambda u: u + 1e-3 * u**3, sigma=1e-3)
    twice = [one, Record(one.u, one.y + 1e-3 * rng.standard_normal(len(one)), FS_HZ, N, 0)]
    found = total_variance(twice)
    assert "realisations" not in found.sources
    assert "local_model" in found.sources


def test_several_realisations_of_one_period_each(rng):
    lines = odd_lines(rng)
    records = [record(rng, lines) for _ in range(4)]
    single = [Record(r.u[: N + 100], r.y[: N + 100], FS_HZ, N, 100) for r in records]
    found = total_variance(single)
    assert found.n_realisations.max() == 4
    inside = slice(5, -5)  # no neighbours beyond the ends
    error = np.abs(found.g - 1 / (1 + 1j * found.f_hz / 40.0)) ** 2 / found.var_total
    assert 0.3 < np.mean(error[inside]) < 2


def test_no_line_in_the_band(rng):
    with pytest.raises(InputError, match="no line within 400:450 Hz is excited"):
        total_variance(record(rng, odd_lines(rng)), band=(400, 450))
