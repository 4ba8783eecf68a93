"""gsid fit with several inputs and outputs: its keys, its words, its files."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import gsid as package
from gsid.cli.fit_matrix import JSON_KEYS, note_ill_determined

FS_HZ, N, LINES = 1000.0, 1000, np.arange(1, 201)
POLES = 2 * np.pi * np.array([-2 + 30j, -5 + 90j])
RESIDUES = np.array([[[2.0, 0.3], [0.5, 1.5]], [[1.0, -0.8], [0.2, 3.0]]])  # [mode, output, input]
DELAY_S = 2e-3


def response(f_hz):
    """Two modes that both axes see, behind one delay."""
    s = 2j * np.pi * f_hz[:, None, None]
    modes = sum(r * s / (s**2 - 2 * p.real * s + abs(p) ** 2) for r, p in zip(RESIDUES, POLES, strict=True))
    return 100 * modes * np.exp(-s * DELAY_S)


@pytest.fixture
def experiments(tmp_path):
    """Two experiments with opposite sign of the second input, four periods each, and one more to judge on."""
    rng = np.random.default_rng(3)
    names = []
    for name, sign in (("a", 1), ("b", -1), ("new", 0.5j)):
        spectrum = np.zeros((N // 2 + 1, 2), complex)
        phase = np.exp(2j * np.pi * np.random.default_rng(5).random((len(LINES), 2)))
        spectrum[LINES] = phase * [1, sign] * N / 2 / np.sqrt(len(LINES))
        answer = np.zeros_like(spectrum)
        answer[LINES] = np.einsum("kij,kj->ki", response(LINES * FS_HZ / N), spectrum[LINES])
        u, y = (np.tile(np.fft.irfft(x, N, axis=0), (4, 1)) for x in (spectrum, answer))
        y = y + 0.01 * rng.standard_normal(y.shape)
        header = f"# fs_hz: {FS_HZ}\n# period_samples: {N}\n# settle_samples: 0\nu1,u2,y1,y2\n"
        rows = "\n".join(",".join(f"{x:.12g}" for x in row) for row in np.column_stack([u, y]))
        (tmp_path / f"{name}.csv").write_text(header + rows + "\n")
        names.append(f"{name}.csv")
    return names


CHANNELS = ("--u", "u1,u2", "--y", "y1,y2")


def test_json(gsid, experiments):
    *fitted, new = experiments
    options = ("--order", "4/3", "--delay", "common", "--held-out", new, "--json")
    result = gsid("fit", *fitted, *CHANNELS, *options)
    assert result.code == 0, result.err
    d = json.loads(result.out)
    assert d.keys() == {*JSON_KEYS, "std", "modes", "nrmse", "n_masked", "masked_hz"}
    assert (d["n_masked"], d["masked_hz"]) == (0, [])
    assert (d["inputs"], d["outputs"], d["n_poles"], d["n_zeros"]) == (["u1", "u2"], ["y1", "y2"], 4, 3)
    assert d["stable"]
    assert d["converged"]
    assert np.shape(d["num"]) == np.shape(d["std"]["num"]) == (2, 2, 4)
    for mode, pole in zip(d["modes"], POLES, strict=True):  # 5 standard deviations: once in 2e6
        assert abs(mode["f_hz"] - abs(pole) / (2 * np.pi)) < 5 * mode["std_f_hz"]
        assert abs(mode["damping"] + pole.real / abs(pole)) < 5 * mode["std_damping"]
    assert abs(d["delay_s"][0][0] - DELAY_S) < 5 * d["std"]["delay_s"][0][0]
    assert np.all(np.array(d["nrmse"]["held_out"]) < 0.02)


def test_words_and_files(gsid, experiments, tmp_path):
    files = ("-o", "m.json", "--plot", "m.png")
    result = gsid("fit", *experiments[:2], *CHANNELS, "--order", "4/3", "--band", "5:150", *files)
    assert result.code == 0, result.err
    first = "ml fit, 2 x 2 responses, 4 common poles, 24 parameters, 146 lines, converged, stable"
    assert result.out.startswith(first)
    assert "scatter over periods" in result.err
    model = package.load_model(tmp_path / "m.json")
    f = np.array([10.0, 100.0])
    assert np.all(np.abs(model.response(f) - response(f)) < 5 * model.response_std(f))
    assert (tmp_path / "m.png").stat().st_size > 20_000


def test_every_channel_has_its_own_unit(gsid, experiments, tmp_path):
    """Bug: all had that of the first, in the model file and in the picture."""
    units = {"u1": "V", "u2": "A", "y1": "deg/s", "y2": "m"}
    channels = [{"name": name, "unit": unit} for name, unit in units.items()]
    (tmp_path / "meta.json").write_text(json.dumps({"files": experiments, "channels": channels}))
    fit = ("fit", *experiments[:2], *CHANNELS, "--order", "4/3", "-o", "m.json", "--json")
    d = json.loads(gsid(*fit).out)
    model = package.load_model(tmp_path / "m.json")
    assert (d["u_units"], d["y_units"]) == (model.u_units, model.y_units) == (["V", "A"], ["deg/s", "m"])
    assert (model.channel(1, 0).y_unit, model.channel(1, 0).u_unit) == ("m", "V")
    labels = [ax.get_ylabel() for ax in model.plot().axes]
    expected = ("(deg/s)/V", "(deg/s)/A", "m/V", "m/A")
    assert [text for text in labels if "|G|" in text] == [f"|G| [dB re 1 {unit}]" for unit in expected]


def test_a_band_is_all_that_counts(gsid, experiments, tmp_path):
    """Bug: lines outside of the band ended the command, or counted in the error by extrapolation.

    The second experiment's inputs above 150 Hz are made those of the first, and its outputs ten times too
    large. The error left within the band is the noise: 0.01 rms over 500 lines, of which 146 count.
    """
    rows = {name: np.loadtxt(tmp_path / name, delimiter=",", skiprows=4) for name in experiments[:2]}
    first, second = (np.fft.rfft(each.reshape(4, N, 4), axis=1) for each in rows.values())
    in_band = second[:, 5:151, 2:].copy()
    second[:, 151:, :2], second[:, 151:, 2:] = first[:, 151:, :2], 10 * first[:, 151:, 2:]
    samples = np.fft.irfft(second, N, axis=1).reshape(-1, 4)
    header = f"# fs_hz: {FS_HZ}\n# period_samples: {N}\n# settle_samples: 0\nu1,u2,y1,y2"
    np.savetxt(tmp_path / "c.csv", samples, delimiter=",", header=header, comments="")
    fit = ("fit", experiments[0], "c.csv", *CHANNELS, "--order", "4/3", "--held-out", experiments[1])
    whole = gsid(*fit, "--json")
    assert whole.code == 0
    assert "do not separate the inputs there: 50 (" in whole.err
    assert json.loads(whole.out)["n_masked"] == 50
    upper = gsid(*fit, "--band", "120:240")
    assert upper.code == 3
    assert "cannot be separated at" in upper.err
    result = gsid(*fit, "--band", "5:150", "--json")
    assert result.code == 0, result.err
    d = json.loads(result.out)
    assert (d["n_lines"], d["band_hz"]) == (146, [5, 150])
    rms = np.sqrt(2 * np.sum(np.abs(in_band) ** 2, axis=(0, 1)) / 4) / N
    noise = 0.01 * np.sqrt(146 / 500) / rms
    # 1168 numbers leave 2 % of scatter, what the fit takes of them 1 %
    np.testing.assert_allclose(d["nrmse"]["held_out"], noise, rtol=0.15)
    assert "[%], 5 .. 150 Hz" in gsid(*fit, "--band", "5:150").out
    nowhere = gsid(*fit, "--band", "300:400")
    assert nowhere.code == 2
    assert "no line lies in 300:400 Hz" in nowhere.err


def test_an_order_found(gsid, experiments):
    *fitted, new = experiments
    fit = ("fit", *fitted, *CHANNELS, "--order", "auto", "--delay", "common", "--band", "5:120")
    d = json.loads(gsid(*fit, "--held-out", new, "--json").out)
    (chosen,) = (row for row in d["orders"] if row["chosen"])
    assert (chosen["order"], d["n_poles"], d["n_zeros"]) == ("4/3", 4, 3)
    assert chosen["interval"][0] < d["cost"] < chosen["interval"][1]
    words = gsid(*fit).out
    assert words.lstrip().startswith("order")
    assert "ml fit, 2 x 2 responses, 4 common poles" in words


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--order", "4/1"), "give as many zeros as poles or one fewer"),
        (("--order", "70/70"), "common poles must be 1 to 64"),
        (("--order", "4/3", "--method", "log"), "method must be one of iwls, nls, ml"),
        (("--order", "4/3", "--piecewise", "2"), "one input and one output"),
        (("--order", "4/3", "-o", "m.mat"), "written as .json"),
        (("--order", "4/3", "--plot", "m.txt"), ".png, .svg, .pdf, .json only"),
    ],
)
def test_usage(gsid, experiments, options, said):
    result = gsid("fit", *experiments[:2], *CHANNELS, *options)
    assert result.code == 2
    assert said in result.err


def test_too_few_experiments(gsid, experiments):
    result = gsid("fit", experiments[0], *CHANNELS, "--order", "4/3")
    assert result.code == 3
    assert "fewer experiments than inputs" in result.err
    assert "hint:" in result.err


def test_other_verbs_want_one_channel(gsid, experiments):
    result = gsid("noise", experiments[0], *CHANNELS)
    assert result.code == 3
    assert "no column named u1,u2" in result.err


def test_plot_of_one_response(gsid, experiments, tmp_path):
    result = gsid("fit", experiments[0], "--u", "u1", "--y", "y1", "--order", "4/3", "--plot", "one.svg")
    assert result.code == 0, result.err
    assert (tmp_path / "one.svg").read_text().startswith("<?xml")


COMPARE = ("compare", "--model", "m.json", "a.csv", "--u", "u1", "--y", "y1")


@pytest.mark.parametrize("verb", [COMPARE, ("export-c", "m.json", "-o", "m.c")])
def test_verbs_of_one_response_refuse_a_matrix(gsid, experiments, verb):
    fitted = gsid("fit", *experiments[:2], *CHANNELS, "--order", "4/3", "--method", "iwls", "-o", "m.json")
    assert fitted.code == 0, fitted.err
    result = gsid(*verb)
    assert result.code == 3
    assert "2 x 2 responses" in result.err
    assert "hint:" in result.err


@pytest.mark.parametrize("common", [True, False])
def test_an_ill_determined_delay_is_reported_once(common, capsys):
    """Bug: a common delay was said for each response, each time with the advice to take a common one."""
    model = SimpleNamespace(
        inputs=["u1", "u2"],
        outputs=["y1", "y2"],
        delay_of=np.zeros((2, 2), int) if common else np.arange(4).reshape(2, 2),
        delay_range_s=np.tile([1e-3, 2e-3], (2, 2, 1)),
        ill_determined_delays=np.full((2, 2), common) | np.array([[False, True], [False, False]]),
    )
    note_ill_determined(model)
    (note,) = capsys.readouterr().err.splitlines()
    assert ("common delay is" if common else "delay from u2 to y1 is") in note
    assert ("--delay common" in note) != common


def test_a_held_out_experiment_with_the_inputs_of_a_fitted_one_is_noted(gsid, experiments, tmp_path):
    (tmp_path / "again.csv").write_text(_with_more_noise((tmp_path / experiments[1]).read_text()))
    fit = ("fit", *experiments[:2], *CHANNELS, "--order", "4/3", "--delay", "common", "--held-out")
    assert f"again.csv has the same input as {experiments[1]}" in gsid(*fit, "again.csv").err
    assert "has the same input" not in gsid(*fit, experiments[2]).err


def _with_more_noise(text):
    head, rows = text.split("y1,y2\n")
    values = np.array([row.split(",") for row in rows.split()], dtype=float)
    values[:, 2:] += 0.01 * np.random.default_rng(8).standard_normal((len(values), 2))
    return f"{head}y1,y2\n" + "\n".join(",".join(f"{x:.12g}" for x in row) for row in values) + "\n"
