"""The response to random noise by windows: scipy's estimate, an honest variance, a warning."""

import logging

import numpy as np
import pytest
from scipy.signal import coherence, csd, freqz, lfilter, welch

from gsid.base.errors import InputError, NotPeriodicError
from gsid.fitting.rational import fit
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.spectrum.realisation import spectra

FS_HZ, WINDOW = 1000.0, 512
B, A = [0, 0.1], [1, -0.9]


def random_record(seed, n=32768, noise=0.3, **facts):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(n)
    return Record(u, lfilter(B, A, u) + noise * rng.standard_normal(n), FS_HZ, **facts)


def test_it_is_scipys_estimate_at_every_line():
    record = random_record(1)
    response = frf(record, window=WINDOW)
    how = {"fs": FS_HZ, "window": "hann", "nperseg": WINDOW, "detrend": "constant"}
    f_hz, cross = csd(record.u, record.y, **how)
    _, power = welch(record.u, **how)
    line = np.arange(2, WINDOW // 2)
    np.testing.assert_array_equal(response.line, line)
    np.testing.assert_allclose(response.f_hz, f_hz[line])
    np.testing.assert_allclose(response.g, (cross / power)[line], rtol=1e-10)
    # the coherence of the sums; the variance's degrees of freedom are 5 % fewer, as the windows overlap
    np.testing.assert_allclose(response.coherence, coherence(record.u, record.y, **how)[1][line], rtol=1e-6)
    assert (response.method, response.n_periods, response.period_samples) == ("windows", 127, WINDOW)


def test_its_variance_is_that_of_the_error():
    """|g - truth|^2 / var_g is F(2, 2 n_dof), of mean n_dof / (n_dof - 1), over seeds and lines."""
    ratios = []
    for seed in range(40):
        response = frf(random_record(seed, n=16384), window=WINDOW)
        truth = freqz(B, A, response.f_hz, fs=FS_HZ)[1]
        ratios.append(np.abs(response.g - truth) ** 2 / response.var_g)
    far = response.f_hz > 30  # below, the response changes within a few lines: leakage
    ratios = np.array(ratios)[:, far]
    outside = np.mean(ratios > response.n_dof * (0.05 ** (-1 / response.n_dof) - 1))
    print(f"mean {ratios.mean():.3f}, outside of 95 %: {outside:.3f}")
    # neighbouring lines of a Hann window share half of their noise: 40 x 120 independent values
    assert ratios.mean() == pytest.approx(response.n_dof / (response.n_dof - 1), abs=4 / np.sqrt(4800))
    assert outside == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 4800))


def test_an_input_that_does_not_repeat_is_windowed_with_a_warning(caplog):
    response = frf(random_record(2, name="random.csv"))
    assert response.period_samples == 4096  # the largest power of two of which the record holds 8
    assert caplog.records[-1].levelno == logging.WARNING
    assert "random.csv: averaging over 15 Hann windows of 4096 samples" in caplog.text
    truth = freqz(B, A, response.f_hz, fs=FS_HZ)[1]
    assert np.mean(np.abs(response.g - truth) ** 2 / response.var_g) == pytest.approx(14 / 13, abs=0.3)
    short = random_record(2, n=500)
    with pytest.raises(NotPeriodicError, match="not periodic"):
        frf(short)
    frf(short, window=100)  # when asked


def test_windows_do_not_replace_requested_periods():
    """Merging was forgotten without a word, and Spectra beside such a record ended in an AttributeError."""
    first = random_record(2)
    periodic = Record(np.resize(first.u[:4096], 32768), np.resize(first.y[:4096], 32768), FS_HZ, 4096, 0)
    with pytest.raises(NotPeriodicError, match="not periodic"):
        frf([first, random_record(3)], merge=True)
    with pytest.raises(NotPeriodicError, match="not periodic"):
        frf([spectra(periodic), random_record(3)])


def test_records_are_averaged_by_their_windows():
    records = [random_record(seed, n=n) for seed, n in ((3, 8192), (4, 16384))]
    both = frf(records, window=WINDOW)
    sums = []
    for record in records:
        how = {"fs": FS_HZ, "nperseg": WINDOW, "detrend": "constant"}
        sums.append((csd(record.u, record.y, **how)[1], welch(record.u, **how)[1]))
    weights = [31, 63]
    cross, power = (sum(w * one[i] for w, one in zip(weights, sums, strict=True)) for i in (0, 1))
    np.testing.assert_allclose(both.g, (cross / power)[both.line], rtol=1e-10)
    assert (both.n_periods, both.n_realisations) == (94, 2)


def test_samples_discarded_first():
    record = random_record(5, settle_samples=1000)
    later = Record(record.u[2000:], record.y[2000:], FS_HZ)
    response = frf(record, window=WINDOW, settle=2000)
    assert response.settle_samples == 2000
    np.testing.assert_array_equal(response.g, frf(later, window=WINDOW).g)
    assert frf(record, window=WINDOW).settle_samples == 1000


def test_windows_with_lost_samples_are_left_out():
    valid = np.ones(32768, bool)
    valid[5000] = False
    record = random_record(5, valid=valid)
    record.y[5000] = 1e6
    response = frf(record, window=WINDOW)
    assert (response.n_periods, response.n_spoiled) == (125, 2)
    assert np.abs(response.g).max() < 1.5


def test_lines_without_input_are_left_out_and_reported(caplog):
    record = random_record(6)
    slow = np.convolve(record.u, np.hanning(51) / 25, "same")  # nothing above 80 Hz
    record = Record(slow, lfilter(B, A, slow), FS_HZ)
    response = frf(record, window=WINDOW)
    assert response.f_hz.max() < 100
    assert response.rejected_hz.max() == pytest.approx(FS_HZ / 2, abs=3)
    assert len(response.rejected_hz) + len(response.f_hz) == WINDOW // 2 - 2
    assert f"too weak: {len(response.rejected_hz)} (" in caplog.text


def test_a_model_can_be_fitted_to_it():
    model = fit(frf(random_record(7, noise=0.05), window=2048, band=(2, 200)), "1/0", delay="free")
    assert abs(model.poles[0] + 0.1054 * FS_HZ) < 5  # exp(-0.1054) is 0.9


def test_refusals():
    with pytest.raises(InputError, match="too few windows"):
        frf(random_record(8, n=600), window=WINDOW)
    with pytest.raises(InputError, match="no line is excited"):
        frf(random_record(8), window=WINDOW, band=(0.1, 0.2))
    for window in (0, 3):  # ended in an IndexError
        with pytest.raises(ValueError, match="at least 4 samples"):
            frf(random_record(8), window=window)
    with pytest.raises(ValueError, match="exclude each other"):
        frf(random_record(8), window=WINDOW, lpm=True)
    with pytest.raises(InputError, match="differ in y_unit"):
        frf([random_record(8), random_record(8, y_unit="m")], window=WINDOW)
