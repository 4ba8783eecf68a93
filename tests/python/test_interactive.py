"""A picture as a plotly figure has the same curves, limits and texts."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from gsid.plots.interactive import interactive


@pytest.fixture
def figure():
    figure = Figure()
    above, below = figure.subplots(2, 1, sharex=True)
    above.semilogx([1, 10, 100], [0.0, np.nan, -3.0], color="#0072B2", label="gain of <b>a</b>")
    above.plot([1, 10], [1, 2], "o", color="#333333", label="measured")
    above.axvspan(5, 20, color="#D55E00", alpha=0.5)
    above.axhline(0, color="red")
    above.set_title("Response", loc="left")
    above.set_ylabel("gain [dB]")
    below.fill_between([1, 10, 100], [0, 0, 0], [1, 2, 1], label="95 %")
    below.stairs([1, 2], [1, 10, 100])
    below.text(10, 1, "93 %")
    below.set_xlabel("frequency [Hz]")
    return figure


def test_curves_keep_their_numbers(figure):
    curve = interactive(figure)["data"][0]
    assert (curve["x"], curve["y"]) == ([1, 10, 100], [0, None, -3])
    assert curve["mode"] == "lines"
    assert curve["line"]["color"] == "rgba(0,114,178,1)"


def test_points_have_no_line(figure):
    points = interactive(figure)["data"][1]
    assert (points["mode"], points["name"]) == ("markers", "measured")


def test_axes_have_scale_limits_and_titles(figure):
    layout = interactive(figure)["layout"]
    assert layout["xaxis"]["type"] == "log"
    assert layout["xaxis"]["range"] == pytest.approx(np.log10(figure.axes[0].get_xlim()))
    assert layout["yaxis"]["range"] == pytest.approx(figure.axes[0].get_ylim())
    assert layout["yaxis"]["title"]["text"] == "gain [dB]"
    assert layout["xaxis2"]["title"]["text"] == "frequency [Hz]"
    assert layout["xaxis2"]["matches"] == "x"
    assert not layout["xaxis"]["showticklabels"]  # the lower axis has them


def test_areas_and_lines_across_the_axes_are_shapes(figure):
    area, line = sorted(interactive(figure)["layout"]["shapes"], key=lambda one: one["type"], reverse=True)
    assert (area["x0"], area["x1"]) == (5, 20)
    assert (area["xref"], area["yref"]) == ("x", "y domain")
    assert (line["y0"], line["y1"], line["yref"]) == (0, 0, "y")


def test_steps_and_filled_areas_are_drawn(figure):
    area, steps = interactive(figure)["data"][2:]
    assert area["fill"] == "toself"
    assert (steps["x"], steps["y"]) == ([1, 10, 10, 100], [1, 1, 2, 2])


def test_bug_texts_above_a_line_stood_on_it(figure):
    """Only the middle of a text was kept, and the axes of a page have another height."""
    ax = figure.axes[0]
    offset = {"textcoords": "offset points", "ha": "right", "va": "bottom"}
    ax.annotate("above", (10, ax.get_ylim()[0]), (0, 5), **offset)
    one = next(one for one in interactive(figure)["layout"]["annotations"] if one["text"] == "above")
    assert (one["xanchor"], one["yanchor"]) == ("right", "bottom")
    assert 0 < one["y"] < 0.1


def test_texts_are_never_markup(figure):
    figure.axes[0].set_title("<i>name</i> & more", loc="left")
    texts = [one["text"] for one in interactive(figure)["layout"]["annotations"]]
    assert texts == ["&lt;i>name&lt;/i> &amp; more", "93 %"]
    assert interactive(figure)["data"][0]["name"] == "gain of &lt;b>a&lt;/b>"


def test_units_and_categories_from_files_are_never_markup():
    figure = Figure()
    ax = figure.subplots()
    ax.barh(["<b>a</b>", "price \\$", "two\nlines"], [1, 2, 3])
    ax.set_xlabel("<a href=x>")
    layout = interactive(figure)["layout"]
    assert layout["xaxis"]["title"]["text"] == "&lt;a href=x>"
    assert layout["yaxis"]["ticktext"] == ["&lt;b>a&lt;/b>", "price $", "two<br>lines"]
    ax.set_xlabel(r"rate [\$/s]")
    assert interactive(figure)["layout"]["xaxis"]["title"]["text"] == "rate [$/s]"


def test_numbers_of_a_logarithmic_axis_are_no_categories():
    figure = Figure()
    figure.subplots().semilogy([1, 2, 3], [1, 100, 1e4])
    assert "ticktext" not in interactive(figure)["layout"]["yaxis"]


def test_a_name_stands_once_in_the_legend(figure):
    figure.axes[1].plot([1, 10], [1, 1], label="measured")
    shown = [one for one in interactive(figure)["data"] if one["showlegend"]]
    assert [one["name"] for one in shown].count("measured") == 1


def test_it_is_json_without_numbers_that_are_not_finite(figure):
    text = json.dumps(interactive(figure), allow_nan=False)
    assert json.loads(text) == interactive(figure)
