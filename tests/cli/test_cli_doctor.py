"""gsid doctor and packages that are not installed."""

import importlib.metadata

import pytest

from gsid.cli.doctor import _packages


@pytest.fixture
def nothing_installed(monkeypatch):
    def missing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    needed = ["numpy>=2", 'starlette>=1; extra == "studio"', "plotly>=6 ; extra == 'studio'"]
    monkeypatch.setattr("importlib.metadata.requires", lambda name: needed)
    monkeypatch.setattr("importlib.metadata.version", missing)


def test_a_missing_package_of_an_extra_is_not_wrong(nothing_installed):
    checks = {check.name: check for check in _packages()}
    assert list(checks) == ["numpy", "starlette", "plotly"]
    assert [check.ok for check in checks.values()] == [False, True, True]
    assert "make" in checks["numpy"].hint
    for name in ("starlette", "plotly"):
        assert checks[name].found == "not installed"
        assert checks[name].hint == "optional: `pip install 'gsid[studio]'`"
