"""gsid noise: what it prints, writes and refuses; and frf without the disturbances."""

import json

import numpy as np
import pytest
from known_system import FS_HZ

from gsid.records.files import write_record

N = 8000


@pytest.fixture
def rest_csv(tmp_path):
    """A file without an input: white noise, and a disturbance at 30.9 Hz."""
    y = np.random.default_rng(1).standard_normal(N) + 0.3 * np.cos(2 * np.pi * 30.9 * np.arange(N) / FS_HZ)
    rows = "".join(f"{value:.9f}\n" for value in y)
    (tmp_path / "rest.csv").write_text(f"# fs_hz: {FS_HZ}\n# y_unit: deg/s\ny\n{rows}")
    return "rest.csv"


def test_json(gsid, rest_csv):
    result = gsid("noise", rest_csv, rest_csv, "--json")
    assert result.code == 0
    one, other = json.loads(result.out)["records"]
    assert one == other
    (tone,) = one["tones"]
    assert tone["name"].startswith("30.9")
    assert abs(tone["f_hz"] - 30.9) < 4 * tone["std_f_hz"]
    assert abs(tone["amplitude"] - 0.3) < 4 * tone["std_amplitude"]
    assert one["alpha"] == 0.01
    assert tone["p_value"] < 0.01
    low, high = np.array(one["psd_95"])
    assert ((low < one["psd"]) & (one["psd"] < high)).all()
    assert np.mean(one["psd"]) * FS_HZ / 2 == pytest.approx(1, abs=0.06)  # 4 sigma
    assert one["variance"] == pytest.approx(1 + 0.3**2 / 2, abs=0.06)
    assert (one["y_unit"], one["n_samples"], one["period_samples"]) == ("deg/s", N, 0)


def test_table_and_resolution(gsid, rest_csv):
    result = gsid("noise", rest_csv, "--period", "1000", "--alpha", "0.001")
    assert result.code == 0
    assert "windows of 1000" in result.err
    assert "rms [deg/s]" in result.out
    assert "density [deg/s/sqrt(Hz)]" in result.out
    assert "Periodic: 30.9" in result.out.splitlines()[-1]
    assert "(false-alarm rate 0.001)" in result.out


def test_picture(gsid, rest_csv, tmp_path):
    assert gsid("noise", rest_csv, "--plot", "noise.png").code == 0
    assert (tmp_path / "noise.png").stat().st_size > 10000
    assert gsid("noise", rest_csv, "--plot", "noise.txt").code == 2
    assert (
        "--plot draws the noise of one record" in gsid("noise", rest_csv, rest_csv, "--plot", "noise.png").err
    )


def test_a_named_input_must_be_there(gsid, rest_csv):
    result = gsid("noise", rest_csv, "--u", "command")
    assert result.code == 3
    assert "no column named command" in result.err
    assert gsid("noise", rest_csv, "--y", "rate").code == 3
    assert gsid("frf", rest_csv).code == 3  # only noise does without


def test_frf_without_the_disturbance(gsid, record, tmp_path):
    t_s = np.arange(len(record)) / record.fs_hz
    record.y = record.y + 0.5 * np.cos(2 * np.pi * 61.3 * t_s)
    write_record(tmp_path / "fan.csv", record)
    with_fan = json.loads(gsid("frf", "fan.csv", "--json").out)
    result = gsid("frf", "fan.csv", "--remove-periodic", "--json")
    without = json.loads(result.out)
    assert "periodic disturbances removed: 61.3" in result.err
    (tone,) = without["removed"]
    assert tone["amplitude"] == pytest.approx(0.5, rel=0.01)
    assert with_fan["removed"] == []
    near = int(np.argmin(np.abs(np.array(with_fan["f_hz"]) - 61.3)))
    assert without["var_g"][near] < 0.01 * with_fan["var_g"][near]
