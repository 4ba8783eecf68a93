"""The next experiment: proposed on the page or by the command line, then filled in and run."""

import subprocess
import sys

import pytest
from test_story import open_file, step

pytestmark = pytest.mark.parametrize("page", [(400, 800)], indirect=True, ids=["narrow"])


def test_a_proposal_is_filled_in_and_measured_by_clicks(page, record):
    open_file(page, record)
    page.locator("summary", has_text="Next experiment").click()
    page.get_by_label("Required sigma over value").fill("0.02")
    page.get_by_role("button", name="Propose the next experiment").click()
    assert "0.02 is wanted" in step(page, 2)
    page.locator("#step-2 .picture .main-svg").first.wait_for()
    page.locator("#step-2").get_by_role("button", name="Fill in the experiment").click()
    page.locator("#live-form [name=axis]:focus").wait_for()  # the page's policy refuses polled expressions
    assert page.locator("#live-form [name=file]").input_value() == "excitation/2-next.csv"
    periods = page.locator("#live-form [name=periods]").input_value()
    assert f"{periods} periods of a command" in step(page, 2)
    page.select_option("#live-form [name=axis]", "simulated")
    page.locator("#live-form").get_by_label("As fast as possible").check()
    page.get_by_role("button", name="Start the axis").click()
    assert f"{periods} good periods" in step(page, 3)
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    step(page, 4)


def test_bug_a_proposal_of_the_command_line_stopped_the_page(page, record, studio):
    """It offers a step that is no button, and no step was shown after it."""
    open_file(page, record)
    command = [
        sys.executable,
        "-m",
        "gsid.cli.main",
        "-C",
        str(studio.folder / studio.name),
        "next",
        "--json",
    ]
    subprocess.run(command, check=True, capture_output=True)
    step(page, 2)
    page.locator("#step-2").get_by_role("button", name="Fill in the experiment").wait_for()
    assert page.locator("#step-2 code").inner_text().startswith("gsid next")
