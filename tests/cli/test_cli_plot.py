"""gsid plot: several responses in one picture, by file or by level."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gsid.models.load import load_model
from gsid.plots.leakage import leakage
from gsid.plots.responses import model_errors, responses
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.response.estimate import frf


@pytest.fixture
def levels(record, tmp_path):
    """The same linear axis, excited at three levels: noise stays, so that sigma of G falls with the level."""
    rng = np.random.default_rng(5)
    quiet = record.y - 0.0
    for name, factor in (("c", 4.0), ("a", 1.0), ("b", 2.0)):
        y = factor * quiet + 0.05 * rng.standard_normal(len(quiet))
        write_record(tmp_path / f"{name}.csv", replace(record, u=factor * record.u, y=y))
    return ["c.csv", "a.csv", "b.csv"]


def test_by_file_in_the_order_typed_and_by_level_in_that_of_levels(gsid, levels, tmp_path):
    result = gsid("plot", *levels, "--plot", "all.png", "--json")
    assert result.code == 0, result.err
    assert [one["name"] for one in json.loads(result.out)["responses"]] == levels
    assert (tmp_path / "all.png").stat().st_size > 10000
    result = gsid("plot", *levels, "--legend", "level", "--json")
    shown = json.loads(result.out)["responses"]
    rms = [one["rms_u"] for one in shown]
    np.testing.assert_allclose(np.array(rms) / rms[0], [1, 2, 4], rtol=1e-9)
    assert [one["name"].endswith("A rms") for one in shown] == [True] * 3
    assert (tmp_path / "responses.png").exists()
    assert "rms of u" in gsid("plot", *levels).out


def test_the_picture_has_every_response_with_its_own_colour(record):
    """Points are 20 log10 |G| of numpy; sigma is that of the variance."""
    one = frf(record)
    figure = responses([("one", one), ("other", replace(one, g=2 * one.g))])
    gain, phase, sigma = figure.axes
    first, second = gain.lines[:2]
    np.testing.assert_allclose(first.get_ydata(), 20 * np.log10(np.abs(one.g)))
    np.testing.assert_allclose(second.get_ydata() - first.get_ydata(), 20 * np.log10(2))
    assert first.get_color() != second.get_color()
    assert sigma.lines[0].get_color() == first.get_color()
    np.testing.assert_allclose(sigma.lines[0].get_ydata(), 10 * np.log10(one.var_g))
    assert len(phase.lines) == 2


def test_a_response_file_a_band_and_what_does_not_match(gsid, record, rec_csv):
    gsid("frf", rec_csv, "-o", "response.csv")
    both = json.loads(gsid("plot", rec_csv, "response.csv", "--json").out)["responses"]
    assert both[0] | {"name": ""} == pytest.approx(both[1] | {"name": ""})
    (part,) = json.loads(gsid("plot", rec_csv, "--band", "20:50", "--json").out)["responses"]
    assert part["f_lo_hz"] >= 20
    assert part["f_hi_hz"] <= 50
    assert gsid("plot", rec_csv, "--band", "399:400").code == 3
    write_record("volts.csv", replace(record, u_unit="V"))
    result = gsid("plot", rec_csv, "volts.csv")
    assert (result.code, "different units" in result.err) == (3, True)


def test_the_errors_of_models_fall_with_their_order(gsid, record, rec_csv):
    for order in ("1/0", "2/1", "2/0"):
        path = f"m{order[0]}{order[2]}.json"
        assert gsid("fit", rec_csv, "--order", order, "-o", path).code == 0
    models = [word for path in ("m10.json", "m20.json", "m21.json") for word in ("--model", path)]
    result = gsid("plot", rec_csv, *models, "--plot", "errors.svg")
    assert result.code == 0, result.err
    one = frf(record)
    model = load_model("m10.json")
    figure = model_errors(one, [("1/0", model)])
    label = figure.axes[0].lines[-1].get_label()
    error = np.abs(one.g - model.response(one.f_hz))
    np.testing.assert_allclose(figure.axes[0].lines[-1].get_ydata(), 20 * np.log10(error))
    share = 100 * np.linalg.norm(error) / np.linalg.norm(one.g)
    assert label == f"|error| of 1/0: {share:.2g} % rms"
    assert gsid("plot", rec_csv, rec_csv, *models).code == 2
    gsid("start", rec_csv, "-o", "stack.json")
    assert gsid("plot", rec_csv, "--model", "stack.json").code == 3


def test_a_period_that_is_not_whole_leaks_as_the_kernel_of_dirichlet(gsid, tmp_path):
    """A cosine over 1.2 periods of 3 cycles has 3.6 cycles: the sum of two geometric series."""
    n, cycles = 500, 3
    u = np.cos(2 * np.pi * cycles * np.arange(4 * n) / n)
    record = Record(u, u, 1000.0, n, 0, y_unit="deg/s", name="sine")
    left, right = (ax.lines[0].get_ydata() for ax in leakage(record, 1.2).axes)
    assert left[cycles - 1] == pytest.approx(0, abs=1e-9)
    assert np.delete(left, cycles - 1).max() < -200
    length, k = 600, np.arange(1, 301)

    def series(shift):
        return (np.exp(2j * np.pi * shift) - 1) / (np.exp(2j * np.pi * shift / length) - 1)

    expected = np.abs(series(3.6 - k) + series(-3.6 - k)) / length
    np.testing.assert_allclose(right, 20 * np.log10(expected), atol=1e-6)
    write_record("sine.csv", record)
    assert gsid("plot", "sine.csv", "--leakage", "1.2", "--plot", "leakage.png").code == 0
    assert (tmp_path / "leakage.png").stat().st_size > 5000
    assert gsid("plot", "sine.csv", "--leakage", "9").code == 3
    assert gsid("plot", "sine.csv", "sine.csv", "--leakage", "1.2").code == 2


def test_options_without_effect_are_refused(gsid, rec_csv):
    for options in (("--leakage", "1.2", "--band", "2:10"), ("--leakage", "1.2", "--legend", "level")):
        refused = gsid("plot", rec_csv, *options)
        assert (refused.code, "--leakage does not use" in refused.err) == (2, True)
    assert gsid("fit", rec_csv, "--order", "2/0", "-o", "m.json").code == 0
    assert gsid("plot", rec_csv, "--model", "m.json", "--legend", "level").code == 2
