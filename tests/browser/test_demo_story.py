"""The last line of the demo, and from there to the named effect and the error that fell."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from running_studio import STEP_MS, Studio
from test_story import fit_of, step

MOST_CLICKS = 12
SETTLE_MS = 1000  # of the drawing, before a screenshot


@pytest.fixture(scope="module")
def last_line(tmp_path_factory):
    """Of `gsid demo`, and the folder in which it ran."""
    folder = tmp_path_factory.mktemp("user")
    demo = [sys.executable, "-m", "gsid.cli.main", "demo"]
    out = subprocess.run(demo, cwd=folder, capture_output=True, text=True, check=True).stdout
    return out.splitlines()[-1], folder


def picture_of(page, part, name):
    """A screenshot for the documentation, if `make studio-pictures` asks for it."""
    page.locator(f"{part} .picture .main-svg").first.wait_for()
    if folder := os.environ.get("GSID_PICTURES"):
        page.mouse.move(0, 0)
        page.locator(part).evaluate("one => one.scrollIntoView({block: 'start'})")
        page.wait_for_timeout(SETTLE_MS)
        page.screenshot(path=Path(folder) / name)


def test_the_hidden_effect_is_found_by_clicks(chromium, last_line):
    line, folder = last_line
    words = shlex.split(line.partition(": ")[2])
    studio = Studio(folder, words[words.index("--folder") + 1])
    page = chromium.new_page()
    page.set_default_timeout(STEP_MS)
    clicks = 0

    def click(name, place="body"):
        nonlocal clicks
        clicks += 1
        page.locator(place).get_by_role("button", name=name).first.click()

    try:
        page.goto(studio.address)
        click("Find the linear model")
        step(page, 1)
        click("Output over time")
        before = fit_of(step(page, 2))
        click("What is missing?")
        assert "Missing is quadratic_drag" in step(page, 3)
        click("Output over time", "#step-3")
        after = fit_of(step(page, 4))
        picture_of(page, "#step-3", "studio_missing.png")
        picture_of(page, "#step-4", "studio_output.png")
    finally:
        page.close()
        studio.stop()
    assert after > before
    print(f"{clicks} clicks; FIT of the first record {before} %, then {after} %")
    assert clicks <= MOST_CLICKS
