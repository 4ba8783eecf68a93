"""docs/reference/thesis_study.md is up to date: its sources, and what gsid computes in the quick study."""

import importlib
import json
import re
import sys

import pytest

FOLDER = "benchmarks/thesis"
#: Of a figure. The axis and its noise are the same everywhere, and minima are found to far less than this.
RELATIVE = 2e-3


@pytest.fixture(scope="module")
def write_page(request):
    """The module that writes the page."""
    root = request.config.rootpath
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root / FOLDER))
        yield importlib.import_module("write_page")
        for name in ("write_page", "thesis_study", *sys.modules["write_page"].CHAPTERS):
            sys.modules.pop(name, None)


def numbers(text):
    return [float(x) for x in re.findall(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?", text)]


def test_the_page_is_of_these_sources(root, write_page):
    made = re.search(r"<!-- sources: (\w+) -->", (root / "docs/reference/thesis_study.md").read_text())
    assert made, "the page has no fingerprint"
    assert made[1] == write_page.fingerprint(), f"{FOLDER} has changed: call `make thesis`"


@pytest.mark.long
def test_gsid_still_computes_the_figures(root, write_page):
    """The quick form takes every path of the study with few periods."""
    kept = json.loads((root / FOLDER / "quick_figures.json").read_text())
    found = write_page.quick_figures()
    assert list(found) == list(kept)
    for chapter, figures in found.items():
        assert len(figures) == len(kept[chapter])
        for now, before in zip(figures, kept[chapter], strict=True):
            ours = f"{chapter}: {before} is now {now}; if this is meant, call `make thesis`"
            assert numbers(now) == pytest.approx(numbers(before), rel=RELATIVE, abs=1e-9), ours


def test_every_picture_of_the_page_exists(root, write_page):
    page = root / "docs/reference/thesis_study.md"
    shown = re.findall(r"\]\((\S+\.png)\)", page.read_text())
    assert len(shown) == sum(len(importlib.import_module(name).PICTURES) for name in write_page.CHAPTERS)
    for picture in shown:
        assert (page.parent / picture).is_file(), picture
