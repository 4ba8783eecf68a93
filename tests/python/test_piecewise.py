"""Sets of low-order models over adjoining bands: the axis of the benchmarks, and a truth with a break."""

from itertools import combinations

import numpy as np
import pytest
from scipy.io import loadmat

from gsid.base.errors import GsidError, InputError
from gsid.comparison import compare
from gsid.fitting.piecewise import _Bands, fit_piecewise
from gsid.fitting.rational import fit
from gsid.models.load import load_model
from gsid.models.piecewise import PiecewiseModel
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.frf import Frf

SEED = 20260402
WA, WR = 2 * np.pi * 165, 2 * np.pi * 179
AXIS = RationalModel(
    17 * np.polymul([1, 11], [1, 0.03 * WA, WA**2]), np.polymul([1, 11, 170], [1, 0.03 * WR, WR**2]), 0.0054
)
"""The axis of design figures: two slow poles, an anti-resonance at 165 Hz, a resonance at 179 Hz, a delay."""
LOW, HIGH = RationalModel([900.0], [1.0, 30.0]), RationalModel([40.0, 3e4], [1.0, 500.0], 0.001)


def measured(f, g, noise=0.003):
    """A response with noise of known variance."""
    rng = np.random.default_rng(SEED)
    sigma = noise * np.abs(g)
    error = sigma / np.sqrt(2) * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
    return Frf.from_arrays(f, g + error, sigma**2, fs_hz=3000.0)


@pytest.fixture(scope="module")
def broken() -> Frf:
    f = np.arange(1, 101) * 1.0
    return measured(f, np.where(f < 40, LOW.response(f), HIGH.response(f)), noise=0.01)


def test_two_low_orders_do_on_the_axis_what_the_true_order_does():
    f = np.arange(1, 251) * 1.0
    response = measured(f, AXIS.response(f))
    found = fit_piecewise(response, "3/2")
    cost_true = np.sum(np.abs(response.g - AXIS.response(f)) ** 2 / response.var_g)
    # the figures of docs/explanation/estimators.md
    print(f"cost {found.cost:.4g}, of the true model {cost_true:.4g}, of one piece {found.tried[0].cost:.2g}")
    print(f"break at {found.breaks_hz[0]:.3g} Hz")
    assert [piece.n_poles for piece in found.pieces] == [3, 3]
    assert 10 < found.breaks_hz[0] < 160
    assert found.cost <= 1.0 * cost_true
    assert found.cost_expected == pytest.approx(250 - 14 / 2)
    assert (found.n_parameters, found.n_lines, found.stable, found.converged) == (14, 250, True, True)
    assert found.tried[0].cost > 100 * found.cost  # one model of that order
    # 14 parameters: the mean squared error over sigma^2 is 7/250; three times that, as breaks were chosen too
    error = np.abs(found.response(f) - AXIS.response(f)) ** 2 / response.var_g
    assert error.mean() < 3 * 7 / 250
    assert abs(found.jumps()[0].gain_db) < 0.05
    figure = found.plot(response)
    assert len(figure.axes) == 2


def test_a_break_is_found_to_the_line(broken):
    """The response of the truth changes by a factor at 40 Hz, far above the noise."""
    found = fit_piecewise(broken, "1/1")
    assert found.breaks_hz == (39.5,)
    assert [cut.n_pieces for cut in found.tried] == [1, 2, 3, 4, 5, 6]
    assert min(found.tried, key=lambda cut: cut.mdl).n_pieces == 2
    low, high = LOW.response([39.5])[0], HIGH.response([39.5])[0]
    jump = found.jumps()[0]
    assert jump.gain_db == pytest.approx(20 * np.log10(abs(high / low)), abs=0.1)
    assert jump.phase_deg == pytest.approx(np.degrees(np.angle(high / low)), abs=1)
    assert jump.sigmas > 20
    one = fit(broken, "1/1", band=(40, 100))
    np.testing.assert_array_equal(found.pieces[1].den, one.den)
    np.testing.assert_array_equal(found.response([39, 41]), [
        found.pieces[0].response([39])[0], found.pieces[1].response([41])[0]
    ])  # fmt: skip


@pytest.mark.parametrize("n", [2, 3])
def test_the_cut_is_the_best_of_all_on_the_grid(broken, n):
    bands = _Bands(broken, (1, 0), None, {"delay": "none"})
    every = ([0, *inner, 100] for inner in combinations(bands.grid[1:-1], n - 1))
    least = min(bands.total(edges) for edges in every)
    assert bands.total(bands.best_cuts(n)[n]) == least
    assert bands.total(bands.refined(bands.best_cuts(n)[n])) <= least


def test_files_and_comparison(broken, tmp_path):
    found = fit_piecewise(broken, "1/1", 2, band=(5, 95))
    found.save(tmp_path / "m.json")
    again = load_model(tmp_path / "m.json")
    assert isinstance(again, PiecewiseModel)
    f = np.linspace(1, 100, 57)
    np.testing.assert_allclose(again.response(f), found.response(f), rtol=1e-12)
    np.testing.assert_allclose(again.response_std(f), found.response_std(f), rtol=1e-9)
    assert (again.band_hz, again.breaks_hz, repr(again)) == ((5.0, 95.0), found.breaks_hz, repr(found))
    found.save(tmp_path / "m.mat")
    read = loadmat(tmp_path / "m.mat", squeeze_me=True)
    assert read["breaks_hz"] == found.breaks_hz[0]
    np.testing.assert_allclose(read["pieces"][1]["den"].item(), found.pieces[1].den)
    (tmp_path / "one.json").write_text('{"gsid_model": 1, "pieces": []}')
    with pytest.raises(InputError, match="not usable"):
        PiecewiseModel.load(tmp_path / "one.json")
    LOW.save(tmp_path / "low.json")
    with pytest.raises(InputError, match="no pieces"):
        PiecewiseModel.load(tmp_path / "low.json")


def test_compare_takes_a_set():
    """A record of the set itself: its piece answers at each line."""
    rng = np.random.default_rng(SEED)
    n, fs, line = 400, 400.0, np.arange(5, 96)
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[line] = np.exp(2j * np.pi * rng.random(len(line))) * n / 2
    pieces = [RationalModel(m.num, m.den, m.delay_s, band_hz=band) for m, band in
              ((LOW, (5.0, 39.0)), (HIGH, (40.0, 95.0)))]  # fmt: skip
    model = PiecewiseModel(tuple(pieces), (39.5,))
    f = np.arange(n // 2 + 1) * fs / n
    y = np.fft.irfft(spectrum * model.response(f))
    record = Record(np.tile(np.fft.irfft(spectrum), 8), np.tile(y, 8) + rng.standard_normal(8 * n), fs, n, 0)
    assert compare(model, record, alpha=0.001).adequate
    assert not compare(pieces[0], record, alpha=0.001).adequate
    assert "PiecewiseModel of 2 pieces" in repr(model)  # one that was not fitted has no cost


def test_two_periods_and_bands_of_two_lines():
    """Bug: TypeError. One degree of freedom says nothing of a cost, so that such bands are no candidates.

    From three lines on the variance is an average over neighbours and has more. Two levels, cut at 12 Hz, and
    noise 100 times smaller.
    """
    rng, n = np.random.default_rng(SEED), 64
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[1:25] = np.exp(2j * np.pi * rng.random(24)) * n / 2
    g = np.where(np.arange(n // 2 + 1) < 12, 1.0, 0.1)
    u, y = (np.tile(np.fft.irfft(x), 2) for x in (spectrum, spectrum * g))
    record = Record(u, y + 0.01 * rng.standard_normal(2 * n), 64.0, n, 0)
    found = fit_piecewise(frf(record), "0/0", 2, delay="none")
    assert found.breaks_hz == (11.5,)
    assert min(piece.n_lines for piece in found.pieces) > 2


def test_a_failure_in_every_band_is_reported(broken):
    """Bug: every failure of the library counted as a band without a stable model."""
    with pytest.raises(GsidError, match="out of its range"):
        fit_piecewise(broken, "1/1", exponent=-1.0)
    dead = Frf.from_arrays(broken.f_hz, np.zeros(100, complex), np.ones(100), fs_hz=3000.0)
    with pytest.raises(ValueError, match="a stable model") as caught:
        fit_piecewise(dead, "1/1", 1)
    assert "singular" in str(caught.value.__cause__)


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"n_pieces": 0}, "n_pieces"),
        ({"n_pieces": 9}, "n_pieces"),
        ({"n_pieces": 4, "band": (1, 8)}, "lines"),
    ],
)
def test_misuse(broken, arguments, what):
    with pytest.raises(ValueError, match=what):
        fit_piecewise(broken, "1/1", **arguments)
    with pytest.raises(ValueError, match="ascending breaks"):
        PiecewiseModel((LOW, HIGH), ())
    with pytest.raises(ValueError, match="band"):
        PiecewiseModel((LOW, HIGH), (40.0,))
