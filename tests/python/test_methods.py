"""Multisine, stepped sine, sweep and binary sequence for the same time and limits."""

import numpy as np
import pytest

from gsid.excitation.generators import SteppedSine
from gsid.excitation.limits import travel_response
from gsid.excitation.methods import compare_methods, stepped_to_limits
from gsid.excitation.periodic import Limits
from gsid.models.rational import RationalModel
from gsid.plots import excitation_methods

FS_HZ, N = 1000.0, 1000
MODEL = RationalModel([60.0], [1, 30.0], 0.003, fs_hz=FS_HZ, hold="zoh", y_unit="deg/s")


def compared(noise, time_s=60.0, **options):
    return compare_methods(FS_HZ, N, (2, 100), time_s, noise, Limits(command=3.0), model=MODEL, **options)


def test_the_formula_is_the_scatter_of_simulated_measurements():
    found = compared(0.5, 120.0, n_simulated=40, seed=3)
    assert [one.name for one in found.methods] == ["multisine", "stepped-sine", "sweep", "prbs"]
    for one in found.methods:
        ratio = (one.sigma_simulated / one.sigma) ** 2
        # mean of n F exponential variables
        assert np.mean(ratio) == pytest.approx(1, abs=4 / np.sqrt(40 * len(ratio))), one.name


def test_the_formula_is_the_textbook_variance_of_white_noise():
    one = compared(0.5, 200.0)["stepped-sine"]
    samples = one.n_periods * N
    assert one.sigma == pytest.approx(np.full(len(one.f_hz), 2 * 0.5 / (3.0 * np.sqrt(samples))))


def test_broadband_suffices_above_40_db_and_saves_nothing_below_20_db():
    """The thesis, section 3.4: far less time at a high ratio, about the same time at a low one."""
    high = compared(1e-3, wanted=1e-3)
    assert np.min(high["multisine"].snr_db) > 40
    assert high["stepped-sine"].time_for_wanted_s > 8 * high["multisine"].time_for_wanted_s
    assert "broadband excitation suffices" in high.sentence
    low = compared(30.0, wanted=2e-3)
    assert np.max(low["multisine"].snr_db) < 20
    ratio = low["stepped-sine"].time_for_wanted_s / low["multisine"].time_for_wanted_s
    # one sine after another has all of the peak: 2 / crest factor^2 remains
    assert ratio == pytest.approx(2 / low["multisine"].signal.crest_factor ** 2, rel=0.1)
    assert 0.5 < ratio < 1.5
    assert "measure these with a stepped sine" in low.sentence


def test_each_sine_has_the_amplitude_of_its_own_limit():
    limits = Limits(command=3.0, travel=0.5)
    signal = SteppedSine.design(FS_HZ, N, (1, 100), settle_samples=N)
    scaled = stepped_to_limits(signal, limits, MODEL)
    angle = np.abs(travel_response(MODEL, scaled.f_hz, FS_HZ)) * scaled.amplitude
    assert np.all(angle <= 0.5 * (1 + 1e-9))
    assert scaled.amplitude[0] < 0.6 * scaled.amplitude[-1] <= 1.8


def test_a_time_that_is_too_short_is_reported():
    found = compared(0.5, 5.0)
    assert found["stepped-sine"].n_periods == 0
    assert np.all(np.isinf(found["stepped-sine"].sigma))
    assert found["stepped-sine"].least_s > 5
    assert "No method" in compared(0.5, 1.0).sentence


def test_coloured_noise_counts_where_it_is():
    found = compared(lambda f: np.where(f < 20, 4e-3, 1e-3), 200.0)
    one = found["stepped-sine"]
    assert one.sigma[one.f_hz < 19] == pytest.approx(2 * one.sigma[one.f_hz > 21][0])


@pytest.mark.parametrize("wrong", [{"time_s": 0}, {"noise": -1.0}, {"wanted": 0}])
def test_what_is_not_valid_is_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        compared(**({"noise": 1.0} | wrong))


def test_the_picture_has_every_method():
    figure = excitation_methods(compared(0.5, 120.0, n_simulated=2))
    labels = {text.get_text() for legend in figure.legends for text in legend.get_texts()}
    assert {"multisine", "stepped-sine", "sweep", "prbs"} <= labels
