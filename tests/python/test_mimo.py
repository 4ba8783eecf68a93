"""Matrices of responses with common poles: measured, fitted, and how far their intervals go."""

import mimo_coverage as coverage
import mimo_gimbal as gimbal
import numpy as np
import pytest

import gsid
from gsid.errors import InputError
from gsid.mimo import MimoFrf, frf_mimo
from gsid.mimo_fit import fit_mimo


def nearest(poles, true):
    """Each true pole's neighbour, upper half plane."""
    true = true[true.imag > 0]
    return np.array([np.argmin(np.abs(poles - p)) for p in true]), true


@pytest.fixture(scope="module")
def exact():
    """The gimbal's responses without noise, on the lines of a record."""
    f = np.arange(1.0, 241.0)
    g = gimbal.true_response(f)
    return MimoFrf.from_arrays(f, g, np.full((len(f), 4), 1e-8), fs_hz=gimbal.FS_HZ)


@pytest.fixture(scope="module")
def model(exact):
    return fit_mimo(exact, "8/7")


def test_exact_responses_give_the_exact_model(exact, model):
    assert model.converged
    assert model.stable
    where, true = nearest(model.poles, gimbal.true_poles())
    np.testing.assert_allclose(model.poles[where], true, rtol=1e-6)
    np.testing.assert_allclose(model.delay_s, np.tile(gimbal.DELAY_S, (4, 1)), atol=1e-8)
    np.testing.assert_allclose(model.response(exact.f_hz), exact.g, rtol=0, atol=1e-7 * np.abs(exact.g).max())


def test_the_matrix_of_responses_is_measured():
    """Errors of 3840 numbers over their sample variance: 16/15 on average, sd about 0.03."""
    measured = frf_mimo(gimbal.experiments(7))
    assert (measured.source, measured.dof) == ("periods", 16)
    error = np.abs(measured.g - gimbal.true_response(measured.f_hz)) ** 2 / measured.var_g
    assert np.mean(error) == pytest.approx(16 / 15, abs=0.1)


def test_too_few_experiments():
    with pytest.raises(InputError, match="fewer experiments than inputs"):
        frf_mimo(gimbal.experiments(7)[:3])


def test_the_same_experiment_again_tells_nothing():
    first = gimbal.experiments(7)[0]
    with pytest.raises(InputError, match="not told apart"):
        frf_mimo([first] * 4)


def test_a_model_file_keeps_the_model(exact, model, tmp_path):
    model.save(tmp_path / "m.json")
    again = gsid.load_model(tmp_path / "m.json")
    np.testing.assert_array_equal(again.response(exact.f_hz), model.response(exact.f_hz))
    np.testing.assert_array_equal(again.response_std(exact.f_hz), model.response_std(exact.f_hz))
    assert again.inputs == ["u1", "u2", "u3", "u4"]


def test_a_channel_is_a_rational_model(exact, model):
    for i, j in ((0, 0), (3, 1)):
        one = model.channel(i, j).response(exact.f_hz)
        np.testing.assert_allclose(one, model.response(exact.f_hz)[:, i, j], rtol=1e-7)


SEEDS = range(6)


def test_a_gimbal_of_four_axes_is_recovered_within_its_intervals():
    """Of poles, delays and responses of noisy measurements, 95 % lie within their intervals.

    Numbers of one seed depend on each other, so that they count for half as many: the bound is that of a
    binomial of so many trials, at 1e-4 both sides together. `make coverage-mimo` counts each over many seeds.
    """
    print("seeds", SEEDS)
    seeds = [coverage.deviations(seed) for seed in SEEDS]
    held = [coverage.inside(one) for one in seeds]
    for kind in ("poles", "delays", "responses"):
        counts = np.array([one[kind] for one in held])
        n = counts.size // 2
        low, _ = coverage.bounds(n)
        assert counts.mean() >= low / n, f"{kind}: {counts.mean():.3f} of {counts.size}"
        # No wrong minimum anywhere: of 720 normal numbers the largest is below 5 but once in 2400.
        assert np.abs([one[kind] for one in seeds]).max() < 5
