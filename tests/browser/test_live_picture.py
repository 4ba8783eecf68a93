"""An experiment on the simulated axis: by clicks, with a reload, and stopped by a key."""

import pytest

INK = """() => {
    const canvas = document.getElementById("live-signals");
    const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let n = 0;
    for (let i = 0; i < data.length; i += 4) n += data[i] === 0 && data[i + 1] === 114 && data[i + 2] === 178;
    return n;
}"""  # pixels in the colour of the signals
STEP_MS = 180_000
pytestmark = pytest.mark.parametrize("page", [(1280, 800)], indirect=True, ids=["wide"])


def start(page, **fields):
    """Fill in the form for the simulated axis, and start."""
    page.locator("#experiment summary").click()
    page.locator("#live-limits input").first.wait_for()
    page.select_option("#live-form [name=axis]", "simulated")
    for name, value in {"period": "1500", "settle": "1", **fields}.items():
        page.fill(f"#live-form [name={name}]", value)
    page.get_by_role("button", name="Start the axis").click()


def moving(page):
    """Wait until figures are drawn."""
    page.locator("#live-periods .good").nth(1).wait_for()
    assert page.evaluate(INK) > 1000


def test_an_experiment_by_clicks_gives_a_record_that_is_ticked(page):
    page.locator("#experiment summary").click()
    page.locator("#live-limits input").first.wait_for()
    limits = page.locator("#live-limits input")

    def limits_of(axis):
        page.select_option("#live-form [name=axis]", axis)
        return [limits.nth(i).input_value() for i in range(3)]

    assert limits_of("other") == ["", "", ""]  # nothing is assumed of a real axis
    assert "" not in limits_of("simulated")
    assert limits_of("other") == ["", "", ""]
    page.locator("#experiment summary").click()
    start(page, periods="12")
    moving(page)
    page.locator("#live-bar").get_by_role("button", name="Stop the axis").wait_for()
    page.locator("#live-meters").get_by_text("of 20.0").wait_for()
    page.locator("#live-response .main-svg").first.wait_for()
    page.locator("#steps > li:nth-child(3) .answer").get_by_text("periods of 1500 samples").wait_for()
    assert "12 good periods" in page.locator("#steps > li:nth-child(2) .answer").inner_text()
    assert page.locator("#records input").is_checked()
    assert page.locator("#live-bar").is_hidden()
    assert page.locator("#live").is_visible()  # the last picture stays
    page.reload()
    page.locator("#experiment summary").click()
    page.locator("#live-limits input").first.wait_for()
    assert "" not in limits_of("simulated")  # as in the last experiment
    assert limits_of("other") == ["", "", ""]


def test_a_reload_goes_on_and_escape_stops(page):
    start(page, periods="1000")
    moving(page)
    page.reload()
    moving(page)
    page.locator("#live-control").get_by_text("This page holds control").wait_for()
    page.wait_for_timeout(4000)
    assert page.locator("#live-bar").is_visible()
    page.keyboard.press("Escape")
    page.locator("#steps > li:nth-child(2) .answer").get_by_text("The step was stopped.").wait_for()
    page.locator("#steps > li:nth-child(3) .answer").wait_for()  # the record is kept and looked at
    assert page.locator("#live-bar").is_hidden()


def test_a_second_page_watches_takes_control_and_stops(page, chromium, studio):
    start(page, periods="1000")
    moving(page)
    other = chromium.new_page(viewport={"width": 400, "height": 800})
    other.set_default_timeout(STEP_MS)
    other.goto(studio.address)
    moving(other)
    other.locator("#live-control").get_by_text("Another page holds control").wait_for()
    other.get_by_role("button", name="Take control").click()
    other.locator("#live-control").get_by_text("This page holds control").wait_for()
    page.locator("#live-control").get_by_text("Another page holds control").wait_for()
    page.get_by_role("button", name="Stop the axis").click()
    other.locator("#live-bar").wait_for(state="hidden")
    other.close()
    page.locator("#steps > li:nth-child(3) .answer").wait_for()
    assert "The step was stopped." in page.locator("#steps > li:nth-child(2) .answer").inner_text()


STRIPS = "export function drawStrips(canvas, time) { window.drawn = [...time]; }"
SOCKETS = """
    window.sockets = [];
    const Usual = WebSocket;
    window.WebSocket = class extends Usual {
        constructor(...words) { super(...words); sockets.push(this); }
    };
"""


def test_bug_a_connection_that_came_back_drew_the_run_twice(page):
    page.route(
        "**/static/live_strips.js", lambda one: one.fulfill(body=STRIPS, content_type="text/javascript")
    )
    page.add_init_script(SOCKETS)
    page.reload()
    start(page, periods="1000")
    page.locator("#live-periods .good").nth(3).wait_for()
    before = page.evaluate("drawn.at(-1)")
    page.evaluate("sockets.findLast((one) => one.url.endsWith('/live')).close()")
    while page.evaluate("drawn.at(-1)") < before + 1:
        page.wait_for_timeout(100)
    page.locator("#live-control").get_by_text("This page holds control").wait_for()
    drawn = page.evaluate("drawn")
    assert drawn == sorted(set(drawn))
    page.keyboard.press("Escape")
    page.locator("#steps > li:nth-child(3) .answer").wait_for()


@pytest.mark.parametrize(
    ("folded", "filled"), [("experiment", "#live-limits input"), ("beside", "#studies > li")]
)
def test_bug_a_part_opened_before_the_script_ran_stayed_empty(page, folded, filled):
    waiting = []
    page.route("**/kept", lambda one: waiting.append(one))  # the script goes on when it is answered
    page.reload()
    page.locator(f"#{folded} > summary").click()
    page.wait_for_timeout(200)
    assert page.locator(filled).count() == 0
    waiting[0].continue_()
    page.locator(filled).first.wait_for(timeout=20_000)


def test_bug_a_hidden_tab_kept_every_set_of_figures(page):
    kept = page.evaluate("""async () => {
        const { newestOf } = await import("/static/live_picture.js");
        let sets = [];
        for (let n = 0; n < 1000; n += 1) sets = newestOf([...sets, n === 3 ? { n, response: "r" } : { n }]);
        return sets;
    }""")
    assert kept[0] == {"response": "r"}
    assert [one["n"] for one in kept[1:]] == list(range(800, 1000))
