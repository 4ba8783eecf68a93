"""gsid report: the page is written, its name printed, and misuse is refused."""

import json
import sys
from pathlib import Path

from gsid.models.rational import RationalModel


def test_page_with_a_fit(gsid, rec_csv):
    result = gsid("report", rec_csv, "--order", "2/0", "-o", "page.html")
    assert result.code == 0
    assert result.out == "page.html\n"
    text = Path("page.html").read_text(encoding="utf-8")
    assert "Report on rec.csv" in text
    assert "2/0 in s" in text
    assert "Adequate: " in text


def test_the_order_is_chosen_on_request(undrawn, gsid, rec_csv):
    """A bug: what `gsid fit` takes as an order, the report refused."""
    orders = json.loads(gsid("fit", rec_csv, "--order", "auto", "--json").out)["orders"]
    (chosen,) = (row["order"] for row in orders if row["chosen"])
    result = gsid("report", rec_csv, "--order", "auto", "-o", "page.html")
    assert result.code == 0
    assert f"order {chosen} chosen" in result.err
    assert f"{chosen} in s" in Path("page.html").read_text(encoding="utf-8")


def test_page_with_a_model_from_a_file(undrawn, gsid, rec_csv):
    RationalModel([80.0], [1.0, 50.0]).save("model.json")
    result = gsid("report", rec_csv, "--model", "model.json", "--title", "A <lag>", "--json")
    assert result.code == 0
    assert json.loads(result.out) == {"report": "report.html", "adequate": False}
    assert "<h1>A &lt;lag&gt;</h1>" in Path("report.html").read_text(encoding="utf-8")


def test_page_without_a_model(undrawn, gsid, rec_csv):
    assert gsid("report", rec_csv, "--band", "10:150").code == 0
    assert "no model was fitted" in Path("report.html").read_text(encoding="utf-8")


def test_model_and_order_exclude_each_other(gsid, rec_csv):
    result = gsid("report", rec_csv, "--order", "2/0", "--model", "model.json")
    assert result.code == 2
    assert "--model or --order, not both" in result.err
    assert not Path("report.html").exists()


def test_missing_folder_is_bad_input(gsid, rec_csv):
    result = gsid("report", rec_csv, "-o", "none/page.html")
    assert result.code == 3
    assert "hint:" in result.err


def test_interactive_page_has_plotly(gsid, rec_csv):
    assert gsid("report", rec_csv, "--interactive").code == 0
    text = Path("report.html").read_text(encoding="utf-8")
    assert "plotly.js v" in text
    assert 'class="plot"' in text


def test_interactive_without_plotly_is_an_error_with_a_hint(gsid, rec_csv, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    result = gsid("report", rec_csv, "--interactive")
    assert result.code == 3
    assert "interactive pictures need plotly" in result.err
    assert "hint: pip install plotly" in result.err
    assert not Path("report.html").exists()
