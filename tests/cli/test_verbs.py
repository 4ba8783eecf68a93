"""What the verbs print and write, against numpy and known systems."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from known_system import FS_HZ, LINES, N_PERIOD, N_PERIODS, response
from scipy.io import loadmat

from gsid.fitting import roots
from gsid.records.files import write_record
from gsid.records.record import Record
from measured import BENCH, needs_bench

NAMES = ["--u", "iq", "--y", "omega_motor"]


def numpy_frf(u, y, line, n_period):
    """Mean and its variance from numpy's FFT of the periods (thesis, eqs. 4.10, 4.11 and 7.29)."""
    U, Y = (np.fft.rfft(x.reshape(-1, n_period))[:, line] * 2 / n_period for x in (u, y))
    P, mean_u, mean_y = len(U), U.mean(0), Y.mean(0)
    g = mean_y / mean_u
    error = (Y - mean_y) - g * (U - mean_u)
    return g, np.sum(np.abs(error) ** 2, axis=0) / (P - 1) / P / np.abs(mean_u) ** 2


# ---------------------------------------------------------------- frf


def test_frf_json(gsid, record, rec_csv):
    result = gsid("frf", rec_csv, "--json")
    assert result.code == 0
    values = json.loads(result.out)
    assert {"f_hz", "g_re", "g_im", "var_g", "n_periods", "n_realisations"} <= values.keys()
    assert (values["n_periods"], values["period_samples"], values["settle_samples"]) == (
        N_PERIODS,
        N_PERIOD,
        0,
    )
    assert (values["n_realisations"], values["n_spoiled"], values["y_unit"]) == (1, 0, "deg/s")
    np.testing.assert_allclose(values["f_hz"], LINES * FS_HZ / N_PERIOD)
    g, var_g = numpy_frf(record.u, record.y, LINES, N_PERIOD)
    np.testing.assert_allclose(np.array(values["g_re"]) + 1j * np.array(values["g_im"]), g, rtol=1e-9)
    np.testing.assert_allclose(values["var_g"], var_g, rtol=1e-6)


def test_frf_table(gsid, record, rec_csv):
    result = gsid("frf", rec_csv, "--band", "50:70")
    lines = result.out.splitlines()
    assert lines[0].split("  ")[-1] == "sigma [dB]"
    assert [float(line.split()[0]) for line in lines[1:]] == list(np.arange(50, 70.1, 2.5))
    g, var_g = numpy_frf(record.u, record.y, LINES, N_PERIOD)
    at_60 = [float(x) for x in lines[5].split()]
    k = np.flatnonzero(LINES * FS_HZ / N_PERIOD == 60)[0]
    expected = [60, 20 * np.log10(abs(g[k])), np.degrees(np.angle(g[k])), 10 * np.log10(var_g[k])]
    np.testing.assert_allclose(at_60, expected, atol=0.006)  # printed with two or three decimals
    assert "6 periods of 400 samples at 1000 Hz, 1 realisation, 0 spoiled" in result.err


def test_table_on_a_terminal(gsid, rec_csv, monkeypatch):
    """Drawn by rich, which would take the units' brackets for markup."""
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    out = gsid("frf", rec_csv, "--band", "50:70").out
    for header in ("f [Hz]", "|G| [dB]", "phase [deg]", "sigma [dB]"):
        assert header in out
    assert "│" in out


def test_frf_files(gsid, rec_csv):
    values = json.loads(gsid("frf", rec_csv, "--json").out)
    for suffix in ("csv", "npz", "mat"):
        result = gsid("frf", rec_csv, "-o", f"frf.{suffix}")
        assert (result.code, result.out) == (0, "")
        assert f"wrote frf.{suffix}" in result.err
    n_keys = sum(line.startswith("#") for line in Path("frf.csv").read_text().splitlines())
    table = np.genfromtxt("frf.csv", delimiter=",", names=True, skip_header=n_keys)
    for name in ("f_hz", "g_re", "g_im", "var_g"):
        for read in (table[name], np.load("frf.npz")[name], loadmat("frf.mat")[name].ravel()):
            np.testing.assert_array_equal(read, values[name])
    assert "# n_periods: 6" in Path("frf.csv").read_text()


def test_frf_reports_lost_samples(gsid, record):
    from gsid.records.files import write_record

    record.valid[1000] = False
    write_record("lost.csv", record)
    values = json.loads(gsid("frf", "lost.csv", "--json").out)
    assert (values["n_periods"], values["n_spoiled"]) == (N_PERIODS - 1, 1)


# ---------------------------------------------------------------- fit and compare


def test_fit_json_and_compare(gsid, rec_csv):
    result = gsid("fit", rec_csv, "--order", "2/0", "-o", "model.json", "--json")
    assert result.code == 0
    values = json.loads(result.out)
    keys = {"method", "num", "den", "delay_s", "cost", "cost_expected", "std", "poles", "zeros", "converged"}
    assert keys <= values.keys()
    assert values["std"].keys() == {"num", "den", "delay_s"}
    assert len(values["std"]["den"]) == len(values["den"]) == 3
    assert len(values["std"]["num"]) == len(values["num"]) == 1
    assert abs(values["delay_s"] - 1.5e-3) < 4 * values["std"]["delay_s"]
    assert np.abs(np.array(values["poles"]) @ [1, 1j]) == pytest.approx(2 * np.pi * 60, rel=1e-3)
    assert values["zeros"] == []

    result = gsid("compare", rec_csv, "--model", "model.json", "--json", "--check")
    verdict = json.loads(result.out)
    keys = {"adequate", "p_value", "cost_per_dof", "rms_error", "noise_floor_rms", "where"}
    assert keys <= verdict.keys()
    assert verdict["adequate"] is True
    assert (verdict["n_periods"], verdict["n_realisations"]) == (N_PERIODS, 1)
    assert result.code == 0


def test_compare_rejects_a_wrong_model(gsid, rec_csv):
    assert gsid("fit", rec_csv, "--order", "1/0", "--delay", "none", "-o", "model.json").code == 0
    verdict = json.loads(gsid("compare", rec_csv, "--model", "model.json", "--json").out)
    assert verdict["adequate"] is False
    assert {"f_lo_hz", "f_hi_hz", "lines", "share"} <= verdict["where"][0].keys()
    plain = gsid("compare", rec_csv, "--model", "model.json")
    assert plain.code == 0
    assert plain.out.startswith("The model is not adequate: p = ")
    assert gsid("compare", rec_csv, "--model", "model.json", "--check").code == 1


def test_fit_in_words(gsid, rec_csv):
    out = gsid("fit", rec_csv, "--order", "2/0").out
    assert out.startswith("ml fit, 4 parameters, 78 lines, converged, stable")
    pole = next(line for line in out.splitlines() if line.startswith("pole")).split()
    assert float(pole[3]) == pytest.approx(60, rel=1e-3)
    assert float(pole[5]) == pytest.approx(0.1, rel=0.02)
    assert "= 1.5 samples" in out


@pytest.mark.parametrize("method", ["ls", "iwls", "nls", "log", "ml"])
def test_every_method_prints_its_cost_in_words(gsid, rec_csv, method):
    """A bug: the words wanted the cost expected of noise alone, which only maximum likelihood has."""
    result = gsid("fit", rec_csv, "--order", "2/0", "--method", method)
    assert result.code == 0
    assert ("expected of noise alone" in result.out) == (method == "ml")


def test_a_band_below_the_first_line(gsid, rec_csv):
    """A bug: a rational model says nothing of the mean, and numpy's words on an empty array came out."""
    assert gsid("fit", rec_csv, "--order", "2/0", "-o", "model.json").code == 0
    result = gsid("compare", rec_csv, "--model", "model.json", "--band", "0:1")
    assert result.code == 2
    assert "no line lies in 0:1 Hz; there are lines in 2.5:497.5 Hz" in result.err


# ---------------------------------------------------------------- design


BAND = ["--fs", "3000", "--period", "600", "--band", "5:250", "--lines", "odd"]
DESIGN = ["design", "multisine", *BAND, "--peak", "50", "--phases", "random", "--seed", "3"]


def test_design_json(gsid):
    values = json.loads(gsid(*DESIGN, "--json").out)
    keys = {"crest_factor", "crest_factor_fine", "p_int_over_p_tot", "period_samples", "n_lines", "peak"}
    assert keys | {"travel_deg"} <= values.keys()
    assert (values["n_lines"], values["period_samples"]) == (25, 600)
    assert values["peak"] == pytest.approx(50)
    assert values["p_int_over_p_tot"] == pytest.approx(1)


def test_design_files_hold_the_same_signal(gsid):
    for suffix in ("csv", "npz", "mat", "h"):
        assert gsid(*DESIGN, "-o", f"u.{suffix}").code == 0
    u = np.load("u.npz")["u"]
    table = Path("u.csv").read_text().splitlines()
    assert "# period_samples: 600" in table
    read = np.array([float(line.split(",")[1]) for line in table[table.index("t_s,u") + 1 :]])
    np.testing.assert_array_equal(read, u)
    np.testing.assert_array_equal(loadmat("u.mat")["u"].ravel(), u)
    spectrum = np.abs(np.fft.rfft(u))
    assert np.flatnonzero(spectrum > 1e-9 * spectrum.max()).tolist() == list(range(1, 50, 2))


PRINT_TABLE = """
#include <stdio.h>
#include "u.h"
int main(void) {
    int i;
    for (i = 0; i < U_N_PERIOD; i++) printf("%.9g\\n", (double)u[i]);
    return U_FS_HZ != 3000.0;
}
"""


def test_design_c_table_compiles(gsid):
    """The header goes through a C99 compiler with every warning, and holds the same numbers."""
    gsid(*DESIGN, "-o", "u.h")
    gsid(*DESIGN, "-o", "u.npz")
    Path("main.c").write_text(PRINT_TABLE)
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wdouble-promotion", "-Werror"]
    subprocess.run([os.environ.get("CC", "cc"), *flags, "main.c", "-o", "main"], check=True)
    printed = subprocess.run(["./main"], check=True, capture_output=True, text=True).stdout.split()
    np.testing.assert_array_equal(np.float32(printed), np.float32(np.load("u.npz")["u"]))


# ---------------------------------------------------------------- doctor


def test_doctor(gsid):
    result = gsid("doctor", "--json")
    values = json.loads(result.out)
    wrong = [check for check in values["checks"] if not check["ok"]]
    assert values["ok"] is (not wrong)
    assert result.code == (1 if wrong else 0)
    names = {check["name"] for check in values["checks"]}
    assert {"gsid", "Python", "numpy", "core, double", "core, float", "fftw", "nlopt"} <= names
    assert all(check["hint"] for check in wrong)
    assert gsid("doctor").out.splitlines()[0].split() == ["what", "state", "found", "licence", "hint"]


def test_doctor_without_the_library():
    """The core that does not load is what the doctor is for."""
    code = "import sys; sys.modules['gsid._gsid64'] = None; from gsid.cli.main import main; "
    code += "sys.exit(main(sys.argv[1:]))"
    result = subprocess.run([sys.executable, "-c", code, "doctor", "--json"], capture_output=True, text=True)
    checks = {check["name"]: check for check in json.loads(result.stdout)["checks"]}
    assert result.returncode == 1
    assert not checks["core, double"]["ok"]
    assert "make" in checks["core, double"]["hint"]
    assert checks["core, float"]["ok"]
    Path("rec.csv").write_text("u,y\n" + "1,2\n3,4\n" * 20)
    arguments = ["frf", "rec.csv", "--fs", "1"]
    result = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert result.returncode == 4
    assert "hint: `gsid doctor`" in result.stderr


# ---------------------------------------------------------------- a real bench


@needs_bench
def test_bench_frf_agrees_with_numpy(gsid):
    """The command of the issue: 1e-9 in the mean, 1e-6 in the variance, at every line."""
    path = BENCH / "multisine_A.npz"
    result = gsid("frf", path, *NAMES, "--period", 2500, "--settle", 2500, "--json")
    values = json.loads(result.out)
    assert (values["n_periods"], values["fs_hz"]) == (19, 2500.0)
    arrays = np.load(path)
    u, y = (arrays[name].astype(float)[2500:] for name in ("iq", "omega_motor"))
    line = np.array(values["line"])
    assert set(range(11, 251)) <= set(line.tolist())
    g, var_g = numpy_frf(u, y, line, 2500)
    measured = np.array(values["g_re"]) + 1j * np.array(values["g_im"])
    assert np.max(np.abs(measured - g) / np.abs(g)) < 1e-9
    np.testing.assert_allclose(values["var_g"], var_g, rtol=1e-6)


@needs_bench
def test_bench_fit_and_compare(gsid):
    path = BENCH / "multisine_A.npz"
    fit = ["fit", path, *NAMES, "--order", "4/3", "--band", "11:250", "-o", "model.json", "--json"]
    values = json.loads(gsid(*fit).out)
    poles, zeros = (np.array(values[name]) @ [1, 1j] for name in ("poles", "zeros"))
    resonance = np.abs(poles[poles.imag > 0]) / 2 / np.pi
    antiresonance = np.abs(zeros[zeros.imag > 0]) / 2 / np.pi
    assert np.min(np.abs(resonance - 76)) < 1
    assert np.min(np.abs(antiresonance - 54)) < 1
    assert np.all(poles.real < 0)
    assert all(
        std > 0 for std in (*values["std"]["num"], *values["std"]["den"][1:], values["std"]["delay_s"])
    )
    verdict = json.loads(gsid("compare", path, *NAMES, "--model", "model.json", "--json").out)
    assert verdict["adequate"] is False
    assert verdict["where"]
    assert verdict["rms_error"] > verdict["noise_floor_rms"]


def test_known_response_is_as_documented():
    """The system of these records, at rest: gain 3."""
    assert abs(response(0.0)) == pytest.approx(3)


def test_fit_by_every_method(gsid, rec_csv):
    result = gsid("fit", rec_csv, "--order", "2/0", "--method", "all", "--json", "-o", "best.json")
    assert result.code == 0
    values = json.loads(result.out)
    assert [row["method"] for row in values["estimators"]][-1] == "ml"
    costs = {row["method"]: row["cost"] for row in values["estimators"] if row["method"] != "ml-io"}
    assert costs["ml"] == min(cost for cost in costs.values() if cost is not None)
    assert "wrote best.json, the model of" in result.err
    table = gsid("fit", rec_csv, "--order", "2/0", "--method", "all").out
    assert "amplitude [dB]" in table
    assert "delay by the slope of the phase" in table


def test_fit_of_an_order_found(gsid, rec_csv):
    result = gsid("fit", rec_csv, "--order", "auto", "--band", "5:100", "--json")
    assert result.code == 0
    values = json.loads(result.out)
    assert len(values["den"]) == 3
    assert [row["chosen"] for row in values["orders"]].count(True) == 1


def test_fit_reports_what_is_ill_determined(gsid, rec_csv, monkeypatch):
    assert "cannot be distinguished" not in gsid("fit", rec_csv, "--order", "2/0").err
    monkeypatch.setattr(roots, "near_cancelled", lambda model: [(-200 + 0j, -201 + 0j)])
    err = gsid("fit", rec_csv, "--order", "2/0").err
    assert "near 31.83 Hz cannot be distinguished; the delay may trade against them: try --order auto" in err
    # A bug: of a complex pair it was said twice, and --order auto advised --order auto.
    monkeypatch.setattr(roots, "near_cancelled", lambda model: 2 * [(-200 + 0j, -201 + 0j)])
    err = gsid("fit", rec_csv, "--order", "auto", "--band", "5:100").err
    assert err.count("cannot be distinguished") == 1
    assert "try --order auto" not in err


def test_closed_loop_through_the_reference(gsid, record):
    """u and y carry noise that the reference does not; the response is that of u to y."""
    rng = np.random.default_rng(31)
    r, noise = record.u, 0.05 * rng.standard_normal(len(record.u))
    loop = Record(r - noise, record.y, FS_HZ, N_PERIOD, columns={"ref": r})
    write_record("loop.csv", loop)
    result = gsid("frf", "loop.csv", "--r", "ref", "--json")
    assert result.code == 0, result.err
    values = json.loads(result.out)
    np.testing.assert_allclose(values["f_hz"], LINES * FS_HZ / N_PERIOD)
    g, var_g = numpy_frf(loop.u, loop.y, LINES, N_PERIOD)
    np.testing.assert_allclose(np.array(values["g_re"]) + 1j * np.array(values["g_im"]), g, rtol=1e-9)
    np.testing.assert_allclose(values["var_g"], var_g, rtol=1e-6)
    model = json.loads(gsid("fit", "loop.csv", "--r", "ref", "--order", "2/0", "--json").out)
    assert model["delay_s"] == pytest.approx(1.5e-3, abs=4 * model["std"]["delay_s"])
    wrong = gsid("fit", "loop.csv", "--r", "reff", "--order", "2/0")
    assert wrong.code == 3
    assert "no column named reff" in wrong.err
    assert "did you mean ref?" in wrong.err


def test_pieces_of_low_order(undrawn, gsid, rec_csv):
    result = gsid("fit", rec_csv, "--order", "2/0", "--piecewise", "auto", "-o", "pieces.json")
    assert result.code == 0, result.err
    assert result.out.splitlines()[0].split() == ["pieces", "cost", "noise", "alone", "MDL"]
    assert "\n1 piece of 2/0, 4 parameters, converged" in result.out  # the truth is of this order
    assert "wrote pieces.json" in result.err
    assert gsid("compare", rec_csv, "--model", "pieces.json", "--band", "5:197.5").code == 0
    assert gsid("report", rec_csv, "--model", "pieces.json").code == 0
    values = json.loads(gsid("fit", rec_csv, "--order", "1/0", "--piecewise", "3", "--json").out)
    assert (len(values["pieces"]), len(values["breaks_hz"]), len(values["jumps"])) == (3, 2, 2)
    assert [cut["n_pieces"] for cut in values["tried"]] == [1, 2, 3]
    assert values["cost"] == pytest.approx(sum(piece["cost"] for piece in values["pieces"]))
    for wrong in (["--piecewise", "0"], ["--piecewise", "2", "--method", "nls"], ["--piecewise", "9"]):
        assert gsid("fit", rec_csv, "--order", "1/0", *wrong).code == 2
    refused = gsid("export-c", "pieces.json")
    assert refused.code == 3
    assert "a set of models has no time response" in refused.err


def test_fit_judged_on_a_record_kept_out(gsid, record, rec_csv):
    new = Record(record.u, record.y + 0.01 * np.random.default_rng(32).standard_normal(len(record.y)), FS_HZ)
    write_record("new.csv", new)
    values = json.loads(gsid("fit", rec_csv, "--order", "2/0", "--held-out", "new.csv", "--json").out)
    held_out = values["held_out"]
    assert held_out["interval"][0] < held_out["cost_expected"] < held_out["interval"][1]
    words = gsid("fit", rec_csv, "--order", "2/0", "--held-out", "new.csv").out
    assert f"on data kept out: cost {held_out['cost']:.5g}" in words
    table = gsid("fit", rec_csv, "--order", "2/0", "--method", "all", "--held-out", "new.csv").out
    assert "held-out cost" in table
    orders = json.loads(gsid("fit", rec_csv, "--order", "auto", "--held-out", "new.csv", "--json").out)
    assert all(row["held_out"]["n_lines"] == len(LINES) for row in orders["orders"])
    assert gsid("fit", rec_csv, "--order", "2/0", "--piecewise", "2", "--held-out", "new.csv").code == 2
    # A bug: "on data kept out" of a record that was fitted.
    Path("copy.csv").write_bytes(Path(rec_csv).read_bytes())
    refused = gsid("fit", rec_csv, "--order", "2/0", "--held-out", "copy.csv")
    assert (refused.code, refused.out) == (3, "")
    assert "a held-out record is also fitted\n  where: copy.csv\n" in refused.err


def test_bug_a_held_out_record_with_the_input_of_a_fitted_one_was_no_reason_for_a_note(gsid, record, rec_csv):
    """On the same input the errors of the model are those that the fit has made small."""
    rng = np.random.default_rng(33)
    noise = 0.01 * rng.standard_normal(len(record.y))
    write_record("same.csv", Record(record.u, record.y + noise, FS_HZ))
    later = slice(123, None)  # of the same periodic input
    write_record("later.csv", Record(record.u[later], (record.y + noise)[later], FS_HZ))
    write_record("louder.csv", Record(1.1 * record.u, 1.1 * record.y + noise, FS_HZ))
    spectrum = np.fft.rfft(record.u.reshape(-1, N_PERIOD)[0]) * np.exp(
        2j * np.pi * rng.random(N_PERIOD // 2 + 1)
    )
    u = np.tile(np.fft.irfft(spectrum, N_PERIOD), N_PERIODS)
    answer = np.fft.irfft(spectrum * response(np.fft.rfftfreq(N_PERIOD, 1 / FS_HZ)), N_PERIOD)
    write_record("new.csv", Record(u, np.tile(answer, N_PERIODS) + noise, FS_HZ))
    fit = ("fit", rec_csv, "--order", "2/0", "--held-out")
    for name in ("same.csv", "later.csv"):
        result = gsid(*fit, name)
        assert result.code == 0, result.err
        assert (
            result.err.count(f"warning: {name} has the same input as rec.csv: it tests the noise only") == 1
        )
        assert "hold out another realisation of the input" in result.err
    for name in ("louder.csv", "new.csv"):
        result = gsid(*fit, name)
        assert result.code == 0, result.err
        assert "has the same input" not in result.err
