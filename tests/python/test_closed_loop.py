"""The indirect method on a simulated closed loop with known truth, where input and output alone mislead."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from gsid.base.errors import InputError
from gsid.fitting.rational import fit
from gsid.records.record import Record
from gsid.response.closed_loop import closed_loop_frf
from gsid.response.estimate import frf
from gsid.spectrum.realisation import spectra

SEED = 20260401
FS_HZ, N, LINES = 1000.0, 400, np.arange(1, 80, 2)
# In z^-1: a plant with a resonance at 62 Hz and two samples of delay, and a PI controller. The closed loop's
# slowest pole, 0.939, decays by 1e-11 in one period.
NUM, DEN = np.array([0, 0, 0.06, 0.05]), np.array([1, -1.6, 0.75])
C_NUM, C_DEN = np.array([0.5, -0.4]), np.array([1, -1.0])


def plant(f_hz):
    return signal.freqz(NUM, DEN, f_hz, fs=FS_HZ)[1]


def controller(f_hz):
    return signal.freqz(C_NUM, C_DEN, f_hz, fs=FS_HZ)[1]


def loop(rng, periods, noise, settle=3):
    """Record of the loop in steady state: y = G u + v, u = C (r - y), v white noise through a low-pass."""
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[LINES] = np.exp(2j * np.pi * rng.random(len(LINES))) * N / 2
    r = np.tile(np.fft.irfft(spectrum), settle + periods)
    v = noise * signal.lfilter([1.0], [1, -0.9], rng.standard_normal(len(r)))
    a = np.convolve(DEN, C_DEN)
    gc = np.convolve(NUM, C_NUM)
    full = np.zeros(max(len(a), len(gc)))
    full[: len(a)] += a
    full[: len(gc)] += gc
    y = signal.lfilter(gc, full, r) + signal.lfilter(a, full, v)
    u = signal.lfilter(np.convolve(C_NUM, DEN), full, r - v)
    return Record(u, y, FS_HZ, N, settle * N, hold="none", name="loop", columns={"r": r})


def chi_square(response, truth):
    """Sum of squared errors over their variance, in standard deviations from what noise alone gives.

    A line's |error|^2 over a sample variance of nu degrees of freedom is F(2, 2 nu).
    """
    nu = response.n_periods - response.n_realisations
    z = np.abs(response.g - truth) ** 2 / response.var_g
    mean, var = stats.f.stats(2, 2 * nu)
    return (z.sum() - len(z) * mean) / np.sqrt(len(z) * var)


def test_input_and_output_alone_lean_towards_the_controller():
    """Cross spectra of u and y are biased by far more than their scatter; through r nothing is."""
    rng = np.random.default_rng(SEED)
    record = loop(rng, 400, 2.0)
    f, s_uy = signal.csd(record.u[1200:], record.y[1200:], FS_HZ, "boxcar", N, 0, detrend=False)
    s_uu = signal.welch(record.u[1200:], FS_HZ, "boxcar", N, 0, detrend=False)[1]
    direct, truth = (s_uy / s_uu)[LINES], plant(f[LINES])
    through_r = frf(record, reference="r")
    np.testing.assert_array_equal(through_r.line, LINES)
    off, direct_off = chi_square(through_r, truth), chi_square(replace(through_r, g=direct), truth)
    # the figures of docs/explanation/estimators.md
    print(f"off by {off:.2g} standard deviations, the direct estimate by {direct_off:.3g}")
    assert abs(off) < 3.3  # 99.9 % of a normal variable
    assert direct_off > 50
    # by the share of noise in the input, towards -1/C
    towards = -1 / controller(f[LINES]) - truth
    share = np.vdot(towards, direct - truth).real / np.vdot(towards, towards).real
    assert share > 0.05


def test_realisations_are_added_before_they_are_divided():
    """In no single record does u stand out of the noise that comes back through the loop."""
    rng = np.random.default_rng(SEED)
    records = [loop(rng, 2, 2.0) for _ in range(100)]
    with pytest.raises(InputError, match="u does not repeat"):
        frf(records[0])
    through_r = frf(records, reference="r")
    assert (through_r.n_realisations, through_r.n_periods) == (100, 200)
    assert abs(chi_square(through_r, plant(through_r.f_hz))) < 3.3


def test_one_realisation_is_the_ratio_of_its_means():
    record = loop(np.random.default_rng(SEED), 6, 0.05)
    through_r, direct = frf(record, reference="r"), frf(record)
    np.testing.assert_array_equal(through_r.line, direct.line)
    np.testing.assert_allclose(through_r.g, direct.g, rtol=1e-9)
    np.testing.assert_allclose(through_r.var_g, direct.var_g, rtol=1e-6)
    again = (through_r.var_y + abs(through_r.g) ** 2 * through_r.var_u) / abs(through_r.u) ** 2
    again -= 2 * np.real(through_r.cov_yu * through_r.g.conj()) / abs(through_r.u) ** 2
    np.testing.assert_allclose(through_r.var_g, again / 6, rtol=1e-6)


@pytest.mark.parametrize("method", ["ml", "ml-io"])
def test_the_parametric_fit_is_right_within_its_covariance(method):
    """(x - truth)' cov^-1 (x - truth) is chi-square of 4; 99.9 % bound."""
    rng = np.random.default_rng(SEED)
    response = frf([loop(rng, 12, 0.3) for _ in range(4)], reference="r")
    model = fit(response, "2/1", domain="z", delay=2 / FS_HZ, method=method)
    x = np.concatenate([model.den[1:], model.num]) - np.concatenate([DEN[1:], NUM[2:]])
    assert x @ np.linalg.solve(model.cov, x) < stats.chi2.ppf(0.999, 4)
    assert model.cost == pytest.approx(model.cost_expected, abs=3.3 * np.sqrt(len(LINES)) * 1.1)
    free = fit(response, "2/1", domain="z", method=method)
    assert abs(free.delay_s - 2 / FS_HZ) < 3.3 * free.std_delay_s


def test_lines_below_the_noise_of_the_input_are_reported(caplog):
    """They were left out in silence."""
    record = loop(np.random.default_rng(SEED), 4, 0.05)
    assert len(frf(record, reference="r").rejected_hz) == 0
    rows = np.fft.rfft(record.u.reshape(-1, N), axis=1)
    silent = LINES[10:15]
    rows[:, silent] = 0
    quiet = replace(record, u=np.fft.irfft(rows, N, axis=1).ravel())
    response = frf(quiet, reference="r")
    np.testing.assert_allclose(response.rejected_hz, silent * FS_HZ / N)
    np.testing.assert_allclose(response.f_hz, np.delete(LINES, np.s_[10:15]) * FS_HZ / N)
    assert "left out because their input is too weak: 5 (52.5, 57.5, 62.5, 67.5, 72.5 Hz)" in caplog.text
    np.testing.assert_allclose(frf(quiet, reference="r", band=(70, 200)).rejected_hz, [72.5])


def test_missing_reference_and_response_are_reported():
    record = loop(np.random.default_rng(SEED), 4, 0.05)
    with pytest.raises(InputError, match="no column named ref"):
        frf(record, reference="ref")
    with pytest.raises(InputError, match="does not exceed its noise"):
        frf(replace(record, u=np.random.default_rng(1).standard_normal(len(record))), reference="r")
    with pytest.raises(InputError, match="loop with w for u"):
        frf(
            replace(record, columns={"w": np.random.default_rng(1).standard_normal(len(record))}),
            reference="w",
        )
    broken = record.columns["r"].copy()
    broken[7] = np.nan
    with pytest.raises(InputError, match="not finite"):
        frf(replace(record, columns={"r": broken}), reference="r")
    valid = np.ones(len(record), bool)
    valid[7] = False
    assert frf(replace(record, columns={"r": broken}, valid=valid), reference="r").n_periods == 4
    with pytest.raises(ValueError, match="no record"):
        closed_loop_frf([], "r")
    for what in (spectra(record), [record, spectra(record)]):  # ended in a TypeError
        with pytest.raises(ValueError, match="not their spectra"):
            frf(what, reference="r")
