"""Equations of the thesis without another test, by numpy and scipy (docs/reference/thesis.md)."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import chirp, lsim

from gsid.excitation.generators import Sweep
from gsid.excitation.multisine import Multisine
from gsid.fitting.rational import fit
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.estimate_distortion import distortion
from gsid.response.frf import Frf

FS_HZ, N = 600.0, 600
TRUTH = RationalModel([40.0, 900.0], [1.0, 30.0, 2000.0], 0.0042)
F_HZ = np.arange(1.0, 121.0)


# ---------------------------------------------------------------- chapter 3


def test_eq_3_2_the_transform_and_its_inverse():
    """The lines of a record are the analysis equation over N, twice; the synthesis gives the signal again."""
    rng = np.random.default_rng(1)
    u = Multisine.design(FS_HZ, N, (1, 250), phases="random").table()
    y = np.roll(u, 7) + np.roll(u, 30) ** 2
    record = Record(np.tile(u, 3), np.tile(y, 3) + 1e-9 * rng.standard_normal(3 * N), FS_HZ, N, 0)
    measured = frf(record)
    n = np.arange(N)
    for k, line in list(zip(measured.f_hz.astype(int), measured.y, strict=True))[::40]:
        analysis = np.sum(y * np.exp(-2j * np.pi * k * n / N))
        assert line == pytest.approx(2 / N * analysis, abs=1e-8)  # the noise of 1e-9
    whole = np.zeros(N, complex)
    whole[measured.f_hz.astype(int)] = measured.u * N / 2
    whole[-measured.f_hz.astype(int)] = np.conj(measured.u) * N / 2
    synthesis = [np.sum(whole * np.exp(2j * np.pi * np.arange(N) * i / N)) / N for i in range(0, N, 60)]
    np.testing.assert_allclose(synthesis, u[::60], atol=1e-9)


def test_eq_3_3_a_period_is_any_period():
    """A measurement that begins anywhere in the signal has the same response."""
    u = Multisine.design(FS_HZ, N, (1, 250)).table()
    y = np.roll(u, 11)
    first, later = (
        frf(Record(np.tile(u, 4)[at : at + 3 * N], np.tile(y, 4)[at : at + 3 * N], FS_HZ, N, 0))
        for at in (0, 137)
    )
    np.testing.assert_allclose(later.g, first.g, atol=1e-12)


def test_eq_3_6_linear_sweep_is_scipys():
    sweep = Sweep.design(FS_HZ, N, (2, 100), kind="linear", amplitude=3, phase_rad=0.3, continuous=False)
    t = np.arange(N) / FS_HZ
    want = 3 * chirp(t, 2, N / FS_HZ, 100, "linear", phi=np.degrees(0.3) - 90)  # its phase is a cosine's
    np.testing.assert_allclose(sweep.table(), want, atol=1e-9)


# ---------------------------------------------------------------- chapter 5


def test_eq_5_7_normalised_random_phases():
    """F^(-1/2) sum of 2 |A| cos has the rms of sqrt(2) |A| for any F, and phases whose mean is 0."""
    t = np.arange(N) / FS_HZ
    for n_lines in (20, 200):
        size = 2 * 0.7 / np.sqrt(n_lines)
        m = Multisine.design(FS_HZ, N, (1, n_lines), phases="random", seed=4, amplitude=size)
        want = size * np.cos(2 * np.pi * np.outer(t, m.f_hz) + m.phase_rad).sum(axis=1)
        np.testing.assert_allclose(m.table(), want, atol=1e-11)
        assert m.rms == pytest.approx(np.sqrt(2) * 0.7)
    phases = [Multisine.design(FS_HZ, N, (1, 250), phases="random", seed=i).phase_rad for i in range(40)]
    mean = np.mean(np.exp(1j * np.array(phases)))
    assert abs(mean) < 4 / np.sqrt(40 * 250)  # four standard deviations, and each phase is independent


def cubic(u, c):
    """A static axis: its response is known exactly."""
    return u + c * u**3


def realisations(n, c, amplitude, noise, n_lines=60, periods=3):
    rng = np.random.default_rng(9)
    for seed in range(n):
        m = Multisine.design(FS_HZ, N, (1, n_lines), phases="random", seed=seed, amplitude=amplitude)
        y = np.tile(cubic(m.table(), c), periods)
        yield Record(np.tile(m.table(), periods), y + noise * rng.standard_normal(len(y)), FS_HZ, N, 0)


def test_eq_5_8_the_linear_part_dominates_at_small_inputs():
    """The distortion of a cubic falls with the square of the input, by 40 dB for 20 dB."""
    levels = []
    for amplitude in (0.1, 0.01):
        d = distortion(list(realisations(4, 0.2, amplitude, 1e-9)))
        levels.append(np.sqrt(np.mean(d.std_nonlinear**2)))
    assert 20 * np.log10(levels[0] / levels[1]) == pytest.approx(40, abs=0.01)  # rounding, and noise of 1e-9


def test_eqs_5_9_to_5_11_best_linear_approximation_of_a_cubic():
    """Of c u^3 the products l - l + k, those in phase with line k, give 1 + c A^2 (3 F/2 - 3/4) exactly.

    The rest, G_S, has the mean 0 over the phases: a mean of M realisations is off by its std over sqrt(M).
    """
    amplitude, c, n_lines, m = 0.2, 0.3, 60, 60
    d = distortion(list(realisations(m, c, amplitude, 1e-6, n_lines)))
    want = 1 + c * amplitude**2 * (1.5 * n_lines - 0.75)
    assert want > 1.5  # G_B is large here
    off = (d.bla - want) / np.sqrt(d.var_total)
    # A mean square over 60 lines that share their phases: within 4 standard deviations of 1.
    assert np.mean(np.abs(off) ** 2) == pytest.approx(1, abs=4 * np.sqrt(1 / n_lines) + 0.2)
    assert np.all(np.abs(off) < 5)


def test_eq_5_15_expected_variances():
    """Means over 100 measurements: noise over M P, and besides it the variance of G_S over M."""
    m, periods, noise, c, amplitude = 3, 4, 0.05, 0.3, 0.1
    rng = np.random.default_rng(5)
    total, of_noise, responses = [], [], []
    for i in range(100):
        records = []
        for seed in range(m * i, m * (i + 1)):
            u = Multisine.design(FS_HZ, N, (1, 60), phases="random", seed=seed, amplitude=amplitude).table()
            responses.append(np.fft.rfft(cubic(u, c))[1:61] / np.fft.rfft(u)[1:61])
            y = np.tile(cubic(u, c), periods) + noise * rng.standard_normal(periods * N)
            records.append(Record(np.tile(u, periods), y, FS_HZ, N, 0))
        d = distortion(records)
        total.append(np.mean(d.var_total))
        of_noise.append(np.mean(d.var_noise))
    per_period = 4 * noise**2 / N / amplitude**2  # white noise at a line of amplitude A
    distorted = np.mean(np.var(responses, axis=0, ddof=1))
    assert distorted > 0.3 * per_period / periods
    assert np.mean(of_noise) == pytest.approx(per_period / (m * periods), rel=0.02)
    # Variances of 3 realisations of 60 lines, 100 times: 0.9 %, and more as lines are related.
    assert np.mean(total) == pytest.approx(per_period / (m * periods) + distorted / m, rel=0.04)


# ---------------------------------------------------------------- chapter 6


def test_eq_6_1_in_steady_state_the_lines_of_the_output_are_g_times_those_of_the_input():
    """Solved by scipy over three periods: the last has no transient, which decays by exp(-15 t)."""
    t = np.arange(30 * N) / (10 * FS_HZ)
    u = np.cos(2 * np.pi * 3 * t) + 0.5 * np.sin(2 * np.pi * 17 * t)
    _, y, _ = lsim((TRUTH.num, TRUTH.den), u, t)
    lines = [np.fft.rfft(x[-10 * N :])[[3, 17]] for x in (u, y)]
    without_delay = RationalModel(TRUTH.num, TRUTH.den).response(np.array([3.0, 17.0]))
    np.testing.assert_allclose(lines[1] / lines[0], without_delay, rtol=1e-4)  # linear between 6000 samples/s


# ---------------------------------------------------------------- chapter 7


def measured(noise, seed=3):
    """A response with errors whose size differs from line to line, and an input that does."""
    rng = np.random.default_rng(seed)
    g = TRUTH.response(F_HZ)
    sigma = noise * np.abs(g).max() * (1 + 4 * (F_HZ > 40))
    errors = sigma / np.sqrt(2) * (rng.standard_normal(len(g)) + 1j * rng.standard_normal(len(g)))
    u = np.sqrt(100 / F_HZ).astype(complex)
    response = Frf.from_arrays(F_HZ, g + errors, sigma**2, fs_hz=FS_HZ)
    response.u[:], response.y[:] = u, (g + errors) * u
    return response


def test_eq_7_9_linear_least_squares_is_numpys():
    """Equation error with a_na = 1, real above imaginary part (eqs. 7.6 and 7.11), and a known delay."""
    response = measured(0.02)
    model = fit(response, "2/1", method="ls", delay=TRUTH.delay_s)
    s = 2j * np.pi * F_HZ
    g = response.g * np.exp(s * TRUTH.delay_s)
    scale = np.array([2000.0, 30.0, 900.0, 40.0])
    columns = np.stack([g, g * s, -np.ones(len(s)), -s], axis=1) * scale
    right = -g * s**2
    rows, want = (np.concatenate([x.real, x.imag]) for x in (columns, right))
    a0, a1, b0, b1 = np.linalg.lstsq(rows, want, rcond=None)[0] * scale
    np.testing.assert_allclose(model.den, [1, a1, a0], rtol=1e-6)
    np.testing.assert_allclose(model.num, [b1, b0], rtol=1e-6)


COSTS = {
    "nls-output": lambda r, g: (r.g - g) * np.abs(r.u),  # eq. 7.20
    "nls": lambda r, g: r.g - g,  # eq. 7.21
    "ga": lambda r, g: r.g - g,  # eq. 7.18
    "log": lambda r, g: np.log(r.g / g),  # eq. 7.23, the phases less than half a turn apart
    "ml": lambda r, g: (r.g - g) / np.sqrt(r.var_g),  # eq. 7.28
}


@pytest.mark.parametrize("method", COSTS)
def test_eqs_7_18_to_7_28_minima_are_scipys(method):
    """Each method's model costs as much, by its own cost, as what scipy finds from the truth."""
    response = measured(0.01)
    scale = np.array([30.0, 2000.0, 40.0, 900.0, 0.0042])

    def error(x):
        a1, a0, b1, b0, delay_s = x * scale
        s = 2j * np.pi * F_HZ
        e = COSTS[method](response, (b1 * s + b0) / (s**2 + a1 * s + a0) * np.exp(-s * delay_s))
        return np.concatenate([e.real, e.imag])

    best = least_squares(error, np.ones(5), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    model = fit(response, "2/1", method=method)
    found = np.concatenate([model.den[1:], model.num, [model.delay_s]]) / scale
    # The search by evolution ends with a local one; all stop where a step changes the cost by less than this.
    assert np.sum(error(found) ** 2) == pytest.approx(2 * best.cost, rel=1e-5)
