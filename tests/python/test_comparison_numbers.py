"""Numbers of a comparison against numbers computed by hand.

The model is a gain of 1 and the error of each line is given, so that T = |mean error|^2 / (s^2 / P) is exact.
"""

import numpy as np
import pytest
from scipy import stats

from gsid.comparison import compare
from gsid.models.rational import RationalModel
from gsid.spectrum.lines import lines_of
from gsid.spectrum.spectra import Spectra

GAIN = RationalModel([1.0], [1.0])
N = 4000  # samples at 4000 Hz: line k lies at k Hz
SIGMA = 1e-3  # standard deviation of one period


def scatter(periods):
    """One number per period: mean 0, sample variance 1."""
    pattern = np.concatenate([np.resize([1.0, -1.0], periods // 2 * 2), np.zeros(periods % 2)])
    return pattern / np.std(pattern, ddof=1)


def record(amplitude, t, *, periods=5, sigma=None, **more):
    """A record with a given T of each line.

    Parameters
    ----------
    amplitude : dict
        Of the input, by line.
    t : dict
        T by line; the others have the mean of T if only noise remains, so that their excess is 0.
    periods : int
    sigma : dict, optional
        Standard deviation of one period by line, if it is not SIGMA.
    **more
        Further attributes of the record.
    """
    u, each = np.zeros(N // 2 + 1), np.full(N // 2 + 1, SIGMA)
    u[list(amplitude)] = list(amplitude.values())
    each[list(sigma or {})] = list((sigma or {}).values())
    wanted = np.full(len(u), only_noise(periods))
    wanted[list(t)] = list(t.values())
    error = each * np.sqrt(wanted / periods)
    scattered = scatter(periods)[:, None]
    U = u * (1 + 0.01 * scattered)  # an input that scatters too: the variance is that of Y - G U
    Y = U + error + each * scattered
    return Spectra(float(N), N, np.arange(len(u)), U + 0j, Y + 0j, 0, 0, u > 0, **more)


def only_noise(periods):
    """Mean of F(2, 2 nu) with nu = P - 1."""
    return (periods - 1) / (periods - 2) if periods > 2 else 1.0


def p_of_lines(t, periods):
    """P-value of lines with these T: ln(1 + T/nu) nu is exponential, and its sum has a gamma distribution."""
    nu = periods - 1
    return stats.gamma.sf(np.sum(nu * np.log1p(np.array(t) / nu)), len(t))


def test_bands_state_share_decibels_and_corrected_p_value():
    """Lines 8, 16, 32, 64 are excited: 4, 9 and 8 third octaves have excited, odd and even lines."""
    amplitude = 0.1
    rest = only_noise(5)
    found = compare(GAIN, record(dict.fromkeys([8, 16, 32, 64], amplitude), {16: rest + 300, 33: rest + 100}))
    first, second = found.where
    assert (first["f_lo_hz"], first["f_hi_hz"], first["lines"]) == (16, 16, "excited")
    assert (second["f_lo_hz"], second["f_hi_hz"], second["lines"]) == (29, 35, "odd")
    assert (first["share"], second["share"]) == pytest.approx((0.75, 0.25))
    # Holm: the smallest of 21 p-values times 21, the next one times 20.
    assert first["p_value"] == pytest.approx(21 * p_of_lines([rest + 300], 5), rel=1e-6)
    assert second["p_value"] == pytest.approx(20 * p_of_lines([rest + 100, rest, rest, rest], 5), rel=1e-6)
    error = SIGMA * np.sqrt((rest + np.array([300, 100, 0])) / 5)
    decibels = 20 * np.log10(error[0] / (amplitude + error[0]))
    assert first["db"] == pytest.approx(decibels)
    # The response from 29 to 35 Hz: line 32 is excited, the others have their error alone.
    power = (amplitude + error[2]) ** 2 + error[1] ** 2 + 5 * error[2] ** 2
    assert second["db"] == pytest.approx(10 * np.log10((error[1] ** 2 + 3 * error[2] ** 2) / power))
    row = f"        16 to       16 Hz  excited    75.0 % of the excess  {decibels:6.1f} dB of the response"
    assert row in repr(found).splitlines()
    html = found._repr_html_()
    for cell in ("16 to 16", "excited", "75.0", f"{decibels:.1f}", "29 to 35", "odd", "25.0"):
        assert f">{cell}</t" in html


@pytest.mark.parametrize(("ratio", "bands"), [(9.5, [(8, 11)]), (10.5, [(9, 11), (8, 8)])])
def test_neighbouring_bands_with_a_similar_excess_per_line_are_one(ratio, bands):
    """The third octaves of 8 Hz and of 9 to 11 Hz; a factor of 10 is the limit."""
    high = dict.fromkeys([9, 10, 11], only_noise(5) + 100 * ratio)
    found = compare(GAIN, record(dict.fromkeys(range(4, 15), 1.0), {8: only_noise(5) + 100} | high))
    assert [(band["f_lo_hz"], band["f_hi_hz"]) for band in found.where] == bands
    assert sum(band["share"] for band in found.where) == pytest.approx(1)


def test_three_neighbouring_bands_with_a_similar_excess_per_line_are_one():
    """The third octaves around 16, 20 and 25 Hz, one excited line each."""
    rest = only_noise(5)
    found = compare(GAIN, record(dict.fromkeys([16, 20, 25], 1.0), dict.fromkeys([16, 20, 25], rest + 300)))
    assert [(band["f_lo_hz"], band["f_hi_hz"]) for band in found.where] == [(16, 25)]


def test_the_first_third_octave_has_the_first_line_in_its_middle():
    """From 100 Hz the bands end at 112.2, 141.4 and 178.2 Hz; their excess per line is 100, 5 and 0."""
    lines = dict.fromkeys(range(100, 179), 1.0)
    excess = dict.fromkeys(range(100, 113), 100.0) | dict.fromkeys(range(113, 142), 5.0)
    found = compare(GAIN, record(lines, {line: only_noise(5) + more for line, more in excess.items()}))
    assert [(band["f_lo_hz"], band["f_hi_hz"]) for band in found.where] == [(100, 112), (113, 141)]


@pytest.mark.parametrize(("t", "share"), [(1.9, 0.0), (2.005, 1.0)])
def test_a_band_that_fails_with_little_or_no_excess(t, share):
    """The mean of T is 2 with 3 periods, but so many alike values are not noise.

    The excess of 101 lines is -10 or 0.5. Without excess the band has no share of it.
    """
    lines = range(1000, 1101)
    found = compare(GAIN, record(dict.fromkeys(lines, 1.0), dict.fromkeys(lines, t), periods=3))
    assert not found.adequate
    assert [band["share"] for band in found.where] == [share]
    assert found.where[0]["p_value"] == pytest.approx(p_of_lines([t] * 101, 3), rel=1e-6)


def test_the_change_of_a_model_within_its_uncertainty_counts_as_misfit():
    """Ridge regression of one error e on one standard deviation c of the gain, at line 8.

    The weight of the line is w = 2 / (s^2 / P) (nu - 1) / nu. c is chosen so that c^2 w = 1: half of the
    error remains, T / 4, and the squared change is w e^2 / 4. Line 9 has no input, and its excess is 100.
    """
    periods, rest, t = 21, only_noise(21), 400.0
    c = SIGMA * np.sqrt(rest / 2 / periods)
    model = RationalModel([1.0], [1.0], cov=[[c**2]])
    found = compare(model, record({8: 1.0}, {8: t, 9: rest + 100}, periods=periods), band=(8, 10))
    left, moved = t / 4, 2 * t / rest / 4
    excess = left - rest + moved / 2
    shares = excess / (excess + 100), 100 / (excess + 100)
    assert [band["share"] for band in found.where] == pytest.approx(shares)
    of_lines = (left + (rest + 100) + rest) / rest  # T over its mean: lines 8, 9, 10
    assert found.cost_per_dof == pytest.approx(of_lines / 3 + moved / 6)
    assert found.deviance == pytest.approx(2 * of_lines + moved)
    assert found.model_uncertainty_rms == pytest.approx(c / np.sqrt(2))
    assert found.noise_floor_rms == pytest.approx(SIGMA * np.sqrt(3 / 2 / periods))
    assert found.sigma[:2] == pytest.approx(np.sqrt(SIGMA**2 / periods + np.array([c**2, 0])))


@pytest.mark.parametrize(
    ("periods", "cost"),
    [(3, (6 + 1) / 2 / 2), (2, (6 * 1 + 1 * 4) / (1 + 4))],  # the mean of T is 2; with 2 periods it has none
)
def test_cost_per_dof_averages_t_and_with_two_periods_the_variances(periods, cost):
    one = record({8: 1.0, 9: 1.0}, {8: 6.0, 9: 1.0}, periods=periods, sigma={8: SIGMA, 9: 2 * SIGMA})
    other = record({8: 1.0, 9: 1.0}, dict.fromkeys([8, 9], only_noise(periods)), periods=periods)
    assert compare(GAIN, one).cost_per_dof == pytest.approx(cost)
    assert compare(GAIN, [one, other]).cost_per_dof == pytest.approx((cost + 1) / 2)


def test_cost_per_dof_of_a_fitted_model_counts_its_parameters():
    one = record({8: 1.0, 9: 1.0}, {8: 6.0, 9: 1.0}, periods=3)
    assert compare(GAIN, one, fitted=True).cost_per_dof == pytest.approx(7 / 4 * 4 / 3)


@pytest.mark.parametrize("amplitudes", [((4, 1, 1), (2.2, 2.2, 2.2)), ((2, 2, 2), (3, 1, 1))])
def test_the_record_of_the_largest_power_is_shown(amplitudes):
    """Sums of squares 18 > 14.5 and 12 > 11; the sums of amplitudes or of cubes have the reverse order."""
    records = [record(dict(zip([8, 9, 10], each, strict=True)), {}) for each in amplitudes]
    for several in (records, records[::-1]):
        np.testing.assert_allclose(compare(GAIN, several).y.real, amplitudes[0], atol=5 * SIGMA)


def test_the_cost_of_each_line_is_averaged_over_records_with_equal_lines():
    """The record with the largest output is shown. If the other has further lines, the cost is its own."""
    large = record({8: 2.0, 9: 2.0}, {8: 6.0, 9: 1.0})
    small, longer = (record(dict.fromkeys(lines, 1.0), {8: 2.0, 9: 3.0}) for lines in ([8, 9], [8, 9, 10]))
    assert compare(GAIN, [large, small]).cost == pytest.approx([4.0, 2.0])
    assert compare(GAIN, [large, longer]).cost == pytest.approx([6.0, 1.0])


@pytest.mark.parametrize(
    ("holds", "common"), [(["zoh"], "zoh"), (["none", "none"], "none"), (["zoh", "none"], None)]
)
def test_the_hold_of_the_records_is_stated_if_it_is_common(holds, common):
    records = [record({8: 1.0, 9: 1.0}, {}, hold=hold) for hold in holds]
    assert compare(GAIN, records).hold == common


def test_the_noise_floor_of_a_repeated_input_omits_the_leakage_of_drift():
    """The output rises by 0.5 per period for four periods, and falls again: the mean has no ramp.

    A ramp of 0.5 has lines of 0.5 / (pi k). The variance over the periods contains them, 500 times that of
    the white noise at line 9.
    """
    periods, sigma = 8, 0.02
    rng = np.random.default_rng(20260601)
    white = sigma * rng.standard_normal(periods * N)
    t = np.arange(periods * N) / N
    drift = 0.5 * np.minimum(t, periods - t)
    u = np.zeros(N // 2 + 1)
    u[9:209] = 1.0

    def floor(output):
        Y = u + lines_of(output.reshape(periods, N))
        line = np.arange(len(u))
        one = Spectra(float(N), N, line, np.tile(u + 0j, (periods, 1)), Y, 0, 0, u > 0)
        return compare(GAIN, one).noise_floor_rms

    assert floor(white) == pytest.approx(sigma * np.sqrt(200 / (N / 2) / periods), rel=0.05)
    assert floor(white + drift) == pytest.approx(floor(white), rel=0.05)
