"""The report in a browser: narrow and wide, printed, and with interactive pictures."""

import numpy as np
import pytest

from gsid.comparison import compare
from gsid.excitation.multisine import Multisine
from gsid.fitting.rational import fit
from gsid.records.record import Record
from gsid.report import Report
from gsid.response.estimate import frf
from gsid.spectrum.noise import noise
from gsid.spectrum.realisation import spectra

FS_HZ, N, SEED = 1000.0, 1000, 20261124
PAPER = {"width": 673, "height": 1002}  # A4 less its margins, in pixels
SLOWER = 10  # than this machine, so that a drawing takes longer than the change of the window
NAME = "a_file_with_a_long_name_without_a_blank_" * 3 + ".csv"


@pytest.fixture(scope="module", params=[False, True], ids=["static", "interactive"])
def address(request, tmp_path_factory):
    """A report of a lag that is fitted by a gain."""
    print("seed", SEED)
    u = np.tile(Multisine.design(FS_HZ, N, (1, 200), rms=1.0).table(), 6)
    y = np.zeros(len(u))
    for i in range(1, len(u)):
        y[i] = 0.95 * y[i - 1] + 0.05 * u[i - 1]
    y += 1e-3 * np.random.default_rng(SEED).standard_normal(len(y))
    record = Record(u, y, FS_HZ, N, 2 * N, hold="zoh", u_unit="A", y_unit="deg/s", name=NAME)
    response = frf(record)
    model = fit(response, "1/0", delay="none")
    page = Report("A lag", command="c", interactive=request.param).add_experiment(
        NAME,
        record,
        spectra(record),
        response,
        model,
        compare(model, record, fitted=True),
        noise=noise(record),
    )
    return page.write(tmp_path_factory.mktemp("report") / "report.html").as_uri()


@pytest.fixture
def page(chromium, address):
    page = chromium.new_page()
    foreign, errors = [], []
    page.on("request", lambda one: one.url.startswith(("file:", "data:")) or foreign.append(one.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    yield page
    page.close()
    assert foreign == []
    assert errors == []


@pytest.mark.parametrize("width", [1280, 400])
def test_the_page_never_scrolls_sideways(page, width):
    page.set_viewport_size({"width": width, "height": 900})
    for opened in ("false", "true"):
        page.evaluate(f"document.querySelectorAll('details').forEach(one => one.open = {opened})")
        assert page.wait_for_function("width => document.documentElement.scrollWidth <= width", arg=width)


LEGIBLE = """() => {
  const texts = [...document.querySelector("figure").querySelectorAll("svg text")];
  const heights = texts.map((one) => one.getBoundingClientRect().height).filter((height) => height > 0);
  return heights.length > 0 && Math.min(...heights) > 8;  // pixels
}"""


def test_each_width_has_its_own_picture(page):
    for width, shown, hidden in ((1280, "wide", "narrow"), (400, "narrow", "wide")):
        page.set_viewport_size({"width": width, "height": 900})
        figure = page.locator("figure").first
        figure.locator(f"svg.{shown}:visible, .plot:visible").first.wait_for()  # plotly draws again
        assert not figure.locator(f"svg.{hidden}").is_visible()
        assert page.wait_for_function(LEGIBLE)


def test_a_window_that_narrows_while_plotly_draws_keeps_its_picture(page):
    """Two drawings at once left a picture without a height on a slow machine."""
    if page.locator(".plot").count() == 0:
        return
    page.context.new_cdp_session(page).send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
    page.reload()
    for width in (1280, 400):
        page.set_viewport_size({"width": width, "height": 900})
        page.locator("figure .plot:visible").first.wait_for()
    plot = page.locator("figure .plot").first
    page.wait_for_function(LEGIBLE)
    assert plot.bounding_box()["height"] == plot.locator(".main-svg").first.bounding_box()["height"] > 100
    assert plot.locator(".main-svg").first.bounding_box()["width"] <= 400


def test_print_opens_what_is_folded_and_cuts_nothing(page):
    folded = page.locator("details table").first
    assert not folded.is_visible()
    page.emulate_media(media="print")
    page.set_viewport_size(PAPER)
    assert folded.is_visible()
    boxes = [one.bounding_box() for one in page.locator("figure svg.wide").all()]
    assert len(boxes) == page.locator("figure").count()
    for box in boxes:
        assert 0 < box["width"] <= PAPER["width"]
        assert 0 < box["height"] < 0.7 * PAPER["height"]
    assert page.evaluate("document.documentElement.scrollWidth") <= PAPER["width"]
    assert page.pdf().startswith(b"%PDF")


def test_interactive_pictures_replace_the_static_ones_on_the_screen(page, address):
    first = page.locator("figure").first
    if page.locator(".plot").count() == 0:
        assert page.locator("script").count() == 0
        return
    first.locator(".plot .main-svg").first.wait_for()
    assert not first.locator("svg.wide").is_visible()
    page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    last = page.locator(".plot").last
    last.scroll_into_view_if_needed()
    last.locator(".main-svg").first.wait_for()
