"""The 95 % in the pictures is 95 %: coverage by simulation, inside the binomial interval of its own size."""

import numpy as np
import pytest
from scipy.stats import binom, f

from gsid.models.confidence import (
    complex_bound,
    confidence_ellipse,
    excess_bands,
    gain_phase_band,
    root_quantities,
    unwrapped_phase_deg,
)

N_TRIALS = 20000


def complex_noise(rng, shape, sigma=1.0):
    """Circular noise with E|e|^2 = sigma^2."""
    return sigma * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)


def assert_covers(inside, seed, level=0.95):
    """A correct interval fails this once in 10 000 seeds."""
    low, high = binom.interval(0.9999, len(inside), level)
    assert low <= inside.sum() <= high, f"{inside.mean():.4f} inside, seed {seed}"


@pytest.mark.parametrize("seed", [1, 2])
def test_bound_of_complex_noise(seed):
    noise = complex_noise(np.random.default_rng(seed), N_TRIALS, 0.3)
    assert_covers(np.abs(noise) <= complex_bound(0.3), seed)


@pytest.mark.parametrize("n_periods", [2, 3, 8, 75])
def test_bound_with_a_sample_variance(n_periods):
    seed = 10 + n_periods
    periods = complex_noise(np.random.default_rng(seed), (N_TRIALS, n_periods))
    variance_of_mean = np.var(periods, axis=1, ddof=1) / n_periods
    bound = complex_bound(np.sqrt(variance_of_mean), n_dof=n_periods - 1)
    assert_covers(np.abs(periods.mean(axis=1)) <= bound, seed)


@pytest.mark.parametrize("n_dof", [1, 2, 7, 74, 10000])
def test_bound_is_the_quantile_of_f(n_dof):
    assert complex_bound(1.0, n_dof=n_dof) ** 2 == pytest.approx(f.ppf(0.95, 2, 2 * n_dof), rel=1e-9)


def test_bound_of_known_sigma_is_the_limit():
    assert complex_bound(1.0) == pytest.approx(np.sqrt(-np.log(0.05)), rel=1e-12)
    assert complex_bound(1.0, n_dof=10**7) == pytest.approx(complex_bound(1.0), rel=1e-6)


def test_bound_refuses_no_degrees_of_freedom():
    with pytest.raises(ValueError, match="n_dof"):
        complex_bound(1.0, n_dof=0)


def test_gain_and_phase_bands_cover():
    seed, g, sigma = 5, 2.0 * np.exp(2.9j), 0.05
    measured = g + complex_noise(np.random.default_rng(seed), N_TRIALS, sigma)
    low, high, phase = gain_phase_band(measured, np.full(N_TRIALS, sigma))
    true_db = 20.0 * np.log10(abs(g))
    assert_covers((low <= true_db) & (true_db <= high), seed)
    assert_covers(np.abs(np.degrees(np.angle(measured / g))) <= phase, seed)


def test_band_of_a_line_below_the_noise_is_open():
    low, high, phase = gain_phase_band(np.array([0.1 + 0j, 0j]), np.array([1.0, 1.0]))
    assert np.all(phase == 180.0)
    assert np.all(np.isfinite(low))
    assert np.all(low < high)


def inside(ellipse, center, points):
    """In a convex outline: on the same side of all its edges."""
    edge, spoke = np.diff(ellipse), points[:, None] - ellipse[:-1]
    side = np.sign((np.conj(edge) * spoke).imag)
    return np.all(side == np.sign((np.conj(edge) * (center - ellipse[:-1])).imag), axis=1)


def test_ellipse_holds_95_percent():
    seed, root = 6, -1.0 + 20.0j
    cov = np.array([[0.04, 0.05], [0.05, 0.09]])
    real, imag = np.random.default_rng(seed).multivariate_normal([root.real, root.imag], cov, N_TRIALS).T
    # 1441 corners: the polygon misses 3e-6 of the ellipse's area
    assert_covers(inside(confidence_ellipse(root, cov, 1441), root, real + 1j * imag), seed)


def test_region_of_a_real_root_is_an_interval():
    region = confidence_ellipse(-3.0 + 0j, np.array([[0.25, 0.0], [0.0, 0.0]]))
    assert np.all(region.imag == 0.0)
    assert region.real.min() == pytest.approx(-3.0 - 1.96 * 0.5, rel=1e-4)
    assert region.real.max() == pytest.approx(-3.0 + 1.96 * 0.5, rel=1e-4)


@pytest.mark.parametrize("spacing", ["linear", "log"])
@pytest.mark.parametrize("delay_s", [0.0, 0.0054, 0.012])
def test_phase_of_an_axis_with_delay(delay_s, spacing):
    line = np.arange(1, 501) if spacing == "linear" else np.unique(np.round(np.geomspace(1, 500, 80)))
    f_hz = 0.5 * line
    s = 2j * np.pi * f_hz
    g = (s + 11.0) / (s * s + 11.0 * s + 170.0)
    expected = np.degrees(np.angle(s + 11.0) - np.angle(s * s + 11.0 * s + 170.0)) - 360.0 * f_hz * delay_s
    assert unwrapped_phase_deg(f_hz, g * np.exp(-s * delay_s)) == pytest.approx(expected, abs=1e-6)


def test_phase_passes_through_a_band_of_noise():
    rng = np.random.default_rng(8)
    f_hz = np.arange(0.5, 250.5, 0.5)
    g = np.exp(-2j * np.pi * f_hz * 0.0054)
    sigma = np.full(len(f_hz), 1e-3)
    drowned = (f_hz > 100.0) & (f_hz < 140.0)
    g[drowned] = complex_noise(rng, drowned.sum())
    sigma[drowned] = 1.0
    phase = unwrapped_phase_deg(f_hz, g, sigma)
    assert phase[~drowned] == pytest.approx(-360.0 * 0.0054 * f_hz[~drowned], abs=1e-6)


def test_phase_of_a_double_integrator_starts_at_minus_180():
    f_hz = np.arange(1.0, 50.0)
    for turn in (-1e-3, 1e-3):  # noise on either side of the negative real axis
        assert unwrapped_phase_deg(f_hz, -np.exp(1j * turn) / f_hz**2) == pytest.approx(-180.0, abs=0.1)


def test_excess_is_found_and_noise_is_not():
    seed, n_runs = 9, 300
    rng = np.random.default_rng(seed)
    f_hz = np.arange(1.0, 501.0)
    alarms = sum(bool(excess_bands(f_hz, rng.random(500) < 0.05)) for _ in range(n_runs))
    assert alarms <= binom.ppf(0.9999, n_runs, 0.01), f"{alarms} alarms, seed {seed}"
    exceeds = np.zeros(500, dtype=bool)
    exceeds[100:120] = True
    assert excess_bands(f_hz, exceeds) == [(101.0, 120.0)]
    assert excess_bands(f_hz[:0], exceeds[:0]) == []
    assert excess_bands(f_hz[:3], np.array([True, True, True])) == [(1.0, 3.0)]


def test_frequency_and_damping_of_a_root():
    seed, root = 12, complex(-3.0, 40.0)
    cov = np.array([[0.01, 0.004], [0.004, 0.02]])
    f_hz, zeta, std_f, std_zeta = root_quantities(root, cov)
    assert f_hz == pytest.approx(abs(root) / 2.0 / np.pi)
    assert zeta == pytest.approx(3.0 / abs(root))
    parts = np.random.default_rng(seed).multivariate_normal([root.real, root.imag], cov, N_TRIALS)
    draws = parts @ [1.0, 1.0j]
    # 20 000 draws give a standard deviation to 0.5 %; five of those, and the terms of second order
    assert std_f == pytest.approx(np.std(np.abs(draws)) / 2.0 / np.pi, rel=0.03)
    assert std_zeta == pytest.approx(np.std(-draws.real / np.abs(draws)), rel=0.03)


def test_a_root_in_z_is_the_same_root():
    fs_hz, root = 1000.0, complex(-3.0, 40.0)
    cov = np.array([[0.01, 0.004], [0.004, 0.02]])
    slope = np.exp(root / fs_hz) / fs_hz
    turn = np.array([[slope.real, -slope.imag], [slope.imag, slope.real]])
    in_z = root_quantities(np.exp(root / fs_hz), turn @ cov @ turn.T, domain="z", fs_hz=fs_hz)
    assert in_z == pytest.approx(root_quantities(root, cov), rel=1e-9)
