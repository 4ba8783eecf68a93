"""gsid frf beyond settled periods: short records with their transient."""

import json

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from gsid.excitation.multisine import Multisine
from gsid.records.files import write_record
from gsid.records.record import Record

FS_HZ, N = 1000.0, 1000
B, A = [0, 0.5], [1, -0.95]


@pytest.fixture
def short_csv(tmp_path):
    """One period of a slow axis from rest."""
    m = Multisine.design(FS_HZ, N, (1, 100), phases="random", seed=1)
    y = lfilter(B, A, m.table()) + 0.01 * np.random.default_rng(1).standard_normal(N)
    write_record(tmp_path / "short.csv", Record(m.table(), y, FS_HZ))
    return "short.csv"


def test_one_period_from_rest(gsid, short_csv):
    result = gsid("frf", short_csv, "--lpm", "--period", N, "--json")
    assert result.code == 0
    values = json.loads(result.out)
    assert (values["method"], values["n_dof"], values["n_periods"]) == ("lpm", 9, 1)
    g = np.array(values["g_re"]) + 1j * np.array(values["g_im"])
    error = np.abs(g - freqz(B, A, values["f_hz"], fs=FS_HZ)[1])
    assert np.mean(error**2 / np.array(values["var_g"])) == pytest.approx(9 / 8, abs=0.5)
    without = gsid("frf", short_csv, "--period", N)
    assert without.code == 3
    assert "fewer than two good periods" in without.err
    said = gsid("frf", short_csv, "--lpm", "--period", N).err
    assert "1 period of 1000 samples" in said
    assert "transient by local polynomials (9 degrees of freedom)" in said


def test_random_noise_is_windowed_with_a_warning(gsid, tmp_path):
    rng = np.random.default_rng(2)
    u = rng.standard_normal(16384)
    record = Record(u, lfilter(B, A, u) + 0.1 * rng.standard_normal(len(u)), FS_HZ)
    write_record(tmp_path / "random.csv", record)
    result = gsid("frf", "random.csv", "--json")
    assert result.code == 0
    assert "warning: random.csv: averaging over 15 Hann windows of 2048 samples (H1)" in result.err
    values = json.loads(result.out)
    assert values["method"] == "windows"
    assert min(values["var_g"]) > 0
    assert len(values["coherence"]) == len(values["f_hz"])
    assert "random.csv: 15 windows of 2048 samples" in gsid("frf", "random.csv").err
    finer = json.loads(gsid("frf", "random.csv", "--window", "256", "--band", "50:400", "--json").out)
    assert finer["period_samples"] == 256
    g = np.array(finer["g_re"]) + 1j * np.array(finer["g_im"])
    ratio = np.abs(g - freqz(B, A, finer["f_hz"], fs=FS_HZ)[1]) ** 2 / finer["var_g"]
    assert ratio.mean() == pytest.approx(1, abs=0.4)
    assert gsid("compare", "--model", "none.json", "random.csv").code == 3
    assert gsid("fit", "random.csv", "--order", "1/0", "--band", "5:400").code == 0


def test_parts_and_weak_lines(gsid, record, tmp_path):
    for name, part in (("a", slice(0, 800)), ("b", slice(800, None))):
        write_record(tmp_path / f"{name}.csv", Record(record.u[part], record.y[part], FS_HZ, 400, 0))
    write_record(tmp_path / "whole.csv", Record(record.u, record.y, FS_HZ, 400, 0))
    whole = json.loads(gsid("frf", "whole.csv", "--json").out)
    merged = json.loads(gsid("frf", "a.csv", "b.csv", "--merge", "--json").out)
    assert (merged["n_periods"], merged["n_realisations"]) == (6, 1)
    np.testing.assert_allclose(merged["g_re"], whole["g_re"], rtol=1e-9)
    np.testing.assert_allclose(merged["var_g"], whole["var_g"], rtol=1e-6)
    none = gsid("frf", "whole.csv", "--min-input", "1000")
    assert none.code == 3
    assert "no line reaches the minimum input amplitude" in none.err
    assert gsid("frf", "whole.csv", "--lpm", "--window", "100").code == 2


def test_plot_draws_the_response(gsid, rec_csv, tmp_path):
    table = gsid("frf", rec_csv, "--plot", "g.png")
    assert (table.code, "wrote g.png" in table.err) == (0, True), table.err
    assert "|G| [dB]" in table.out
    assert (tmp_path / "g.png").stat().st_size > 10000
    both = gsid("frf", rec_csv, "-o", "g.csv", "--plot", "h.svg", "--json")
    assert {"f_hz", "var_g"} <= json.loads(both.out).keys()
    assert (tmp_path / "g.csv").is_file()
    assert (tmp_path / "h.svg").is_file()
    assert gsid("frf", rec_csv, "--plot", "g.txt").code == 2


def test_images_of_a_gyro_that_is_refreshed_at_400_hz_are_reported(gsid):
    """The excitation of `gsid run` reaches 250 Hz."""
    rates = {"every-tick": None, "locked": "400 Hz", "free-running": "400.02 Hz"}
    for gyro, rate in rates.items():
        made = gsid("run", "--simulate", f"--gyro {gyro} --seed 5", "--periods", "3", "-o", f"{gyro}.csv")
        assert made.code == 0, made.err
        seen = gsid("look", f"{gyro}.csv", "--json")
        found = json.loads(seen.out)["records"][0]["refresh_hz"]
        shown = gsid("frf", f"{gyro}.csv", "-o", "g.csv")
        assert shown.code == 0, shown.err
        if rate is None:
            assert found is None
            assert "refreshed" not in shown.err
            continue
        assert f"{found:.5g} Hz" == rate
        assert f"y is refreshed at {rate} and the input has lines up to 250 Hz" in shown.err
        assert "refreshed" not in gsid("frf", f"{gyro}.csv", "--band", "1:149", "-o", "g.csv").err
