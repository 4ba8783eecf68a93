"""Records as they come: other names of columns, parts that do not belong, and what is saved."""

import numpy as np
from test_story import open_file, step

import gsid


def renamed(record, tmp_path):
    """The same record with the columns of another program, and no facts."""
    read = gsid.read_record(record)
    table = np.column_stack([np.arange(len(read)) / read.fs_hz, read.y, read.u])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, "%.17g", ",", header="t_s,gyro [deg/s],command", comments="")
    return path


def test_columns_are_chosen_by_their_names(page, record, tmp_path):
    page.set_input_files("#chooser", [str(renamed(record, tmp_path))])
    page.get_by_role("alert").filter(has_text="its columns are t_s, gyro [deg/s], command").wait_for()
    assert page.evaluate("document.activeElement.name") == "--u"
    page.get_by_label("Input column").fill("command")
    page.get_by_label("Output column").fill("gyro [deg/s]")
    page.get_by_role("button", name="Look at the record").first.click()
    assert "7 periods of 3000 samples" in step(page, 1)


def test_the_unit_of_a_column_is_converted_and_kept_over_a_reload(page, record):
    open_file(page, record)
    page.get_by_text("How the records are read").click()
    page.get_by_label("Unit of the output in the file").select_option("rad/s, converted to deg/s")
    with page.expect_request("**/kept"):
        page.get_by_label("Unit of the input in the file").select_option("A")
    page.reload()
    page.get_by_role("button", name="Look at the record").first.click()
    step(page, 2)
    command = page.locator("#step-2 code").inner_text()
    for words in ("--factor=y=57.29577951308232", "--unit=y=deg/s", "--unit=u=A"):
        assert words in command
    page.locator("#step-2 .picture .main-svg").first.wait_for()
    titles = page.locator("#step-2 .picture").inner_text()
    assert "deg/s" in titles
    assert "[A]" in titles or "A" in titles.split()


def test_a_part_is_kept_and_files_are_saved(page, record):
    open_file(page, record)
    page.locator("#step-1 .cut").wait_for()
    assert page.locator("#step-1").get_by_label("from [s]").input_value() == "0"
    page.locator("#step-1").get_by_label("from [s]").fill("2")
    page.locator("#step-1").get_by_label("to [s]").fill("7.5")
    page.get_by_role("button", name="Keep this part").click()
    assert "2-cut.csv has 16500 samples, 5.5 s." in step(page, 2)
    page.get_by_role("checkbox", name="axis.csv").uncheck()
    page.get_by_role("button", name="Find the linear model").first.click()
    step(page, 3)
    page.get_by_role("button", name="C for firmware").click()
    step(page, 4)
    with page.expect_download() as saved:
        page.locator("#step-4").get_by_role("link", name="axis_4.h").click()
    assert "_step" in saved.value.path().read_text()
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_bug_the_end_of_a_long_record_was_rounded_past_it(page, tmp_path):
    """A record that ends at 3333.667 s: six digits made that 3333.67 s, which is outside."""
    n = 333_367
    t = np.arange(n)
    record = gsid.Record(np.sin(0.1 * t), np.cos(0.1 * t), 100.0)
    gsid.write_record(tmp_path / "long.npz", record)
    open_file(page, tmp_path / "long.npz")
    page.get_by_role("button", name="Keep this part").click()
    assert f"has {n - 1} samples" in step(page, 2) or f"has {n} samples" in step(page, 2)
