"""Bands that were measured apart are joined to one response."""

import joined_bands as bands
import numpy as np
import pytest
from scipy import stats

from gsid.base.errors import InputError
from gsid.fitting.rational import fit
from gsid.plots import joined as picture
from gsid.response.files import read_response, write_response
from gsid.response.frf import Frf
from gsid.response.join import degrees_of_freedom, join

SEEDS = 60


@pytest.mark.parametrize(("p_low", "p_high"), [(2, 2), (3, 6)])
def test_intervals_of_joined_bands_cover_the_truth(p_low, p_high):
    found = [bands.two_bands(seed, p_low, p_high) for seed in range(SEEDS)]
    held = np.concatenate([bands.inside(one.response) for one in found])
    low, high = bands.limits(len(held))
    assert low <= held.sum() <= high, f"seeds 0 .. {SEEDS - 1}"
    common = found[0].overlaps[0].f_hz
    at = np.isin(np.round(found[0].response.f_hz, 6), np.round(common, 6))
    shared = np.concatenate([bands.inside(one.response)[at] for one in found])
    low, high = bands.limits(len(shared))
    assert low <= shared.sum() <= high
    alarms = sum(not one.agree for one in found)
    assert alarms <= stats.binom.ppf(1 - bands.ALPHA, SEEDS, 0.05)


def test_common_lines_have_less_variance_than_either_measurement():
    found = [bands.two_bands(seed, 8, 8) for seed in range(SEEDS)]
    f_hz = found[0].overlaps[0].f_hz

    def errors(pick):
        return np.mean([np.abs(at_lines(pick(one), f_hz) - bands.true_response(f_hz)) ** 2 for one in found])

    def at_lines(response, f_hz):
        return response.g[np.argmin(np.abs(response.f_hz[:, None] - f_hz), axis=0)]

    mean = errors(lambda one: one.response)
    assert mean < errors(lambda one: one.parts[0])
    assert mean < errors(lambda one: one.parts[1])


def known(f_hz, g, variance):
    return Frf.from_arrays(f_hz, g, variance, fs_hz=1000.0)


def test_known_variances_give_the_textbook_mean():
    f_hz = np.array([1.0, 2.0, 3.0])
    low = known(f_hz[:2], [1 + 1j, 2.0], [0.04, 0.01])
    high = known(f_hz[1:], [2.2, 3.0], [0.03, 0.09])
    found = join([low, high])
    assert found.response.f_hz == pytest.approx(f_hz)
    assert found.response.g[1] == pytest.approx((2.0 / 0.01 + 2.2 / 0.03) / (1 / 0.01 + 1 / 0.03))
    assert found.response.var_g == pytest.approx([0.04, 1 / (1 / 0.01 + 1 / 0.03), 0.09])
    # one line: |difference|^2 / variance is exponential
    assert found.overlaps[0].p_value == pytest.approx(np.exp(-(0.2**2) / 0.04))


def test_a_response_that_depends_on_the_level_is_noted_and_not_hidden():
    rng = np.random.default_rng(7)
    f_low, f_high = np.arange(1.0, 12.0), np.arange(6.0, 40.0)

    def measured(f_hz, factor, level):
        g = factor * bands.true_response(f_hz)
        noise = rng.standard_normal((2, len(f_hz))) * 0.01 / np.sqrt(2)
        response = known(f_hz, g + noise[0] + 1j * noise[1], np.full(len(f_hz), 1e-4))
        response.u = np.full(len(f_hz), level, complex)
        response.y = response.g * level
        return response

    found = join([measured(f_low, 1.0, 1.0), measured(f_high, 1.1, 3.0)])
    assert found.agree is False
    overlap = found.overlaps[0]
    assert overlap.level_ratio > 1.2
    assert overlap.where_hz == (6.0, 11.0)
    assert overlap.relative == pytest.approx(0.1, abs=0.03)
    assert "depends on the level or on the position" in found.sentence
    # the increased intervals hold both responses
    at = np.isin(found.response.f_hz, overlap.f_hz)
    half = 0.05 * np.abs(bands.true_response(overlap.f_hz))
    assert np.all(np.sqrt(found.response.var_g[at]) > 0.4 * half)


def test_a_joined_response_is_fitted_as_one():
    """The parameters of the axis lie within their intervals, and each band alone leaves them less certain."""
    errors = []
    for seed in range(20):
        found = bands.two_bands(seed, 9, 12)
        model = fit(found.response, "1/0", domain="z", delay=0.002, quiet=True)
        errors.append((model.poles[0].real - 0.97) / np.sqrt(model.pole_cov[0][0, 0]))
    assert np.mean(np.abs(errors) < 1.96) >= stats.binom.ppf(1e-3, 20, 0.95) / 20
    assert np.std(errors) < 2


def test_bands_without_a_common_line_are_joined_untested():
    found = join([known([1.0], [1.0], [0.1]), known([2.0], [1.0], [0.1])])
    assert found.agree is None
    assert "no common line" in found.sentence


def test_a_file_keeps_the_response(tmp_path):
    one = bands.two_bands(1).response
    write_response(tmp_path / "joined.csv", one)
    again = read_response(tmp_path / "joined.csv")
    for name in ("f_hz", "g", "var_g", "u", "y", "var_y", "dof", "line"):
        assert np.array_equal(getattr(again, name), getattr(one, name)), name
    for name in ("n_periods", "n_dof", "fs_hz", "hold", "y_unit", "method"):
        assert getattr(again, name) == getattr(one, name), name
    assert np.array_equal(degrees_of_freedom(again), degrees_of_freedom(one))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("f_hz,g_re,g_im\n1,2,3\n", "var_g"),
        ("f_hz,g_re,g_im,var_g\n1,2,nan,1\n", "not a valid value"),
        ("f_hz,g_re,g_im,var_g\n1,2,3,-1\n", "not a valid value"),
        ("f_hz,g_re,g_im,var_g\n2,2,3,1\n1,2,3,1\n", "do not ascend"),
        ("# n_periods: many\nf_hz,g_re,g_im,var_g\n2,2,3,1\n", "n_periods"),
    ],
)
def test_a_damaged_response_is_refused(tmp_path, text, words):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_response(tmp_path / "bad.csv")


def test_bands_of_another_unit_or_without_variance_are_refused():
    one, other = known([1.0], [1.0], [0.1]), known([2.0], [1.0], [0.1])
    other.y_unit = "rad/s"
    with pytest.raises(InputError, match="y_unit"):
        join([one, other])
    with pytest.raises(ValueError, match="no variance"):
        join([one, Frf.from_arrays([1.0], [1.0], fs_hz=1000.0)])
    with pytest.raises(ValueError, match="at least two"):
        join([one])


def test_the_picture_shows_both_bands_and_their_difference():
    figure = picture(bands.two_bands(2))
    labels = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    assert {"low", "high", "joined", "|difference|"} <= labels


def test_bug_a_measurement_joined_with_itself_had_half_the_variance():
    f_hz = np.arange(1.0, 9.0)
    rng = np.random.default_rng(7)
    one = known(f_hz, rng.standard_normal(8) + 1j, np.full(8, 0.01))
    with pytest.raises(InputError, match="given twice"):
        join([one, one])
