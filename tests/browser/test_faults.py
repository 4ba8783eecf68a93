"""The page says what is wrong, waits for nothing that is gone, and leaves the user's hand alone."""

import json

import pytest

WIDE = pytest.mark.parametrize("page", [(1280, 800)], indirect=True, ids=["wide"])
pytestmark = WIDE
WAITS, WAIT_MS = 500, 20  # for the first state: as long as for an element of the page


def open_files(page, *paths):
    """Open files, and wait until each has been looked at."""
    number = page.locator("#steps > li").count() + len(paths)
    page.set_input_files("#chooser", [str(path) for path in paths])
    page.locator(f"#step-{number} .answer").wait_for()


def messages_of(page):
    """Keep the last state of the server, and a function that sends one in its place."""
    sent = []

    def relay(route):
        server = route.connect_to_server()
        server.on_message(lambda text: (sent.append(text), route.send(text)))
        page.send_state = lambda **changed: route.send(json.dumps(json.loads(sent[-1]) | changed))

    page.route_web_socket("**/changes", relay)
    page.reload()
    page.get_by_text("connected", exact=True).wait_for()
    for _ in range(WAITS):  # the connection opens before the first state arrives
        if sent:
            return
        page.wait_for_timeout(WAIT_MS)
    pytest.fail(f"no state from the server within {WAITS * WAIT_MS} ms")


def test_a_lost_server_is_an_error_in_words(page, record, studio, faults):
    open_files(page, record)
    studio.stop()
    page.get_by_text("no connection: trying again").wait_for()
    page.get_by_role("button", name="Measure the response").first.click()
    page.locator("#error").get_by_text("no connection to gsid studio").wait_for()
    page.set_input_files("#chooser", [str(record)])
    page.locator("#error").get_by_text("no connection to gsid studio").wait_for()
    assert page.locator("#error").is_visible()
    page.close()  # else it tries again, and each attempt is a fault
    faults.clear()


def test_a_new_server_on_the_port_asks_for_its_address(page, studio, faults):
    studio.stop()
    other = studio.successor()
    try:
        page.get_by_text("open the address that gsid studio printed").wait_for()
    finally:
        other.stop()
    assert "printed" in page.locator("#connection").inner_text()
    page.close()
    faults.clear()


def test_a_picture_that_does_not_arrive_is_named(page, record, faults):
    page.route("**/files/**", lambda route: route.abort())
    open_files(page, record)
    page.get_by_text("The picture could not be drawn").wait_for()
    assert page.locator("#step-1 .picture .main-svg").count() == 0
    faults.clear()


def test_an_error_of_the_server_is_shown(page):
    messages_of(page)
    page.send_state(error="the study cannot be written: <b>disk full</b>")
    page.locator("#error").get_by_text("the study cannot be written: <b>disk full</b>").wait_for()
    page.send_state(error=None)
    page.locator("#error").wait_for(state="hidden")
    assert page.locator("#error").is_hidden()


def test_a_job_that_stops_cannot_be_stopped_again_and_no_other_begins(page):
    messages_of(page)
    job = {"step": "fitting", "command": "gsid start", "verb": "start"}
    begins = page.locator("[data-verb], [data-begins]")
    page.send_state(job=job | {"stopping": False})
    page.locator("#job-step").get_by_text("fitting").wait_for()
    assert page.locator("#stop").is_enabled()
    assert begins.count() > 10
    assert {one.get_attribute("aria-disabled") for one in begins.all()} == {"true"}
    page.send_state(job=job | {"stopping": True})
    page.locator("#job-step").get_by_text("stopping").wait_for()
    assert page.locator("#stop").is_disabled()


def test_a_late_answer_to_a_request_starts_no_job_that_never_ends(page, record):
    """The end of the first step is known before the answer to its post arrives."""
    held = []
    page.route("**/steps", lambda route: held.append((route, route.fetch())))
    page.set_input_files("#chooser", [str(record), str(record)])
    for number in (1, 2):
        page.locator(f"#step-{number} .answer").wait_for()
        while len(held) < number:
            page.wait_for_timeout(50)
        route, answer = held[number - 1]
        route.fulfill(response=answer)
    assert page.locator("#job").is_hidden()


def test_progress_keeps_focus_and_the_chosen_text(page, record):
    open_files(page, record)
    messages_of(page)
    box = page.locator("#records input").first
    node = box.element_handle()
    box.focus()
    for step in ("one", "two"):
        page.send_state(job={"step": step, "command": "gsid start", "verb": "start", "stopping": False})
        page.locator("#job-step").get_by_text(step).wait_for()
        assert page.evaluate("node => node === document.activeElement", node)
    page.send_state(job=None, records=["records/aaa.csv", "records/axis.csv"])
    page.locator("#records").get_by_text("aaa.csv").wait_for()
    assert page.evaluate("node => node === document.activeElement", node)
    assert page.locator("#records li").all_inner_texts() == [" aaa.csv", " axis.csv"]


def test_a_chosen_model_stays_chosen(page):
    messages_of(page)
    two = ["models/1-start.json", "models/2-add.json"]
    page.send_state(models=two)
    page.locator("#model option:checked[value='models/2-add.json']").wait_for(state="attached")
    page.send_state(models=[*two, "models/3-add.json"])
    page.locator("#model option:checked[value='models/3-add.json']").wait_for(state="attached")
    page.select_option("#model", two[0])
    page.send_state(models=[*two, "models/3-add.json", "models/4-add.json"])
    page.locator("#model option").nth(4).wait_for(state="attached")
    assert page.locator("#model").input_value() == two[0]


def test_a_refused_file_stops_no_other_and_a_file_can_be_opened_again(page, record, tmp_path, faults):
    (tmp_path / ".csv").write_text("a name that is refused\n")
    number = page.locator("#steps > li").count() + 2
    page.set_input_files("#chooser", [str(record), str(tmp_path / ".csv"), str(record)])
    page.locator(f"#step-{number} .answer").wait_for()
    assert "no usable name" in page.locator("#error").inner_text()
    assert page.evaluate("document.querySelector('#chooser').value") == ""
    faults.clear()  # the browser logs each refusal


def test_an_opened_file_waits_for_the_step_that_runs(page, record):
    open_files(page, record)
    page.get_by_role("button", name="Find the linear model").first.click()
    page.get_by_role("button", name="Stop").wait_for()
    open_files(page, record, record)
    assert page.locator("#error").is_hidden()
    assert "periods" in page.locator("#step-3 .answer").inner_text()
