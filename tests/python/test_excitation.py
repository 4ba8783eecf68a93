"""Multisine design: the signal against its closed form, and every degenerate request."""

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.excitation.periodic import crest_factor, power_share


@pytest.fixture(scope="module")
def schroeder():
    """The source's excitation: 500 lines, 0.5 .. 250 Hz, 3 V each (section 3.5)."""
    return Multisine.design(3000, 6000, (0.5, 250), amplitude=3)


def test_table_is_the_sum_of_cosines(schroeder):
    n = np.arange(6000)
    k = schroeder.line[:, None].astype(np.int64)
    expected = (3 * np.cos(2 * np.pi * (k * n % 6000) / 6000 + schroeder.phase_rad[:, None])).sum(axis=0)
    # 500 terms of size 3, each rounded a few times
    np.testing.assert_allclose(schroeder.table(), expected, atol=500 * 3 * 1e-15)


def test_schroeder_phases_are_those_of_the_source(schroeder):
    k = np.arange(1, 501)
    turns = schroeder.phase_rad / (2 * np.pi) + k * (k - 1) / 1000
    # the phases are a running sum of 500 terms below 1
    np.testing.assert_allclose(turns - np.round(turns), 0, atol=500 * 1e-15)
    assert (schroeder.phase_rad >= 0).all()
    assert (schroeder.phase_rad < 2 * np.pi).all()


def test_spectrum_is_that_of_the_table(schroeder):
    lines = np.fft.rfft(schroeder.table()) / 3000
    np.testing.assert_allclose(lines[schroeder.line], schroeder.spectrum(), atol=1e-13)
    rest = np.delete(lines, schroeder.line)
    assert np.abs(rest).max() < 1e-13


def test_crest_factors_by_their_definition(schroeder):
    n_fine = 8 * 6000
    t = np.arange(n_fine) / n_fine
    u = np.zeros(n_fine)
    for k, phase in zip(schroeder.line, schroeder.phase_rad, strict=True):
        u += 3 * np.cos(2 * np.pi * k * t + phase)
    rms = 3 * np.sqrt(500 / 2)
    assert schroeder.rms == pytest.approx(rms, rel=1e-14)
    # the phase 2 pi k t itself rounds to 2 pi 500 epsilon
    assert schroeder.crest_factor_fine == pytest.approx(np.abs(u).max() / rms, rel=1e-10)
    assert schroeder.crest_factor == pytest.approx(np.abs(u[::8]).max() / rms, rel=1e-10)
    assert schroeder.crest_factor_fine < 1.73  # the source's own figure for its signal
    assert schroeder.p_int_over_p_tot == pytest.approx(1, abs=1e-12)


def test_crest_factor_counts_the_band_of_interest_only():
    n = np.arange(100)
    u = np.cos(2 * np.pi * 3 * n / 100) + 0.5 * np.cos(2 * np.pi * 7 * n / 100)
    assert crest_factor(u) == pytest.approx(1.5 / np.sqrt(0.625))
    assert power_share(u, [3]) == pytest.approx(0.8)
    assert crest_factor(u, [3]) == pytest.approx(1.5 / np.sqrt(0.5))
    with pytest.raises(ValueError, match="no power"):
        crest_factor(np.zeros(10))
    # line N/2 has no negative twin
    assert power_share(np.array([1.0, -1.0, 1.0, -1.0]), [2]) == pytest.approx(1)


def test_grids():
    full = Multisine.design(3000, 6000, (0.5, 250))
    odd = Multisine.design(3000, 6000, (1, 250), grid="odd")
    np.testing.assert_array_equal(full.line, np.arange(1, 501))
    np.testing.assert_array_equal(odd.line, np.arange(3, 501, 2))
    np.testing.assert_allclose(odd.f_hz, odd.line * 0.5)
    # band edges on a line, where fs/N is not a binary fraction
    np.testing.assert_array_equal(Multisine.design(2500, 2500 * 3, (0.1 * 10 / 3, 7)).line, np.arange(1, 22))


def test_shape_and_sizes():
    shaped = Multisine.design(3000, 6000, (0.5, 250), shape_db_per_decade=-10, amplitude=2)
    np.testing.assert_allclose(shaped.amplitude, 2 / np.sqrt(shaped.line), rtol=1e-14)
    assert Multisine.design(3000, 6000, (0.5, 250), rms=7.0).rms == pytest.approx(7, rel=1e-14)
    by_peak = Multisine.design(3000, 6000, (0.5, 250), peak=179.0)
    assert by_peak.peak == pytest.approx(179, rel=1e-12)
    assert np.abs(by_peak.table()).max() == by_peak.peak
    assert Multisine.design(3000, 6000, (0.5, 250)).amplitude[0] == 1


def test_random_phases_repeat_with_their_seed():
    first, again, other = (Multisine.design(3000, 600, (5, 250), phases="random", seed=s) for s in (4, 4, 5))
    np.testing.assert_array_equal(first.phase_rad, again.phase_rad)
    assert np.abs(first.phase_rad - other.phase_rad).max() > 0.1
    assert first.seed == 4
    assert Multisine.design(3000, 600, (5, 250)).seed is None
    assert "random phases, seed 4" in repr(first)


@pytest.mark.parametrize(
    ("period", "band", "grid", "message"),
    [
        (6000, (5, 5), "full", r"no width; the nearest valid request is 5:5.5 Hz"),
        (6000, (7, 5), "full", r"no width; the nearest valid request is 7:7.5 Hz"),
        (6000, (5.1, 5.2), "full", r"no line in 5.1:5.2 Hz.* 0.5 Hz apart; .* 5:5.5 Hz"),
        (6000, (0.9, 1.1), "odd", r"no odd line .* 0.5:1.5 Hz"),
        (6000, (5, 1500), "full", r"reaches fs/2.* 5:1499.5 Hz"),
        (6000, (5, 2000), "odd", r"reaches fs/2.* 4.5:1499.5 Hz|reaches fs/2.* 5.5:1499.5 Hz"),
        (6000, (2000, 3000), "full", r"reaches fs/2.* 1499.5:1499.5 Hz"),
        (6000, (0, 10), "full", r"at or below 0.* 0.5:10 Hz"),
        (6000, (float("nan"), 10), "full", r"not finite"),
        (6000.25, (1, 10), "full", r"6000.25 samples is not a whole number.* 6000 samples"),
        (2, (1, 10), "full", r"2 samples.* 3 samples"),
        (float("inf"), (1, 10), "full", r"not a whole number"),
    ],
)
def test_degenerate_requests_name_the_nearest_valid_one(period, band, grid, message):
    with pytest.raises(ValueError, match=message):
        Multisine.design(3000, period, band, grid=grid)


def test_a_whole_period_may_be_a_float():
    assert Multisine.design(3000, 6000.0, (1, 10)).period_samples == 6000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fs_hz": 0}, "sample rate"),
        ({"fs_hz": float("nan")}, "sample rate"),
        ({"grid": "even"}, "grid must be one of full, odd"),
        ({"phases": "zero"}, "phases must be one of"),
        ({"phases": "random", "seed": -1}, "seed"),
        ({"shape_db_per_decade": float("inf")}, "slope"),
        ({"rms": 1.0, "peak": 2.0}, "one of amplitude, rms and peak, not rms and peak"),
        ({"rms": 0.0}, "rms must be a positive number"),
        ({"amplitude": float("nan")}, "amplitude must be a positive number"),
    ],
)
def test_misuse(arguments, message):
    with pytest.raises(ValueError, match=message):
        Multisine.design(**{"fs_hz": 3000, "period_samples": 6000, "band_hz": (1, 10)} | arguments)


def test_table_file_reads_back(tmp_path):
    multisine = Multisine.design(3000, 600, (5, 250), phases="random", seed=2, rms=3)
    path = tmp_path / "u.csv"
    multisine.write_table(path)
    text = path.read_text().splitlines()
    head = dict(line[2:].split(": ") for line in text if line.startswith("#"))
    assert head["fs_hz"] == "3000.0"
    assert head["period_samples"] == "600"
    assert head["hold"] == "zoh"
    assert text[len(head)] == "t_s,u"
    t_s, u = np.loadtxt(text[len(head) + 1 :], delimiter=",", unpack=True)
    np.testing.assert_array_equal(u, multisine.table())
    np.testing.assert_allclose(t_s, np.arange(600) / 3000)
    assert list(tmp_path.iterdir()) == [path]  # nothing half-written is left


def test_a_table_that_cannot_be_written_leaves_nothing(tmp_path):
    """Bug: the table was written under one fixed name, which stayed behind when the renaming failed."""
    path = tmp_path / "u.csv"
    path.mkdir()
    with pytest.raises(InputError, match=r"u\.csv: a folder"):
        Multisine.design(3000, 600, (5, 250)).write_table(path)
    assert list(tmp_path.iterdir()) == [path]


def test_repr_describes_the_object(schroeder):
    assert repr(schroeder).startswith("Multisine(500 full lines 0.5 .. 250 Hz, period 6000 at 3000 Hz")
    assert "Schroeder phases" in repr(schroeder)
