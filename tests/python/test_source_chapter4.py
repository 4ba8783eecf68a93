"""The source's chapter 4, equation by equation: averages in time and in frequency, and (co)variances.

M of the source is the number of periods, 1/sqrt(M) its noise.
"""

import numpy as np
import pytest
from scipy.signal import lfilter

from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.streaming import StreamingFrf
from gsid.spectrum.realisation import spectra

FS_HZ, N, M = 1000.0, 400, 25
B, A = [0, 0.4], [1, -0.6]


def measured(seed, n_periods=M, noise_u=0.02, noise_y=0.1):
    """Steady state of a first-order axis with noise in input and output, and the part of it they share."""
    rng = np.random.default_rng(seed)
    m = Multisine.design(FS_HZ, N, (2.5, 200), phases="random", seed=3)
    u = np.tile(m.table(), n_periods + 1)
    y = lfilter(B, A, u)[N:]
    u = u[N:]
    common = rng.standard_normal(len(u))
    return Record(
        u + noise_u * (rng.standard_normal(len(u)) + common),
        y + noise_y * (rng.standard_normal(len(u)) - 0.5 * common),
        FS_HZ,
        N,
        0,
    )


def true_response(line):
    z = np.exp(-2j * np.pi * line / N)
    return 0.4 * z / (1 - 0.6 * z)


def dft(x):
    """Eq. 3.2 in the normalisation of FRF-1, written as the matrix that it is."""
    k, n = np.arange(1, N // 2)[:, None], np.arange(N)[None]
    return 2 / N * np.exp(-2j * np.pi * (k * n % N) / N) @ x


@pytest.fixture(scope="module")
def record():
    return measured(1)


@pytest.fixture(scope="module")
def each(record):
    """Eq. 4.9: U[l], Y[l] of every period, (M, K)."""
    return [np.array([dft(x[p * N : (p + 1) * N]) for p in range(M)]) for x in (record.u, record.y)]


def test_eqs_4_4_to_4_6_averaging_in_time(record):
    u_mean = sum(record.u[p * N : (p + 1) * N] for p in range(M)) / M
    y_mean = sum(record.y[p * N : (p + 1) * N] for p in range(M)) / M
    response = frf(record)
    expected = (dft(y_mean) / dft(u_mean))[response.line - 1]
    np.testing.assert_allclose(response.g, expected, rtol=1e-11)


def test_eq_4_8_the_error_falls_as_one_over_the_root_of_the_periods():
    """And eq. 4.7: to nothing. The input's noise is uncorrelated here, its bias second order."""
    few, many = 5, 125
    rms = []
    for n_periods in (few, many):
        errors = []
        for seed in range(20):
            response = frf(measured(seed, n_periods))
            errors.append(response.g - true_response(response.line))
        rms.append(np.sqrt(np.mean(np.abs(errors) ** 2)))
    # 20 x 80 complex errors: each rms is known to 1.3 %
    assert rms[0] / rms[1] == pytest.approx(np.sqrt(many / few), rel=0.06)


def test_eq_4_9_transform_of_each_period(record, each):
    s = spectra(record)
    for lines, expected in zip((s.U, s.Y), each, strict=True):
        np.testing.assert_allclose(lines[:, 1 : N // 2], expected, atol=1e-13)


def test_eq_4_10_means_and_their_quotient(record, each):
    U, Y = (x.mean(axis=0) for x in each)
    s, response = spectra(record), frf(record)
    np.testing.assert_allclose(s.u[1 : N // 2], U, atol=1e-13)
    np.testing.assert_allclose(s.y[1 : N // 2], Y, atol=1e-13)
    at = response.line - 1
    np.testing.assert_allclose(response.g, Y[at] / U[at], rtol=1e-11)


@pytest.mark.parametrize("way", ["whole record", "streaming"])
def test_eq_4_11_variances_and_covariance(record, each, way):
    """The covariance with the conjugate of the input's deviation, which the source's print has lost."""
    U, Y = each
    dU, dY = U - U.mean(axis=0), Y - Y.mean(axis=0)
    response = frf(record)
    if way == "streaming":
        streaming = StreamingFrf(FS_HZ, N, response.line)
        streaming.step(record.u, record.y)
        response = streaming.result()
    at = response.line - 1
    np.testing.assert_allclose(response.var_u, (np.abs(dU) ** 2).sum(axis=0)[at] / (M - 1), rtol=1e-9)
    np.testing.assert_allclose(response.var_y, (np.abs(dY) ** 2).sum(axis=0)[at] / (M - 1), rtol=1e-9)
    np.testing.assert_allclose(response.cov_yu, (dY * dU.conj()).sum(axis=0)[at] / (M - 1), atol=1e-16)


def test_eq_4_11_is_the_noise_that_was_put_in():
    """White noise of variance s2 has 4 s2/N on a line; the common part is the covariance."""
    response = frf(measured(2, 200))
    line_variance = 4 / N
    # 80 lines of 199 degrees of freedom each: 0.8 % of scatter
    assert response.var_u.mean() == pytest.approx(line_variance * 0.02**2 * 2, rel=0.04)
    assert response.var_y.mean() == pytest.approx(line_variance * 0.1**2 * 1.25, rel=0.04)
    assert response.cov_yu.mean() == pytest.approx(-line_variance * 0.1 * 0.02 * 0.5, rel=0.06)


def test_eq_4_12_scatter_of_the_responses_of_single_periods(each):
    """With an input known exactly it is the variance of eq. 7.29; with 40 dB of noise in it, nearly."""
    for noise_u, tolerance in ((0.0, 1e-9), (0.01, 0.02)):
        record = measured(4, noise_u=noise_u)
        response = frf(record)
        U, Y = (
            np.array([dft(x[p * N : (p + 1) * N]) for p in range(M)])[:, response.line - 1]
            for x in (record.u, record.y)
        )
        variance = (np.abs(Y / U - response.g) ** 2).sum(axis=0) / (M - 1)
        np.testing.assert_allclose(response.var_g * M, variance, rtol=tolerance)
