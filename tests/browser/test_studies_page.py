"""Several studies beside each other, and several responses in one picture, by clicks."""

import re
import signal
import subprocess
import sys

import pytest
from running_studio import STEP_MS
from test_workbench import large_study

from gsid.study.folder import Study


@pytest.fixture(params=[(1280, 800), (400, 800)], ids=["wide", "narrow"])
def two(request, tmp_path, chromium):
    """The page of the first of two studies, opened as `gsid studio FIRST SECOND`."""
    for name, seed in (("az", 1), ("el", 2)):
        (tmp_path / name).mkdir()
        large_study(tmp_path / name, seed=seed)
    command = [sys.executable, "-m", "gsid.cli.main", "studio", "--no-browser", "az/study", "el/study"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    width, height = request.param
    page = chromium.new_page(viewport={"width": width, "height": height})
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.set_default_timeout(STEP_MS)
    page.goto(re.search(r"http://\S+", process.stdout.readline()).group())
    page.get_by_text("connected", exact=True).wait_for()
    yield page
    page.close()
    process.send_signal(signal.SIGINT)
    process.wait(timeout=30)
    assert not faults


def test_two_studies_are_compared_and_two_responses_drawn_by_clicks(two, tmp_path):
    two.get_by_text("Other studies and several responses").click()
    box = two.locator("#studies input")
    box.wait_for()
    assert box.is_checked()  # it was named
    two.get_by_role("button", name="Compare with the ticked studies").click()
    two.locator("#comparison-picture .main-svg").first.wait_for()
    table = two.locator("#comparison-table").inner_text()
    assert re.search(r"FIT\s+99?\S* %", table)
    assert "rigid body gain" in table
    assert two.evaluate("document.getElementById('comparison-picture').data.length") == 8
    two.get_by_text("Steps of").click()
    two.get_by_text("It has no steps yet.").wait_for()
    two.get_by_role("button", name="Responses of the ticked records in one picture").click()
    two.get_by_text("Measured responses of the ticked records").wait_for()
    assert two.evaluate("document.getElementById('comparison-picture').data.length") == 2
    assert two.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    two.get_by_role("button", name="Close the comparison").click()
    assert two.locator("#comparison").is_hidden()
    assert Study(tmp_path / "el" / "study").steps == []  # it was only read
