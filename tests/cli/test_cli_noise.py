"""gsid noise: what it prints, writes and refuses; and frf without the disturbances."""

import json

import numpy as np
import pytest
from known_system import FS_HZ

from gsid.records.files import write_record
from gsid.spectrum.noise import Noise
from gsid.study.folder import Study

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


def test_zero_input_shows_fan_refresh_drift_and_keeps_the_noise_of_the_study(gsid, tmp_path):
    """The fan of the simulated axis turns at 30.9 Hz; a gyro refreshed at 400.02 Hz shows its images."""
    assert gsid("-C", "study", "open").code == 0
    gsid("-C", "study", "run", "--simulate", "", "--periods", "2", "-o", "excited.csv")
    result = gsid("-C", "study", "run", "--simulate", "--gyro free-running", "--zero", "20", "--json")
    assert result.code == 0, result.err
    answer = json.loads(result.out)
    assert answer["peak_command"] == 0
    assert answer["n_periods"] == 10
    fan, *images = answer["noise"]["tones"]
    assert abs(fan["f_hz"] - 30.9) < 4 * fan["std_f_hz"] < 0.01
    assert abs(fan["amplitude"] - 0.005) < 4 * fan["std_amplitude"]
    low = min(images, key=lambda tone: abs(tone["f_hz"] - 369.12))
    assert abs(low["f_hz"] + fan["f_hz"] - 400.02) < 4 * (low["std_f_hz"] + fan["std_f_hz"])
    assert abs(answer["noise"]["drift"]) < 4 * answer["noise"]["std_drift"]
    study = Study("study", create=False)
    assert study.noise_model == "responses/2-run-noise.json"
    kept = Noise.load(study.path(study.noise_model))
    assert kept.tones[0].f_hz == fan["f_hz"]
    assert study.last_experiment == ["records/1-run.csv"]  # which the next verbs use
    assert study.steps[-1].words[1] == answer["noise"]["sentence"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--zero", "1", "--periods", "2"), "--zero excites nothing: leave out --periods"),
        (("--zero", "1", "--amplitude", "2"), "--zero excites nothing: leave out --amplitude"),
        (("--zero", "0"), "0"),
        (("--zero", "1", "--attended"), "no response"),
        (("--noise-model", "n.json"), "--noise-model needs --zero"),
    ],
)
def test_zero_input_excites_nothing(gsid, options, words):
    result = gsid("run", "--simulate", "", *options)
    assert result.code == 2
    assert words in result.err


def test_noise_of_a_record_as_a_model(gsid, rest_csv):
    assert gsid("noise", rest_csv, "--noise-model", "n.json").code == 0
    assert Noise.load("n.json").n_samples == N
    assert gsid("noise", rest_csv, rest_csv, "--noise-model", "n.json").code == 2
