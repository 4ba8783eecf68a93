"""Several inputs and outputs by commands: design, simulated gimbal, response, distortion."""

import json

import numpy as np
import pytest

from gsid.models.rational import RationalModel
from gsid.rig.gimbal import Gimbal

pytestmark = pytest.mark.xdist_group("cli_gimbal")

CHANNELS = ("--u", "u1,u2,u3,u4", "--y", "y1,y2,y3,y4")
DESIGN = ("--fs", "200", "--period", "200", "--band", "2:80", "--amplitudes", "0.1,0.04,0.008,0.003")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two realisations, measured with a rough outer elevation."""
    from gsid.cli.main import main

    here = tmp_path_factory.mktemp("gimbal")
    assert main(["design", "orthogonal", *DESIGN, "--realisations", "2", "-o", str(here / "exc")]) == 0
    excitations = [str(here / "exc" / f"{i:02d}.csv") for i in range(1, 9)]
    friction = ("--friction", "outer_elevation=0.03", "--truth", str(here / "truth.json"))
    assert main(["gimbal", *excitations, "-o", str(here / "rec"), *friction]) == 0
    return here


def records(folder):
    return [folder / "rec" / f"{i:02d}.csv" for i in range(1, 9)]


def test_distortion_names_the_rough_axis(gsid, folder):
    result = gsid("distortion", *records(folder), *CHANNELS, "--json")
    assert result.code == 0, result.err
    d = json.loads(result.out)
    assert d["distorted_inputs"] == ["u2"]
    assert (d["n_experiments"], d["n_realisations"], d["n_periods"]) == (8, 2, 24)
    assert [one["name"] for one in d["outputs"]] == ["y1", "y2", "y3", "y4"]
    assert "It enters at the input u2" in gsid("distortion", *records(folder), *CHANNELS).out


def test_frf_is_the_matrix_of_the_gimbal(gsid, folder):
    result = gsid("frf", *records(folder)[:4], *CHANNELS, "--band", "30:80", "--json")
    assert result.code == 0, result.err
    d = json.loads(result.out)
    g = np.array(d["g_re"]) + 1j * np.array(d["g_im"])
    error = np.abs(g - Gimbal(fs_hz=200.0).linear_response(d["f_hz"]))
    assert np.mean(error < 3 * np.sqrt(d["var_g"])) > 0.9  # friction changes the response slightly
    assert d["source"] == "periods"
    lines = gsid("frf", *records(folder)[:4], *CHANNELS, "--band", "30:80").out.splitlines()
    assert len(lines) == 1 + 16 * len(d["f_hz"])


def test_compare_tests_all_outputs_together(gsid, folder):
    fit = ("fit", *records(folder)[:4], *CHANNELS, "--order", "7/6", "--delay", "none", "-o", "m.json")
    assert gsid(*fit).code == 0
    result = gsid("compare", *records(folder)[4:], *CHANNELS, "--model", "m.json", "--json")
    assert result.code == 0, result.err
    d = json.loads(result.out)
    assert [one["name"] for one in d["outputs"]] == ["y1", "y2", "y3", "y4"]
    assert d["model_uncertainty"] == "included"
    assert 0 <= d["p_value"] <= 1
    text = gsid(
        "compare", *records(folder)[4:], *CHANNELS, "--model", "m.json", "--alpha", "0.999", "--check"
    )
    assert text.code == 1
    assert text.out.startswith("The model is not adequate")
    assert "y4 [deg/s]" in text.out


def test_the_truth_has_the_friction(folder):
    truth = json.loads((folder / "truth.json").read_text())
    assert truth["parameters"]["friction_nm"] == [0, 0.03, 0, 0]
    assert np.shape(truth["mass_kg_m2"]) == np.shape(truth["gyros"]) == (4, 4)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("frf", "R", *CHANNELS, "--lpm"), 2, "--lpm: for one input and one output"),
        (("distortion", "R", *CHANNELS, "--other-level", "R"), 2, "--other-level: for one input"),
        (("compare", "R", *CHANNELS, "--model", "SISO"), 3, "not a model of several inputs and outputs"),
        (("frf", "R", *CHANNELS), 3, "fewer experiments than inputs"),
        (("gimbal", "E", "-o", "new", "--friction", "azimuth=1"), 2, "no axis azimuth"),
        (("gimbal", "E", "-o", "new", "--angle-deg", "1,2"), 2, "angle_deg must be 4 finite numbers"),
        (("gimbal", "E", "-o", "new", "--periods", "1"), 2, "at least 2 periods"),
        (("gimbal", "R", "E", "-o", "new"), 3, "differ in rate or length"),
        (("gimbal", "E", "-o", "EXC"), 3, "the output would replace an input"),
        (("design", "orthogonal", *DESIGN[:-1], "1,-2", "-o", "new"), 2, "positive numbers"),
    ],
)
def test_what_does_not_work_is_named(gsid, folder, arguments, code, message):
    names = {"R": records(folder)[0], "E": folder / "exc" / "01.csv", "EXC": folder / "exc"}
    names["SISO"] = folder / "siso.json"
    RationalModel([1.0], [1.0]).save(names["SISO"])
    result = gsid(*(names.get(one, one) for one in arguments))
    assert (result.code, message in result.err) == (code, True), result.err
