"""The bare-metal drive in the emulator: its measurement, identical on all processors."""

from __future__ import annotations

import re
import subprocess

import numpy as np
import pytest
from emulator import ROOT, image

import gsid
from gsid.records.record import Record
from gsid.rig.frames import SAMPLE, Receiver

N_PERIOD, N_LINES, N_GOOD = 6000, 500, 10


def report_of(run):
    """The report's frames: state, then columns tick, a, b of each kind."""
    kinds = {name: np.array([row[1:] for row in run.reports if row[0] == name]) for name in ("g", "sigma")}
    (state,) = [row[1:] for row in run.reports if row[0] == "state"]
    return state, kinds["g"], kinds["sigma"]


def model_of(run):
    values = {name: [row[1:] for row in run.reports if row[0] == name] for name in ("num", "den", "fit")}
    ((status, delay_s, cost),) = values["fit"]
    scale = values["num"][0][2]
    num, den = ([row[1] / scale ** row[0] for row in values[name]][::-1] for name in ("num", "den"))
    return gsid.RationalModel(num, den, delay_s), status - 128, cost


@pytest.fixture(scope="session")
def desktop(runs):
    """Response that the desktop computes in double precision from the samples that the drive received."""
    got = Receiver(follows_hello=True).decode(bytes(runs["first"].sent))
    got = got[got["kind"] == SAMPLE][: (1 + N_GOOD) * N_PERIOD]
    assert (got["tick"] == np.arange(len(got))).all()
    u, y = got["a"].astype(float), got["b"].astype(float)
    record = Record(u, y, 3000, period_samples=N_PERIOD, settle_samples=N_PERIOD, hold="none")
    return gsid.frf([record])


def test_the_run_is_complete(runs):
    for run in runs.values():
        (_, why, n_good), g, sigma = report_of(run)
        assert (why, n_good) == (1, N_GOOD)
        np.testing.assert_array_equal(g[:, 0], np.arange(1, N_LINES + 1))
        np.testing.assert_array_equal(sigma[:, 1], np.arange(1, N_LINES + 1) / 2)


def test_a_second_run_gives_the_same_bytes(runs):
    assert runs["second"].received == runs["first"].received


def test_m4f_and_m7_give_the_same_bytes(runs):
    assert runs["m4"].received == runs["first"].received


def test_the_drive_built_for_a_computer_gives_the_same_bytes(runs):
    """Commands, response and model: everything that the drive sends, bit for bit."""
    result = subprocess.run(
        [ROOT / "build/firmware/replay"], input=bytes(runs["first"].sent), capture_output=True, check=True
    )
    assert result.stdout == bytes(runs["first"].received)


def test_the_response_is_that_of_the_desktop(runs, desktop):
    """Within the errors of Y and U in single precision: 2e-6 of the largest line (include/gsid/frf.h)."""
    _, g, sigma = report_of(runs["first"])
    y, u = np.abs(desktop.y), np.abs(desktop.u)
    bound = 2e-6 * (y.max() + np.abs(desktop.g) * u.max()) / u
    error = np.abs(g[:, 1] + 1j * g[:, 2] - desktop.g)
    relative, share = np.max(error / np.abs(desktop.g)), np.max(error / bound)
    print(f"response: error <= {relative:.1e} of it, {share:.2f} of the bound")
    assert (error < bound).all()
    # Deviations from the mean are rounded at 2e-6 of the largest line too, against deviations of at least a
    # thousandth of it: a relative error of 2e-3, in the worst line of 500.
    np.testing.assert_allclose(sigma[:, 2], np.sqrt(desktop.var_g), rtol=2e-3)


def test_the_model_is_that_of_the_desktop(runs, desktop):
    """Both stop where V would fall by less than 0.005: far less than the standard deviation of any line."""
    model, status, cost = model_of(runs["first"])
    fitted = gsid.fit(desktop, "3/2", delay="free", method="ml", hold="none")
    f, sigma = desktop.f_hz, np.sqrt(desktop.var_g)
    error = np.abs(model.response(f) - fitted.response(f)) / sigma
    print(f"model: difference <= {error.max():.1e} sigma, delay {model.delay_s - fitted.delay_s:.1e} s")
    assert status == 0
    assert error.max() < 0.02
    assert cost == pytest.approx(fitted.cost, rel=1e-3)
    assert abs(model.delay_s - fitted.delay_s) < 0.02 * fitted.std_delay_s


def disassembly(name):
    return subprocess.run(
        ["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", image(name)],
        check=True,
        capture_output=True,
        text=True,
    ).stdout


@pytest.mark.parametrize("name", ["m7-full", "m4-full"])
def test_no_heap_no_double_and_nothing_masked(name):
    """On the M4F an instruction in double precision would cause a fault; the M7's image has none either."""
    symbols = subprocess.run(
        ["arm-none-eabi-nm", image(name)], check=True, capture_output=True, text=True
    ).stdout
    assert not re.findall(r" \w (_?malloc\w*|_?calloc\w*|_?realloc\w*|_?free\w*|_?sbrk\w*)$", symbols, re.M)
    assert not re.findall(r" \w (__aeabi_[df]2?[di]?\w*|__\w*df\d?)$", symbols, re.M)
    text = disassembly(name)
    assert not re.findall(r"\t\w+\.f64.*", text)
    assert not re.findall(r"\t(?:cps\w+|msr\s+(?:PRIMASK|BASEPRI|FAULTMASK)).*", text, re.I)
