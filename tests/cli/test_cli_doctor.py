"""gsid doctor: packages that are not installed, what the build contains, and licences."""

import importlib.metadata
import json
import subprocess
import sys

import pytest

from gsid._lib import ffi, lib
from gsid.cli.doctor import BACKENDS, _backend, _packages, _variant
from gsid.cli.main import main


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


def test_licences_and_variant_are_printed(capsys):
    assert main(["doctor", "--json"]) == 0
    checks = {check["name"]: check for check in json.loads(capsys.readouterr().out)["checks"]}
    assert checks["gsid"]["licence"] == "MIT"
    assert "BSD" in checks["scipy"]["licence"]
    has_fftw = ffi.string(lib.gsid_build_library_version(b"fftw")) != b""
    assert ("fftw" in checks["variant"]["found"]) == has_fftw
    assert ("GPL" in checks["fftw"]["licence"]) == has_fftw


def test_bug_dask_in_the_same_process_broke_the_doctor():
    """Dask imports importlib_metadata, where a key that a package does not state is a KeyError."""
    code = (
        "import importlib_metadata, sys; from gsid.cli.main import main; sys.exit(main(['doctor', '--json']))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    assert json.loads(result.stdout)["ok"]


def test_a_build_without_gpl_libraries_is_complete(monkeypatch):
    """FFTW and SuiteSparse have replacements; without NLopt methods are missing."""
    monkeypatch.setattr("importlib.import_module", lambda name: _NoBackends)
    assert _variant().found == "without GPL libraries"
    complete = {name: _backend(name, *facts).ok for name, facts in BACKENDS.items()}
    assert complete == {"fftw": True, "nlopt": False, "suitesparse": True}
    assert "numpy" in _backend("fftw", *BACKENDS["fftw"]).found


class _NoBackends:
    """A core that was built without any library."""

    ffi = ffi

    class lib:
        @staticmethod
        def gsid_build_library_version(name):
            return ffi.new("char[]", b"")
