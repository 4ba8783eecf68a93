"""The report: one page that needs nothing else, holds every section, and takes any text as text."""

import base64
import dataclasses
import html.parser
import itertools
import json
import os
import re
import sys

import numpy as np
import pytest
from plants import axis_record, plant

from gsid import plots
from gsid.base.errors import InputError
from gsid.comparison import compare
from gsid.diagnosis.add import add
from gsid.diagnosis.from_records.diagnose import diagnose
from gsid.excitation.multisine import Multisine
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.report import Report, Truth
from gsid.report.tables import plant_table
from gsid.response.estimate import frf
from gsid.response.frf import Frf
from gsid.spectrum.realisation import spectra

FS_HZ, N = 3000.0, 1500
pytestmark = pytest.mark.xdist_group("report")  # the module's fixture is made once
NASTY = 'rig <script>alert("&")</script>.csv'
VOID = {"meta", "link", "br", "hr", "img", "input"}


class Page(html.parser.HTMLParser):
    """What a browser would see: a well-nested tree, its attributes and its words."""

    def __init__(self, text):
        super().__init__()
        self.open, self.attributes, self.words, self.tags = [], [], [], []
        self.headings = []  # level, text, whether it is folded
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.words.append(data)
        for tag in self.open:
            if re.fullmatch(r"h[1-6]", tag):
                folded = "details" in self.open and "summary" not in self.open
                self.headings.append((int(tag[1]), data.strip(), folded))

    @property
    def text(self):
        return re.sub(r"\s+", " ", " ".join(self.words))

    def values(self, attribute):
        return [value for _, name, value in self.attributes if name == attribute]


def model(**changes):
    cov = np.diag(np.array([0.05, 2.0, 0.02, 0.5, 1e-5]) ** 2)
    whole = RationalModel(
        [7.4, 81.4], [1.0, 11.0, 170.0], 0.0054, fs_hz=FS_HZ, cov=cov, free_delay=True, y_unit="deg/s"
    )
    return dataclasses.replace(whole, **changes)


def simulate(multisine, n_periods=4, name="axis.csv"):
    rng = np.random.default_rng(11)
    spectrum = np.zeros(N // 2 + 1, dtype=complex)
    spectrum[1:] = np.fft.rfft(multisine.table())[1:] * model().response(np.arange(1, N // 2 + 1) * FS_HZ / N)
    y = np.tile(np.fft.irfft(spectrum, N), n_periods) + 0.05 * rng.standard_normal(n_periods * N)
    u = np.tile(multisine.table(), n_periods)
    return Record(u, y, FS_HZ, N, 0, u_unit="V", y_unit="deg/s", name=name)


@pytest.fixture(scope="module")
def multisine():
    return Multisine.design(FS_HZ, N, (2.0, 250.0), grid="odd", rms=10.0)


@pytest.fixture(scope="module")
def written(multisine, tmp_path_factory):
    record = simulate(multisine, name=NASTY)
    wrong = model(den=[1.0, 11.0, 250.0])
    report = Report("Axis <1> & its mount", command="gsid report 'a <b>.csv'")
    for name, shown in (("Right model", model()), ("Wrong model", wrong)):
        report.add_experiment(
            name,
            record,
            spectra(record),
            frf(record),
            shown,
            compare(shown, record),
            multisine=multisine,
            truth=[Truth("delay", "ms", 5.4, 5.42, 0.01), Truth("gain", "", 7.4, 7.4, 0.0)],
            story="What was done, <b>in words</b>.",
        )
    path = report.write(tmp_path_factory.mktemp("report") / "report.html")
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(written):
    return Page(written)


def test_needs_nothing_from_outside(written, page):
    for name in ("src", "href", "xlink:href", "data", "action", "poster", "srcset"):
        for value in page.values(name):
            assert value.startswith(("#", "data:image/png;base64,")), value
    assert "@import" not in written
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", written))
    assert {"script", "link", "iframe", "object"}.isdisjoint(page.tags)
    # the names of the vocabularies are all that looks like an address
    assert len(re.findall(r"https?://", written)) == len(re.findall(r'xmlns(?::\w+)?="https?://', written))


def test_ids_are_unique_and_found(page):
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    for value in page.values("href") + page.values("xlink:href"):
        if value.startswith("#"):
            assert value[1:] in ids


@pytest.mark.parametrize(
    "words",
    [
        "Axis <1> & its mount",
        "What was done, <b>in words</b>.",
        "Measurement",
        "True and estimated values",
        "Fitted model",
        "Poles and zeros",
        "Parameters",
        "Excitation",
        "Periods",
        "Frequency response",
        "Measured and fitted",
        "Complex residual",
        "Comparison at the output",
        "Where the model fails",
        "How this page was made",
        "gsid report 'a <b>.csv'",
        "FFTW",
        "NLopt",
        "numpy",
        "3000 Hz",
        "4 good, 0 left out for lost samples",
        "5.400 ± 0.020 ms (16.20 samples)",
        "+2.00",
        NASTY,
    ],
)
def test_contains(page, words):
    assert words in page.text


def test_verdict_of_each_experiment_stands_at_the_top(page):
    header = page.text.split("Measured and simulated signal")[0]
    assert "Adequate: " in header
    assert "Not adequate: " in header


def test_every_picture_has_a_text_and_a_caption_for_both_widths(page):
    assert page.tags.count("figure") == page.tags.count("figcaption") == 16
    assert page.tags.count("svg") == 32
    texts = page.values("aria-label")
    assert len(texts) == 32
    assert all(len(text) > 40 for text in texts)
    kinds = [value for tag, name, value in page.attributes if (tag, name) == ("svg", "class")]
    assert kinds == ["wide", "narrow"] * 16


def test_signal_and_response_are_open_and_everything_else_is_folded(page):
    opened = [text for level, text, folded in page.headings if not folded]
    each = ["Measured and simulated signal", "Measured and fitted", "Where the model fails"]
    each += ["Model and parameters", "Response in detail", "Measurement"]  # the names of the folds
    expected = ["Axis <1> & its mount", "Right model", *each, "Wrong model", *each]
    assert opened == [*expected, "How this page was made"]
    assert ("details", "open", None) not in page.attributes


def test_headings_go_down_one_level_at_a_time(page):
    levels = [level for level, _, _ in page.headings]
    assert levels[0] == 1
    assert all(below - above <= 1 for above, below in itertools.pairwise(levels))
    assert ("html", "lang", "en") in page.attributes


def test_a_page_of_one_story_begins_with_its_answer(undrawn, multisine):
    """A bug: the page began with its tables, and the verdict stood there twice."""
    record = simulate(multisine)
    measured, wrong = spectra(record), model(den=[1.0, 11.0, 250.0])
    page = Report("t", command="c").add_experiment(
        "e", record, measured, frf(record), wrong, compare(wrong, record)
    )
    text = Page(page.html()).text.removeprefix(" t t ").lstrip()
    assert text.startswith("Not adequate: ")
    assert text.count("Not adequate: ") == 1
    answer, rest = text.split("Measured and simulated signal", 1)
    for words in ("What is missing is not known: ", "Next: find the missing effect.", "gsid diagnose REC..."):
        assert words in answer
    assert "FIT " in rest


def test_the_signal_is_that_of_the_record_that_is_predicted_worst(undrawn, multisine):
    records = [simulate(multisine, name="good.csv"), simulate(multisine, name="bad.csv")]
    records[1].y *= 1.01
    page = Report("t").add_experiment("e", records, [spectra(r) for r in records], model=model())
    assert (
        "One period of bad.csv, of 2 records the one with the largest error. FIT 9" in Page(page.html()).text
    )


def test_size(written):
    assert len(written) < 3_000_000


def test_pictures_for_what_there_is(multisine):
    record = simulate(multisine)
    measured = frf(record)
    cases = [
        ({}, "No frequency response."),
        ({"frf": measured}, "no model was fitted"),
        ({"record": record, "spectra": spectra(record), "frf": measured}, "no model was fitted"),
        ({"model": RationalModel([2.0], [1.0])}, "Fitted: a 0/0 model"),
        ({"model": model(), "frf": measured}, "not compared with a record"),
    ]
    for given, verdict in cases:
        assert verdict in Page(Report("t").add_experiment("e", **given).html()).text


def test_realisations_are_all_named(undrawn, multisine):
    records = [simulate(multisine, name="one.csv"), simulate(multisine, name="two.csv")]
    records[1].y *= 1.01  # another realisation
    page = Report("t").add_experiment("e", records, [spectra(r) for r in records], frf(records))
    text = Page(page.html()).text
    assert "one.csv, two.csv" in text
    assert "Realisations 2" in text


def test_the_strongest_excitation_stands_beside_the_limits(undrawn, multisine, monkeypatch):
    """A bug: of records of several levels the first was drawn beside the limits of command and travel."""
    drawn = []
    excitation = plots.excitation
    monkeypatch.setattr(plots, "excitation", lambda s, *a, **k: drawn.append(s) or excitation(s, *a, **k))
    records = [simulate(multisine, name="one.csv"), simulate(multisine, name="two.csv")]
    records[1].u *= 2
    Report("t").add_experiment("e", records, [spectra(r) for r in records])
    assert {one.name for one in drawn} == {"two.csv"}


def test_a_page_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    path.write_text("old")

    def no_space(*_args):
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", no_space)
    with pytest.raises(OSError, match="no space"):
        Report("t").write(path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_difference_from_the_truth():
    assert Truth("delay", "ms", 5.4, 5.37, 0.01).n_sigma == pytest.approx(-3.0)
    assert np.isnan(Truth("delay", "ms", 5.4, 5.4, 0.0).n_sigma)


# ---- plants and diagnoses --------------------------------------------------------------------------------

AXIS = {"gain": 7.4, "viscous_rate": 11.0, "spring_stiffness": 170.0, "delay_s": 0.0054}
STACK = {
    "rigid_body": {"gain": 7.4},
    "viscous_friction": {"rate": 11.0},
    "cable_spring": {"stiffness": 170.0},
    "transport_delay": {"delay_s": 0.0054},
}


@pytest.fixture(scope="module")
def friction():
    """Four records of the simulated axis with dry friction, two at each level."""
    records = []
    for i, amplitude in enumerate((3.0, 3.0, 6.0, 6.0)):
        u = Multisine.design(FS_HZ, N, (2.0, 100.0), grid="odd", phases="random", seed=i, amplitude=amplitude)
        records.append(axis_record(u.table(), 4, 0.02, i, f"r{i}", coulomb_level=2.0, **AXIS))
    return records


def test_plant_with_its_ladder(friction):
    measured = [spectra(r) for r in friction]
    added = add("coulomb_friction", plant(STACK), measured)
    report = Report("t").add_experiment(
        "e", friction, measured, frf(friction), added.model, compare(added.model, measured)
    )
    page = Page(report.html())
    for words in (
        "Plant",
        "coulomb_friction",
        "deg/s^2",
        "Measured and fitted",
        "Complex residual",
        "Ladder",
    ):
        assert words in page.text
    assert page.tags.count("figure") == 8
    assert "the rms error on" in page.text.lower()
    bare = Page(Report("t").add_experiment("e", model=plant(STACK)).html())
    assert "A plant of 4 effects; not compared" in bare.text


@pytest.mark.parametrize("method", ["ml", "nls-output"])
def test_cost_of_a_plant_is_1_for_noise_by_maximum_likelihood_only(method):
    """Least squares of the output had been told so too; its cost has no such mean."""
    model = plant({"rigid_body": {"gain": 900.0}})
    model.fit = {"cost_per_dof": 157.0, "method": method}
    note = plant_table(model).note
    assert note.startswith("Cost per degree of freedom 157: ")
    assert ("1 when only noise is left" in note) == (method == "ml")


@pytest.fixture(scope="module")
def found(friction):
    return diagnose(plant(STACK), [spectra(r) for r in friction])


def page_of(diagnosis, **more):
    return Page(Report("t", command="c").add_diagnosis("d", diagnosis, **more).html())


def test_diagnosis(friction, found):
    ladder = add("coulomb_friction", plant(STACK), found.measured).ladder
    page = page_of(found, ladder=ladder)
    opened = [text for _, text, folded in page.headings if not folded]
    pictures = ["t", "Measured and simulated signal", "Measured and fitted", "Ladder"]
    folds = ["Where the linear model fails", "Which effect is missing", "Model and parameters"]
    assert opened == [*pictures, *folds, "Response in detail", "Measurement", "How this page was made"]
    answer, rest = page.text.split("Measured and simulated signal", 1)
    assert f"Not adequate: {found.sentence[0].lower()}{found.sentence[1:]}" in answer
    assert "How sure: the probability of coulomb_friction is" in answer
    assert "Next: judge the effect on a new record, which this search has not used." in answer
    assert "gsid add coulomb_friction --model" in answer
    for words in (
        "r0, r1, r2, r3",
        "% without coulomb_friction, ",
        "Which effect",
        "explained, kept out",
        "Error before an effect is added",
        "Missing torque",
        "With the effects found",
        "Bands with an excess",
        "Assumed",
        "Not tried",
    ):
        assert words in rest
    assert "assumed: " not in page.text  # in a table, not in the sentences
    assert page.tags.count("figure") == 9


def test_diagnosis_that_finds_nothing(undrawn, friction, found):
    page = page_of(diagnose(found.model, found.measured))
    answer, rest = page.text.split("Measured and simulated signal", 1)
    assert "Adequate: these data show no missing effect." in answer
    assert "an effect smaller than the noise of these records would not show" in answer
    assert "Next: use the model from 2 to 98 Hz" in answer
    assert " without " not in rest.split("Measured and fitted")[0]
    assert "Missing torque" not in page.text


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"verdict": "nearest_effect", "nearest": [("coulomb_friction",)], "reasons": ("It is small.",)},
            [
                "Not adequate: an effect is missing; the nearest is coulomb_friction",
                "no law is named, because: It is small.",
                "add the nearest law",
                "with coulomb_friction; noise",
            ],
        ),
        (
            {"verdict": "unknown_effect", "effects": (), "found": [], "law_model": None},
            ["Not adequate: an effect is missing; these data confirm no law", "--curve CURVE.csv"],
        ),
        (
            {"next_experiment": "To distinguish a from b: twice the amplitude."},
            ["Next: to distinguish a from b: twice the amplitude."],
        ),
        ({"interrupted": True}, ["The diagnosis was interrupted"]),
        (
            {"linear": None, "model": None, "ranking": [], "effects": (), "verdict": "unknown_effect"},
            ["No law was judged.", "gsid look REC..."],
        ),
    ],
    ids=["nearest", "unknown", "group", "interrupted", "no stack"],
)
def test_answer_of_every_kind_of_diagnosis(undrawn, found, changes, words):
    page = page_of(dataclasses.replace(found, **changes))
    for text in words:
        assert text in page.text


def test_a_diagnosis_of_a_given_model_gives_one_story(undrawn, friction, found):
    """A bug: the verdict on the unfitted values of the model stood first, the diagnosis in a second story."""
    given = plant(STACK | {"rigid_body": {"gain": 9.0}})
    measured = found.measured
    report = Report("t", command="c").add_experiment(
        "e", friction, measured, frf(friction), given, compare(given, measured), diagnosis=found
    )
    page = Page(report.html())
    assert (
        page.text.split("Measured and simulated")[0].count("Not adequate: missing is coulomb_friction") == 1
    )
    assert page.tags.count("article") == 1
    unfitted = ("The given model, before its parameters are fitted", False)
    assert unfitted in [(text, folded) for _, text, folded in page.headings]


def test_a_response_from_a_table_has_a_page():
    """A bug: its period is not known, and the page divided by it."""
    response = Frf.from_arrays([1.0, 2.0, 4.0], [1.0, 0.5j, -0.2])
    assert "no model was fitted" in Page(Report("t").add_experiment("e", frf=response).html()).text


# ---- interactive pictures --------------------------------------------------------------------------------


def test_interactive_page_holds_plotly_and_its_figures(multisine):
    record = simulate(multisine, name=NASTY)
    page = Report("t", interactive=True).add_experiment("e", record, spectra(record), frf(record), model())
    text = page.html()
    assert "plotly.js v" in text
    figures = re.findall(r'<script type="application/json">(.*?)</script>', text)
    assert len(figures) == Page(text).tags.count("figure")
    for figure in map(json.loads, figures):
        assert set(figure) - {"dataNarrow"} == {"data", "wide", "narrow"}
        bytes_of_x = base64.b64decode(figure["data"][0]["x"]["bdata"])
        assert np.isfinite(np.frombuffer(bytes_of_x, "<f4")).any()
    assert Page(text).tags.count("script") == len(figures) + 2  # none of a file's name


def test_interactive_without_plotly_is_a_clear_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(InputError, match=r"interactive pictures need plotly.*\n.*pip install plotly"):
        Report("t", interactive=True)
