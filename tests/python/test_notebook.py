"""What a notebook shows of a result: a short table, the verdict as a sentence, a figure with its axes."""

import dataclasses
import html.parser
import importlib

import pytest
from matplotlib.axes import Axes
from plants import axis_record, plant

import gsid
from gsid import plots
from gsid.base.plottable import Plottable
from gsid.excitation.multisine import Multisine

pytestmark = pytest.mark.xdist_group("notebook")  # the module's fixture is made once
FS_HZ, N, SEED = 3000.0, 1500, 20261125
NASTY = '<script>alert("&")</script>'
AXIS = {"gain": 7.4, "viscous_rate": 11.0, "spring_stiffness": 170.0, "delay_s": 0.0054}
STACK = {
    "rigid_body": {"gain": 7.4},
    "viscous_friction": {"rate": 11.0},
    "cable_spring": {"stiffness": 170.0},
    "transport_delay": {"delay_s": 0.0054},
}


class Shown(html.parser.HTMLParser):
    """Tags and words of a piece of HTML that is well nested."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.words = [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.open.append(tag)
        assert not any(name.startswith("on") or name in ("src", "href") for name, _ in attrs)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def records():
    """Two levels of the axis with dry friction; the names are those of hostile files."""
    print("seed", SEED)
    found = []
    for i, amplitude in enumerate((3.0, 6.0)):
        u = Multisine.design(FS_HZ, N, (2.0, 100.0), grid="odd", phases="random", seed=i, amplitude=amplitude)
        one = axis_record(u.table(), 4, 0.02, SEED + i, f"{NASTY}{i}", coulomb_level=2.0, **AXIS)
        found.append(dataclasses.replace(one, y_unit="deg/s", u_unit="V"))
    return found


@pytest.fixture(scope="module")
def results(records):
    """Each result with texts that its table or its sentences must have."""
    model, response = plant(STACK), gsid.frf(records)
    rational = gsid.fit(response, "2/1")
    added = gsid.add("coulomb_friction", model, records)
    return {
        "record": (records[0], ["6000 at 3000 Hz, 2 s", "rms", "V", "deg/s", NASTY]),
        "response": (response, ["deg/s/V", "largest gain", NASTY]),
        "transfer function": (rational, ["delay [ms]", "deg/s / V", "expected when only noise is left"]),
        "plant": (added.model, ["coulomb_friction", "deg/s^2", "cost per degree of freedom"]),
        "fit": (added.fit, ["coulomb_friction", "1 when only noise is left", "converged after"]),
        "comparison": (gsid.compare(model, records), ["Not adequate: rms error", "deg/s", "band [Hz]"]),
        "ladder": (added.ladder, ["+ coulomb_friction", "[deg/s]"]),
        "added": (added, ["the rms error on", "+ coulomb_friction"]),
        "diagnosis": (
            gsid.diagnose(model, records),
            ["issing is coulomb_friction", "Probability of coulomb_friction", "cost per d.o.f."],
        ),
        "prediction": (gsid.predict(model, records)[0], ["FIT ", "deg/s rms", NASTY]),
        "noise": (gsid.noise(records[0]), ["deg/s", NASTY]),
    }


KINDS = ["record", "response", "transfer function", "plant", "fit", "comparison", "ladder", "added"]
KINDS += ["diagnosis", "prediction", "noise"]


@pytest.mark.parametrize("kind", KINDS)
def test_html_of_a_result(results, kind):
    shown, words = results[kind]
    page = Shown(shown._repr_html_())
    assert set(page.tags) <= {"table", "caption", "thead", "tbody", "tr", "th", "td", "p", "pre"}
    for text in words:
        assert text in page.text
    assert len(page.text) < 2500


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plant"])
def test_plot_gives_axes_and_a_picture(results, kind):
    shown, _ = results[kind]
    figure = shown.plot()
    axes = list(figure)
    assert axes == figure.axes
    assert axes
    assert all(isinstance(ax, Axes) for ax in axes)
    first, *_ = figure
    first.set_title("mine")
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_a_record_without_a_period_has_a_picture_without_lines(records):
    whole = records[0]
    cut = dataclasses.replace(whole, u=whole.u[:1000], y=whole.y[:1000], valid=None, columns={})
    over_frequency, over_time = ([ax.get_xlabel() for ax in one.plot().axes] for one in (whole, cut))
    assert "frequency [Hz]" in over_frequency
    assert over_time == ["", "time [s]"]  # no position either: its settled part is not known


def test_every_type_with_a_figure_has_html():
    for place in plots.DRAWINGS:
        module, _, name = place.rpartition(".")
        kind = getattr(importlib.import_module(module), name)
        assert f"{kind.__module__}.{kind.__qualname__}" == place  # as `plot()` looks for it
        assert issubclass(kind, Plottable)
        assert callable(kind._repr_html_)


def test_every_drawing_function_is_found_and_no_other():
    for name in (*plots.__all__, *plots.DRAWINGS.values()):
        assert getattr(plots, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'comparisons'"):
        plots.comparisons  # noqa: B018
    with pytest.raises(TypeError, match="a Plottable cannot be plotted"):
        Plottable().plot()
