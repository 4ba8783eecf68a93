"""The local polynomial method: a resonant axis from rest against its exact response, and its variance."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.response.estimate import frf

FS_HZ, N = 1000.0, 2000
POLE = np.exp(-0.02 * 0.377) * np.exp(1j * 0.377)  # 60 Hz, damping 0.02: five lines wide
B, A = [0, 0.02, 0.01], np.real(np.poly([POLE, POLE.conj()]))
N_DOF = 9


def from_rest(seed, n_periods, noise=0.0, *, grid="full", phases="random", noise_u=0.0, **facts):
    m = Multisine.design(FS_HZ, N, (2, 200), grid=grid, phases=phases, seed=seed)
    u = np.tile(m.table(), n_periods)
    rng = np.random.default_rng(seed)
    y = lfilter(B, A, u) + noise * rng.standard_normal(len(u))
    return Record(u + noise_u * rng.standard_normal(len(u)), y, FS_HZ, N, **facts)


def true_response(f_hz):
    return freqz(B, A, f_hz, fs=FS_HZ)[1]


@pytest.mark.parametrize("grid", ["full", "odd"])
@pytest.mark.parametrize("phases", ["random", "schroeder"])
@pytest.mark.parametrize(("n_periods", "bias"), [(1, 1e-3), (2, 1e-6), (4, 1e-8)])
def test_from_rest_without_noise_it_is_the_exact_response(n_periods, bias, grid, phases):
    """What the polynomials leave out; the mean over periods that have not settled is off by percents."""
    response = frf(from_rest(1, n_periods, grid=grid, phases=phases), lpm=True)
    truth = true_response(response.f_hz)
    error = np.abs(response.g - truth) / np.abs(truth)
    print(f"{n_periods} periods: relative error {error.max():.1e} at most")
    assert error.max() < bias
    assert (response.method, response.n_dof, response.n_periods) == ("lpm", N_DOF, n_periods)
    if n_periods > 1:
        settled_too_soon = frf(from_rest(1, n_periods, grid=grid, phases=phases), settle=0)
        unsettled = np.abs(settled_too_soon.g - truth) / np.abs(truth)
        print(f"{n_periods} periods, mean over the unsettled: relative error {unsettled.max():.1e} at most")
        assert unsettled.max() > 0.01


@pytest.mark.parametrize("noise", [0.02, 1.0])
@pytest.mark.parametrize("n_periods", [1, 2, 4])
def test_its_variance_is_that_of_the_error(n_periods, noise):
    """|g - truth|^2 / var_g is F(2, 18): of mean 9/8, and one in twenty beyond 3.55."""
    ratios = []
    for seed in range(30):
        response = frf(from_rest(seed, n_periods, noise), lpm=True)
        ratios.append(np.abs(response.g - true_response(response.f_hz)) ** 2 / response.var_g)
    ratios = np.array(ratios)
    outside = np.mean(ratios > N_DOF * (0.05 ** (-1 / N_DOF) - 1))
    print(f"{n_periods} periods, noise {noise}: mean {ratios.mean():.3f}, outside of 95 %: {outside:.3f}")
    # 30 x 397 values, of which windows of 16 lines share: about 750 independent, of standard deviation 1.35
    assert ratios.mean() == pytest.approx(N_DOF / (N_DOF - 1), abs=3 * 1.35 / np.sqrt(750))
    assert outside == pytest.approx(0.05, abs=3 * np.sqrt(0.05 * 0.95 / 750))


def test_noise_of_a_measured_input_counts():
    """The variance contains both noises (eq. 7.29); those of the lines are P times those of a period."""
    ratios, var_u = [], []
    for seed in range(20):
        response = frf(from_rest(seed, 3, 0.3, noise_u=0.02), lpm=True)
        ratios.append(np.abs(response.g - true_response(response.f_hz)) ** 2 / response.var_g)
        var_u.append(response.var_u)
    # the excited lines are 30 times the noise: the bias by noise in the denominator is 1e-3
    assert np.mean(ratios) == pytest.approx(9 / 8, abs=0.2)
    assert np.mean(var_u) == pytest.approx(4 / N * 0.02**2, rel=0.1)  # eq. 4.11 of white noise


def test_in_steady_state_it_agrees_with_the_mean_over_periods():
    whole = from_rest(3, 30, 0.1)
    record = Record(whole.u[-6 * N :], whole.y[-6 * N :], FS_HZ, N)
    settled, local = frf(record, settle=0), frf(record, lpm=True)
    np.testing.assert_array_equal(local.line, settled.line)
    assert np.all(np.abs(local.g - settled.g) < 5 * np.sqrt(local.var_g))
    assert np.mean(local.var_g) == pytest.approx(np.mean(settled.var_g), rel=0.3)


def test_phases_count_from_the_first_sample_after_any_settling():
    m = Multisine.design(FS_HZ, N, (2, 200), phases="random", seed=1)
    response = frf(from_rest(1, 3), settle=777, lpm=True)
    assert response.n_periods == 2
    np.testing.assert_allclose(response.u, m.spectrum(), atol=1e-9)
    assert (np.abs(response.g - true_response(response.f_hz)) / np.abs(response.g)).max() < 1e-6


def test_band_and_realisations():
    records = [from_rest(seed, 1, 0.1) for seed in range(4)]
    response = frf(records, band=(20, 100), lpm=True)
    assert (response.n_realisations, response.n_dof) == (4, 4 * N_DOF)
    assert (response.f_hz.min(), response.f_hz.max()) == (20, 100)
    np.testing.assert_allclose(
        response.g, np.mean([frf(r, band=(20, 100), lpm=True).g for r in records], axis=0), rtol=1e-12
    )


def test_refusals():
    valid = np.ones(2 * N, bool)
    valid[2500] = False
    with pytest.raises(InputError, match="needs every sample") as caught:
        frf(from_rest(1, 2, valid=valid), lpm=True)
    assert "sample 2500" in caught.value.where
    with pytest.raises(InputError, match="less than one period"):
        frf(from_rest(1, 1), lpm=True, settle=1)
    # A bug: "a configuration value is out of its range", as a failure inside.
    with pytest.raises(InputError, match="period or settling is out of range"):
        frf(from_rest(1, 2), lpm=True, period=1)
    impulse = np.zeros(N)
    impulse[0] = 1.0  # all lines alike: response and transient are one
    with pytest.raises(InputError, match="too similar"):
        frf(Record(impulse, lfilter(B, A, impulse), FS_HZ, N), lpm=True)
    with pytest.raises(InputError, match="too few lines"):
        frf(Record(np.sin(np.arange(30.0)), np.zeros(30), FS_HZ, 30), lpm=True)
    with pytest.raises(InputError, match="no line above its noise"):
        frf(Record(np.zeros(N), np.zeros(N), FS_HZ, N), lpm=True)
    from gsid.spectrum.realisation import spectra

    with pytest.raises(ValueError, match="lpm needs the samples"):
        frf(spectra(from_rest(1, 3), settle=0), lpm=True)
