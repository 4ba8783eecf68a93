"""Binary sequences, sweeps and stepped sines: the source's figures, spectra line by line, refusals."""

import numpy as np
import pytest
from scipy.signal import chirp

from gsid.excitation.generators import Prbs, SteppedSine, Sweep
from gsid.excitation.multisine import GRIDS, Multisine
from gsid.excitation.periodic import crest_factor

FS_HZ = 3000.0

# ---------------------------------------------------------------- the source's figures


def test_source_definition_3_5_1_schroeder_crest_factor_1_73():
    """500 lines of 3 V, the "offset phase" of 0.2793 rad added to every line's."""
    m = Multisine.design(FS_HZ, 6000, (0.5, 250), amplitude=3.0, offset_phase_rad=0.2793)
    k, t = np.arange(1, 501)[:, None], np.arange(6000) / FS_HZ
    u = 3 * np.cos(np.pi * k * t - k * (k - 1) * np.pi / 500 + 0.2793).sum(axis=0)
    np.testing.assert_allclose(m.table(), u, atol=1e-9)
    assert len(m.line) == 500
    assert m.crest_factor == pytest.approx(1.734, abs=0.0005)
    assert m.p_int_over_p_tot == pytest.approx(1)


def test_source_section_3_6_prbs():
    """1553 chips at 750 Hz, 45 V, band 0.48 to 300 Hz: crest 1.21, P_int/P_tot 0.68, period 2.07 s."""
    p = Prbs.design(FS_HZ, 4 * 1553, (0.48, 300), amplitude=45.0)
    assert (p.n_chips, p.n_hold, FS_HZ / p.n_hold) == (1553, 4, 750)
    assert p.period_samples / FS_HZ == pytest.approx(2.07, abs=0.005)
    assert p.crest_factor == pytest.approx(1.21, abs=0.005)
    assert p.p_int_over_p_tot == pytest.approx(0.68, abs=0.005)


def test_source_section_3_7_log_sweep():
    """0.5 to 250 Hz in 2 s, cosine of 45 degrees: P_int/P_tot 0.99, and a crest factor of 1.51 once its mean
    is taken off (EXC-7). As definition 3.2.1 stands, with the mean, it is 1.465."""
    s = Sweep.design(
        FS_HZ, 6000, (0.5, 250), kind="log", amplitude=16, phase_rad=np.radians(135), continuous=False
    )
    t = np.arange(6000) / FS_HZ
    np.testing.assert_allclose(s.table(), 16 * chirp(t, 0.5, 2.0, 250, "logarithmic", phi=45), atol=1e-9)
    assert int(100 * s.p_int_over_p_tot) == 99
    assert s.crest_factor == pytest.approx(1.465, abs=0.001)
    assert crest_factor(s.table() - s.table().mean(), s.line) == pytest.approx(1.51, abs=0.005)
    named = Sweep.design(
        *(FS_HZ, 6000, (0.5, 250)),
        kind="log",
        amplitude=16,
        phase_rad=np.radians(45),
        phase_of="cosine",
        has_mean=False,
        continuous=False,
    )
    np.testing.assert_allclose(named.table(), s.table() - s.table().mean(), atol=1e-9)
    assert named.crest_factor == pytest.approx(1.51, abs=0.005)
    schroeder = Multisine.design(FS_HZ, 6000, (0.5, 250))
    assert abs(schroeder.table().mean()) < 1e-12  # the source's other signals have none: their figures stand
    prbs = Prbs.design(FS_HZ, 4 * 1553, (0.48, 300)).table()
    assert abs(prbs.mean()) < 1e-3


# ---------------------------------------------------------------- spectra, line by line


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("shape", [0.0, -10.0])
def test_every_line_of_a_multisine(grid, shape):
    """Over three periods, from the middle of one on: the lines asked for, each of its size, no others."""
    n = 1000
    m = Multisine.design(1000.0, n, (2, 300), grid=grid, phases="random", seed=3, shape_db_per_decade=shape)
    u = np.tile(m.table(), 4)[321 : 321 + 3 * n]
    lines = np.fft.rfft(u) * 2 / len(u)
    want = np.zeros(len(lines), complex)
    want[3 * m.line] = m.spectrum() * np.exp(2j * np.pi * m.line * 321 / n)
    np.testing.assert_allclose(lines, want, atol=1e-12)
    np.testing.assert_allclose(np.abs(want[3 * m.line]), (m.line / m.line[0]) ** (shape / 20), rtol=1e-12)


@pytest.mark.parametrize(("n_chips", "sizes"), [(1551 - 52, 1), (1553, 2)])
def test_every_line_of_a_prbs(n_chips, sizes):
    """Lines of sqrt(N + 1) where N = 4 k - 1, of sqrt(N) +- 1 where it is not; the hold shapes both."""
    n_hold = 3
    p = Prbs(FS_HZ, n_chips, n_hold, np.arange(1, 100))
    k = np.arange(1, n_chips * n_hold // 2)
    k = k[k % n_chips != 0]
    hold = np.abs(np.sin(np.pi * k / n_chips) / np.sin(np.pi * k / (n_chips * n_hold)))
    of_chips = np.abs(np.fft.rfft(p.table())[k]) / hold
    root = np.sqrt(n_chips)
    want = [np.sqrt(n_chips + 1)] if sizes == 1 else [root - 1, root + 1]
    away = np.min(np.abs(of_chips[:, None] - want), axis=1)
    assert away.max() < 1e-9 * root
    assert n_chips % 4 == (3 if sizes == 1 else 1)


def test_every_line_of_a_maximum_length_sequence():
    p = Prbs.design(FS_HZ, 1023 * 4, (1, 300), kind="maximum-length")
    lines = np.abs(np.fft.rfft(p.table()[::4]))
    np.testing.assert_allclose(lines[1:], 32, rtol=1e-10)  # sqrt(2^10)
    assert lines[0] == pytest.approx(1)


@pytest.mark.parametrize("kind", ["linear", "log"])
def test_a_continuous_sweep_has_no_jump(kind):
    """A jump shows far above the band: lines fall by 12 dB an octave without, by 6 dB with one."""
    s = Sweep.design(FS_HZ, 6000, (5, 250), kind=kind)
    assert s.turns == pytest.approx(round(s.turns), abs=1e-9)
    assert 249 < s.f_stop_hz <= 250
    with_jump = Sweep.design(FS_HZ, 6000, (5, 250.13), kind=kind, continuous=False)

    def above(signal):
        return np.sqrt(np.sum(np.abs(np.fft.rfft(signal.table())[2500:]) ** 2))

    assert above(s) < 0.5 * above(with_jump)
    inside = np.abs(np.fft.rfft(s.table())[s.line]) * 2 / 6000
    slope = np.polyfit(np.log10(s.line[20:400]), 20 * np.log10(inside[20:400]), 1)[0]
    assert slope == pytest.approx(0 if kind == "linear" else -10, abs=0.5)  # time spent at f: even, or as 1/f


def test_a_stepped_sine_measures_each_line():
    """An axis that settles within the settling gives its response in every estimation period."""
    from scipy.signal import lfilter

    s = SteppedSine.design(1000.0, 500, (2, 200), settle_samples=200, n_periods=2)
    u = s.table()
    y = lfilter([0.2], [1, -0.8], u)
    each = 200 + 2 * 500
    for i, k in enumerate(s.line):
        part = slice(i * each + 200, (i + 1) * each)
        U, Y = (np.fft.rfft(x[part].reshape(2, 500))[:, k] for x in (u, y))
        want = 0.2 / (1 - 0.8 * np.exp(-2j * np.pi * k / 500))
        np.testing.assert_allclose(Y / U, want, rtol=1e-9)
    assert s.period_samples == len(s.line) * each


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: Prbs.design(3000, 6000, (1, 300)), "the nearest valid request is 5996 samples"),
        (lambda: Prbs.design(3000, 4000, (1, 300), kind="maximum-length"), "4092 samples"),
        (lambda: Prbs.design(3000, 6212, (1, 1500)), "reaches fs/2"),
        (lambda: Prbs.design(3000, 6212, (1, 300), kind="gold"), "quadratic-residue, maximum-length"),
        (lambda: Prbs.design(3000, 6212, (1, 300), amplitude=0), "positive"),
        (lambda: Prbs.design(np.inf, 6212, (1, 300)), "sample rate"),
        (lambda: Prbs.design(3000, 0, (1, 300)), "the nearest valid request is 3 samples"),
        (lambda: Prbs.design(3000, 69, (1, 10)), "no line"),  # was taken, with no line of interest
        (lambda: Sweep.design(3000, 6000, (5, 5)), "nearest valid request"),
        (lambda: Sweep.design(3000, 6000.5, (5, 50)), "the nearest valid request is 6000 samples"),
        (lambda: Sweep.design(3000, 6000, (5, 50), kind="square"), "linear, log"),
        (lambda: Sweep.design(3000, 300, (11, 19)), "no line"),
        (lambda: Sweep.design(3000, 6000, (0.501, 0.999), continuous=True), "no line"),
        (lambda: SteppedSine.design(3000, 3000, (1, 100), n_periods=0), "1 period"),
        (lambda: SteppedSine.design(3000, 3000, (1, 100), settle_samples=-1), "0 or more"),
        (lambda: Multisine.design(3000, 3000, (2, 2.5), grid="odd-random"), "no odd line"),
    ],
)
def test_refused_with_the_nearest_request(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()


def test_scaling_and_files(tmp_path):
    from gsid.records.files import read_record

    signals = [
        Prbs.design(FS_HZ, 4 * 1499, (1, 300)),
        Sweep.design(FS_HZ, 600, (10, 250)),
        SteppedSine.design(FS_HZ, 60, (50, 500)),
        Multisine.design(FS_HZ, 600, (10, 250)),
    ]
    for i, s in enumerate(signals):
        np.testing.assert_allclose(s.scaled(3.0).table(), 3 * s.table(), rtol=1e-12, atol=1e-12)
        assert s.scaled(3.0).crest_factor == pytest.approx(s.crest_factor)
        path = tmp_path / f"{i}.csv"
        s.write_table(path)
        record = read_record(path, u="u", y="u")
        np.testing.assert_array_equal(record.u, s.table())
        assert record.fs_hz == FS_HZ
        assert repr(s)
    assert crest_factor(signals[0].table()) == pytest.approx(1)
