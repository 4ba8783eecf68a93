"""One table in three forms: aligned text, Markdown and HTML, and every object that shows one."""

from xml.etree import ElementTree

import pytest

import gsid
from gsid.base.tables import Table
from gsid.effects.types import catalogue
from gsid.fitting.estimators import fit_all
from gsid.fitting.piecewise import fit_piecewise
from gsid.models.rational import RationalModel
from gsid.response.frf import Frf

TABLE = Table(["name", "value [Hz]"], [["a|b", "7"], ["<i>", "12.5"]], left=["name"], title="x & y")


def test_text_aligns_words_to_the_left_and_numbers_to_the_right():
    assert TABLE.text().splitlines() == [
        "name  value [Hz]",
        "a|b            7",
        "<i>         12.5",
    ]


def test_markdown_escapes_a_bar_in_a_cell():
    assert TABLE.markdown().splitlines() == [
        "| name | value [Hz] |",
        "|---|---:|",
        r"| a\|b | 7 |",
        "| <i> | 12.5 |",
    ]


def test_a_column_without_entries_is_left_out():
    table = Table(["order", "held out", ""], [["1/0", "", ""], ["2/1", "", ""]])
    assert table.without_empty(["held out"]) == Table(["order", ""], [["1/0", ""], ["2/1", ""]])


def frf():
    f_hz = [2.0 * i for i in range(1, 31)]
    g = RationalModel([100.0], [1.0, 30.0, 900.0], 1e-3).response(f_hz)
    return Frf.from_arrays(f_hz, g, (1e-3 * abs(g)) ** 2, fs_hz=1000.0)


@pytest.mark.parametrize(
    "shown",
    [
        lambda: TABLE,
        frf,
        lambda: catalogue()["coulomb_friction"],
        lambda: RationalModel([100.0], [1.0, 30.0, 900.0], 1e-3),
        lambda: fit_all(frf(), "2/0", methods=["ls", "ml"]),
        lambda: fit_piecewise(frf(), "2/0", 2),
        lambda: gsid.select_order(frf(), ["1/0", "2/0"]),
    ],
    ids=["Table", "Frf", "EffectType", "RationalModel", "Estimators", "PiecewiseModel", "OrderChoice"],
)
def test_a_notebook_shows_a_table(shown):
    table = ElementTree.fromstring(f"<div>{shown()._repr_html_()}</div>").find("table")
    assert len(table.findall("tbody/tr")) > 0


def test_html_escapes_its_text():
    table = ElementTree.fromstring(TABLE.html())
    assert table.findtext("caption") == "x & y"
    assert [cell.text for cell in table.findall("thead/tr/th")] == list(TABLE.head)
    assert [[cell.text for cell in row] for row in table.findall("tbody/tr")] == [
        ["a|b", "7"],
        ["<i>", "12.5"],
    ]
