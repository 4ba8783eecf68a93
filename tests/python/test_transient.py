"""Transient signals: their spectra in closed form, and a measurement with one that has no leakage."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from gsid.excitation.transient import Transient
from gsid.records.record import Record
from gsid.response.estimate import frf

FS_HZ, N = 1000.0, 2000
BAND = (1.0, 100.0)


def lines_of(signal):
    """Amplitudes of the lines of one period."""
    return np.abs(np.fft.rfft(signal.table())) * 2 / N


def test_an_impulse_has_all_lines_alike():
    signal = Transient.design(FS_HZ, N, BAND, kind="impulse", amplitude=3.0)
    np.testing.assert_allclose(lines_of(signal), 3.0 * 2 / N)
    assert signal.p_int_over_p_tot == pytest.approx(len(signal.line) / (N / 2), rel=0.01)


def test_a_pulse_has_the_spectrum_of_dirichlet():
    signal = Transient.design(FS_HZ, N, BAND, kind="pulse", length_s=0.03, amplitude=2.0)
    k = np.arange(1, N // 2)
    expected = 2.0 * np.abs(np.sin(np.pi * k * 30 / N) / np.sin(np.pi * k / N)) * 2 / N
    np.testing.assert_allclose(lines_of(signal)[1:-1], expected, atol=1e-12)


def test_doublets_are_four_steps_of_3_2_1_1():
    signal = Transient.design(FS_HZ, N, BAND, kind="3-2-1-1", length_s=0.07, amplitude=5.0)
    expected = np.concatenate([[5.0] * 30, [-5.0] * 20, [5.0] * 10, [-5.0] * 10, np.zeros(N - 70)])
    np.testing.assert_array_equal(signal.table(), expected)
    assert Transient.design(FS_HZ, N, BAND, kind="3-2-1-1").n_samples == 7 * 5  # half a cycle of 100 Hz


def test_a_burst_is_zero_after_its_part_and_drawn_by_its_seed():
    signal = Transient.design(FS_HZ, N, BAND, amplitude=4.0, seed=7)
    u = signal.table()
    assert np.count_nonzero(u[:1000]) == 1000
    assert not u[1000:].any()
    assert np.abs(u).max() == 4.0
    assert abs(u[:1000].mean()) < 4 * u[:1000].std() / np.sqrt(1000)
    np.testing.assert_array_equal(u, Transient.design(FS_HZ, N, BAND, amplitude=4.0, seed=7).table())
    assert (u != Transient.design(FS_HZ, N, BAND, amplitude=4.0, seed=8).table()).any()


@pytest.mark.parametrize("kind", ["random-burst", "impulse", "pulse", "3-2-1-1"])
def test_a_response_that_has_decayed_has_no_leakage(kind):
    """A damped second-order filter: each period alone, with zero state before it, gives the true response."""
    b, a = [0.0, 0.2, 0.1], [1.0, -1.6, 0.68]  # decays with 0.82 per sample
    u = Transient.design(FS_HZ, N, BAND, kind=kind).table()
    record = Record(np.tile(u, 3), lfilter(b, a, np.tile(u, 3)), FS_HZ, N, 0)
    found = frf(record, band=BAND)
    expected = freqz(b, a, found.f_hz, fs=FS_HZ)[1]
    np.testing.assert_allclose(found.g, expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"kind": "step"}, "kind"),
        ({"kind": "impulse", "length_s": 0.1}, "one sample"),
        ({"kind": "pulse", "length_s": 2.0}, "no zero input"),
        ({"kind": "pulse", "length_s": -1.0}, "positive"),
        ({"amplitude": 0.0}, "amplitude"),
    ],
)
def test_what_cannot_be_made_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        Transient.design(FS_HZ, N, BAND, **options)


def test_scaled_to_a_peak():
    signal = Transient.design(FS_HZ, N, BAND, kind="3-2-1-1", amplitude=2.0)
    np.testing.assert_array_equal(signal.scaled(3.0).table(), 3.0 * signal.table())
    assert "3-2-1-1" in repr(signal)
