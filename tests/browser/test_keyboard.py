"""From a file to the model and its output by the keyboard alone."""

import pytest

MOST_TABS = 80
FOCUSED = "document.activeElement"


def tab_to(page, name):
    """Press Tab until the control with this text or name has the focus."""
    for _ in range(MOST_TABS):
        page.keyboard.press("Tab")
        found = page.evaluate(f"[{FOCUSED}.textContent.trim(), {FOCUSED}.ariaLabel, {FOCUSED}.name]")
        if name in found:
            return
    raise AssertionError(f"{name} is not reached by Tab")


def press(page, name, number):
    """Press the button of this name, and wait for the answer of its step."""
    tab_to(page, name)
    page.keyboard.press("Enter")
    page.locator(f"#step-{number} .answer").wait_for()
    page.locator("#job").wait_for(state="hidden")


@pytest.mark.parametrize("page", [(1280, 800)], indirect=True, ids=["wide"])
def test_the_story_needs_no_mouse(page, record):
    tab_to(page, "Open records")
    with page.expect_file_chooser() as chooser:
        page.keyboard.press("Enter")
    chooser.value.set_files([str(record)])
    page.locator("#step-1 .answer").wait_for()
    tab_to(page, "How the records are read")
    page.keyboard.press("Enter")
    tab_to(page, "--fs")
    press(page, "Find the linear model", 2)
    assert page.evaluate(f"{FOCUSED}.textContent") == "Find the linear model"  # a step takes no focus away
    press(page, "Output over time", 3)  # of the list of all steps
    press(page, "Where does the model fail?", 4)  # below the step
    assert page.evaluate(f"{FOCUSED}.id") == "step-4"  # the button that was pressed is gone
    press(page, "What is missing?", 5)
    assert "coulomb_friction" in page.locator("#step-5 .answer").inner_text()
    tab_to(page, "What is missing?")
    page.keyboard.press("Enter")
    page.locator("#stop").wait_for()
    tab_to(page, "Stop")
    page.keyboard.press("Enter")
    page.locator("#step-6 .answer").wait_for()
