"""The texts of a picture do not overlap, on a wide and on a narrow screen."""

import itertools
import json

import numpy as np

from gsid.plots import predicted_output
from gsid.plots.interactive import interactive
from gsid.prediction import PredictedOutput

TEXTS = ".picture .annotation-text, .picture text[class$='title']"
N_TEXTS = 4 + 4 + 4  # titles of signals, labels of the left axes, labels of time


def predicted():
    print("seed", 1)
    y = np.random.default_rng(1).standard_normal((4, 3000))
    return PredictedOutput(3000.0, y, np.mean(y, axis=0), True, y_unit="deg/s", name="axis_at_20_deg")


def overlap(one, other):
    return all(
        one[side] < other[side] + other[size] and other[side] < one[side] + one[size]
        for side, size in (("x", "width"), ("y", "height"))
    )


def test_titles_of_two_columns_do_not_overlap(page, record, tmp_path):
    figure = json.dumps(interactive(predicted_output([predicted(), predicted()])))
    page.route("**/files/**", lambda route: route.fulfill(body=figure, content_type="application/json"))
    page.set_input_files("#chooser", [str(record)])
    page.locator(TEXTS).nth(N_TEXTS - 1).wait_for()
    page.screenshot(path=tmp_path / "picture.png", full_page=True)
    boxes = [(one.text_content(), one.bounding_box()) for one in page.locator(TEXTS).all()]
    assert len(boxes) == N_TEXTS
    for (text, box), (other_text, other_box) in itertools.combinations(boxes, 2):
        assert not overlap(box, other_box), (text, other_text)
    width = page.viewport_size["width"]
    assert all(box["x"] >= 0 and box["x"] + box["width"] <= width for _, box in boxes)
