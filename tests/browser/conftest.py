"""Chromium, driven by Playwright, on the page of a `gsid studio` of its own."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from running_studio import STEP_MS, Studio

from gsid.excitation.multisine import Multisine
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis

N, PERIODS, SEED = 3000, 6, 20261123


@pytest.fixture(scope="session")
def chromium():
    if os.environ.get("GSID_BROWSER") != "1":
        pytest.skip("`make test-browser` runs the tests of the page in a browser")
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def record(tmp_path_factory):
    """A CSV file of the simulated axis with friction that the linear model lacks."""
    path = tmp_path_factory.mktemp("rig") / "axis.csv"
    print("seed", SEED)
    axis = SimulatedAxis(seed=SEED, mode_residue=0, fan_amplitude=0, noise_low_rms=0, coulomb_level=20.0)
    u = np.tile(
        Multisine.design(3000, N, (2, 250), rms=20.0, phases="random", seed=SEED).table(), PERIODS + 2
    )
    used, y, *_ = axis.step(u)
    write_record(path, Record(used, y, 3000.0, N, 2 * N, hold="zoh", y_unit="deg/s"))
    return path


@pytest.fixture(scope="session")
def linear_study(record, tmp_path_factory):
    """A study in which the record was looked at and its linear model found, as by two clicks."""
    folder = tmp_path_factory.mktemp("linear") / "study"
    for words in (["open", str(record)], ["look"], ["start"]):
        command = [sys.executable, "-m", "gsid.cli.main", "-C", str(folder), *words]
        subprocess.run(command, check=True, capture_output=True)
    return folder


@pytest.fixture
def studio(tmp_path):
    """A running `gsid studio` of a new study."""
    made = Studio(tmp_path)
    yield made
    made.stop()


@pytest.fixture
def faults():
    """What went wrong in the browser. A test that provokes faults clears it."""
    return []


@pytest.fixture(params=[(1280, 800), (400, 800)], ids=["wide", "narrow"])
def page(request, chromium, studio, faults):
    """The page, opened. Any request off this computer, and any error of a script, fails the test."""
    width, height = request.param
    page = chromium.new_page(viewport={"width": width, "height": height})
    own = studio.address.split("/?")[0]

    def watch(sent):
        if not sent.url.startswith((own, own.replace("http", "ws"), "data:", "blob:")):
            faults.append(f"request to {sent.url}")

    page.on("request", watch)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    # From the first listener on Chromium hands choosers over; begun with the key press, it missed one in ten.
    page.on("filechooser", lambda _: None)
    page.set_default_timeout(STEP_MS)
    page.goto(studio.address)
    page.get_by_text("connected", exact=True).wait_for()
    yield page
    page.close()
    assert not faults
