"""The page from Python."""

import json
import urllib.error
import urllib.request
from http.cookiejar import CookieJar

import numpy as np
import pytest

import gsid
from gsid.study.folder import Study


@pytest.fixture
def record():
    t = np.arange(400)
    return gsid.Record(np.sin(t), np.cos(t), 100.0, 100, 0, y_unit="deg/s", name="axis.csv")


def test_records_are_shown_and_the_page_ends_with_stop(record, tmp_path):
    gsid.write_record(tmp_path / "other.csv", record)
    with gsid.studio(record, tmp_path / "other.csv", folder=tmp_path / "st", browser=False) as page:
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
        opener.open(page.address, timeout=60).close()
        state = json.load(opener.open(page.address.split("?")[0] + "state", timeout=60))
        assert state["records"] == ["records/axis.npz", "records/other.csv"]
        assert page.is_running
        assert page.address in page._repr_html_().replace("&amp;", "&")
    assert not page.is_running
    assert "stopped" in page._repr_html_()
    with pytest.raises(urllib.error.URLError):
        opener.open(page.address, timeout=5)


def test_a_record_is_kept_without_loss(record, tmp_path):
    gsid.studio(record, folder=tmp_path / "st", browser=False).stop()
    kept = gsid.read_record(Study(tmp_path / "st").path("records/axis.npz"))
    assert np.array_equal(kept.y, record.y)
    assert (kept.y_unit, kept.period_samples) == ("deg/s", 100)


def test_a_study_that_is_open_is_an_error_with_its_reason(tmp_path):
    place = {"folder": tmp_path / "st", "browser": False}
    with gsid.studio(**place), pytest.raises(gsid.InputError, match="open in another gsid studio"):
        gsid.studio(**place)
