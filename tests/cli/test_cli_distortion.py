"""gsid distortion: its keys, its words, the measured benches."""

import json

import numpy as np
import pytest
from known_system import FS_HZ, LINES, N_PERIOD, response

from gsid.records.files import write_record
from gsid.records.record import Record
from measured import BENCH, needs_bench


def write_realisations(tmp_path, size=1.0, cubic=0.05, line=LINES[1::2], stem="r"):
    """Three records of four periods: the known system behind x + cubic x^3, odd lines."""
    rng = np.random.default_rng(7)
    names = []
    for i in range(3):
        spectrum = np.zeros(N_PERIOD // 2 + 1, complex)
        spectrum[line] = size * np.exp(2j * np.pi * rng.random(len(line))) * N_PERIOD / 2 / np.sqrt(len(line))
        u = np.fft.irfft(spectrum, N_PERIOD)
        g = response(np.arange(len(spectrum)) * FS_HZ / N_PERIOD)
        y = np.tile(np.fft.irfft(np.fft.rfft(u + cubic * u**3) * g, N_PERIOD), 4)
        record = Record(
            np.tile(u, 4), y + 0.003 * rng.standard_normal(len(y)), FS_HZ, N_PERIOD, 0, y_unit="deg/s"
        )
        names.append(f"{stem}{i}.csv")
        write_record(tmp_path / names[-1], record)
    return names


def test_json(gsid, tmp_path):
    result = gsid("distortion", *write_realisations(tmp_path), "--json")
    assert result.code == 0, result.err
    d = json.loads(result.out)
    contract = {"f_hz", "bla_re", "bla_im", "var_noise", "var_total", "std_nonlinear", "even", "odd"}
    assert contract <= d.keys()
    assert (d["n_realisations"], d["n_periods"], d["y_unit"]) == (3, 12, "deg/s")
    odd = LINES[1::2] * FS_HZ / N_PERIOD
    assert d["f_hz"] == odd.tolist()
    for name in ("bla_re", "var_noise", "var_total", "std_nonlinear", "coherence"):
        assert len(d[name]) == len(odd)
    assert len(d["even"]) == len(d["even_hz"]) == len(d["even_noise"]) == 39
    assert np.median(np.array(d["var_total"]) / d["var_noise"]) > 10
    assert "averaging longer will not help" in d["verdict"]


def test_table_and_verdict(gsid, tmp_path):
    result = gsid("distortion", *write_realisations(tmp_path), "--band", "50:70")
    lines = result.out.splitlines()
    assert lines[0].split() == [
        "f",
        "[Hz]",
        "|G|",
        "[dB]",
        "noise",
        "[dB]",
        "total",
        "[dB]",
        "distortion",
        "[dB]",
    ]
    assert len(lines) == 6  # four odd lines 5 Hz apart, and the verdict
    assert "3 realisations, 12 periods of 400 samples, 4 lines excited" in result.err


def test_other_level(gsid, tmp_path):
    low, high = write_realisations(tmp_path), write_realisations(tmp_path, 2.0, stem="h")
    result = gsid("distortion", *low, *(x for name in high for x in ("--other-level", name)))
    assert "At 2 times the input the response changes" in result.out
    change = json.loads(gsid("distortion", *low, "--other-level", high[0], "--json").out)["superposition"]
    assert change["level_ratio"] == pytest.approx(2)
    assert change["p_value"] < 1e-6
    mixed = gsid("distortion", low[0], high[0])
    assert mixed.code == 3
    assert "different input levels" in mixed.err
    assert "--other-level" in mixed.err


def test_harmonics_of_a_sine(gsid, tmp_path):
    (name, *_) = write_realisations(tmp_path, line=np.array([8]), cubic=0.2)
    result = gsid("distortion", name)
    assert "amplitude [deg/s]  below the sine [dB]  above noise [dB]" in result.out
    values = json.loads(gsid("distortion", name, "--json").out)
    assert values["noncausal_power_ratio"] is None  # of one line
    harmonics = {h["order"]: h for h in values["harmonics"]}
    # of x + c x^3 with amplitude 1: 1 + 3c/4 and c/4, times the responses at 20 and 60 Hz
    want = 20 * np.log10(np.abs(response(20.0) * 1.15 / (response(60.0) * 0.05)))
    assert harmonics[3]["below_fundamental_db"] == pytest.approx(want, abs=0.1)


def test_plot_draws_the_distortion_or_the_change_between_levels(gsid, tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    labels, save = [], Figure.savefig

    def keep_labels(figure, *args, **options):
        labels.append([ax.get_ylabel() for ax in figure.axes])
        return save(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", keep_labels)
    low, high = write_realisations(tmp_path), write_realisations(tmp_path, 2.0, stem="h")
    one = gsid("distortion", *low, "--plot", "levels.png")
    assert (one.code, "wrote levels.png" in one.err) == (0, True), one.err
    two = gsid("distortion", *low, "--other-level", high[0], "--plot", "change.png")
    assert two.code == 0, two.err
    assert "σ" in labels[0][0]
    assert "ΔG" in labels[1][1]
    assert min((tmp_path / name).stat().st_size for name in ("levels.png", "change.png")) > 10000
    assert gsid("distortion", *low, "--plot", "levels.txt").code == 2


def test_plot_of_a_sine(gsid, tmp_path):
    (name, *_) = write_realisations(tmp_path, line=np.array([8]), cubic=0.2)
    assert gsid("distortion", name, "--plot", "sine.png").code == 0
    assert (tmp_path / "sine.png").stat().st_size > 10000


def test_report_has_the_picture(gsid, tmp_path):
    result = gsid("report", *write_realisations(tmp_path), "-o", "page.html")
    assert result.code == 0, result.err
    page = (tmp_path / "page.html").read_text()
    assert "Noise and distortion" in page
    assert "averaging longer will not help" in page


@needs_bench
def test_the_two_mass_bench_distorts_at_low_frequency(gsid):
    """The bench's owner names bearing friction: odd distortion at low frequency."""
    names = ["--u", "iq", "--y", "omega_motor", "--fs", 2500, "--band", "11:250"]
    result = gsid("distortion", BENCH / "multisine_B.npz", *names, "--json")
    assert result.code == 0, result.err
    d = json.loads(result.out)
    assert d["orders_apart"]
    first = d["bands"][0]
    assert first["f_lo_hz"] == 13
    assert "odd" in first["kind"]
    assert first["low_db"] > 20
    assert first["high_db"] == max(band["high_db"] for band in d["bands"])
