"""From a file to the named effect by clicks alone."""

import re


def open_file(page, path):
    page.set_input_files("#chooser", [str(path)])
    page.locator("#step-1 .answer").wait_for()


def step(page, number):
    """The answer of a step, once it is there."""
    page.locator(f"#step-{number} .answer").wait_for()
    return page.locator(f"#step-{number} .answer").inner_text()


def test_from_a_file_to_the_error_that_falls(page, record, tmp_path):
    open_file(page, record)
    assert "6 periods of 3000 samples" in step(page, 1)
    page.get_by_role("button", name="Find the linear model").first.click()
    assert "y is the rate" in step(page, 2)
    page.locator("#step-2").get_by_role("button", name="Output over time").click()
    before = fit_of(step(page, 3))
    page.get_by_role("button", name="What is missing?").first.click()
    assert "coulomb_friction" in step(page, 4)
    page.locator("#step-4").get_by_role("button", name="Output over time").click()
    assert fit_of(step(page, 5)) > before
    page.locator("#step-5 .picture .main-svg").first.wait_for()
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    page.screenshot(path=tmp_path / "story.png", full_page=True)


def fit_of(text):
    return float(re.search(r"FIT (-?[\d.]+) %", text).group(1))


def test_a_file_that_is_no_record_is_an_error_in_words(page, tmp_path):
    (tmp_path / "notes.csv").write_text("this is not a record\n")
    open_file(page, tmp_path / "notes.csv")
    assert "error" in step(page, 1)
    assert page.locator("#step-1").get_by_text("hint: available: this is not a record").is_visible()
    assert "failed" in page.locator("#step-1").get_attribute("class")


def test_a_step_can_be_stopped_and_a_reload_loses_nothing(page, record):
    open_file(page, record)
    page.get_by_role("button", name="What is missing?").first.click()
    page.get_by_role("button", name="Stop").click()
    answer = step(page, 2)
    page.reload()
    assert step(page, 2) == answer
    assert "samples" in step(page, 1)


def test_names_from_files_are_never_markup(page, record, tmp_path):
    name = "<img src=x onerror=alert(1)>.csv"
    (tmp_path / name).write_bytes(record.read_bytes())
    open_file(page, tmp_path / name)
    assert name.removesuffix(".csv") in page.locator("#records").inner_text()
    assert page.locator("img").count() == 0
