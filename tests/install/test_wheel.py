"""The wheel of `make wheel` in a bare virtual environment: no GPL library, the demo as in the clone."""

import json
import os
import re
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path

import pytest
from projects import ROOT

WHEEL = os.environ.get("GSID_WHEEL")
pytestmark = [
    pytest.mark.skipif(WHEEL is None, reason="`make test-wheel` builds the wheel and runs these tests"),
    pytest.mark.xdist_group("installed"),
]
SLOWER_MOST = 3.0


def only(pattern: str) -> Path:
    (found,) = (ROOT / WHEEL).glob(pattern)
    return found


@pytest.fixture(scope="module")
def bare(tmp_path_factory) -> Path:
    """Return the folder of the programs of a new virtual environment with the wheel."""
    folder = tmp_path_factory.mktemp("bare")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    pip = [folder / "bin/python", "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    subprocess.run([*pip, "-c", ROOT / "requirements.txt", only("*.whl")], check=True)
    return folder / "bin"


def command(program: Path, *arguments: str, cwd: Path) -> subprocess.CompletedProcess:
    """Run a program with a PATH that has neither compilers nor tools of the system."""
    environment = {"PATH": str(program.parent), "HOME": str(cwd), "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run([program, *arguments], cwd=cwd, env=environment, capture_output=True, text=True)


def test_one_wheel_serves_every_later_python():
    assert re.fullmatch(r"gsid-[\d.]+-cp311-abi3-manylinux_\S+\.whl", only("*.whl").name)


def test_the_wheel_carries_no_gpl_library_and_lists_what_it_carries():
    with zipfile.ZipFile(only("*.whl")) as wheel:
        names = wheel.namelist()
        libraries = [Path(name).name for name in names if name.startswith("gsid.libs/") and ".so" in name]
        assert [name.partition("-")[0] for name in libraries] == ["libnlopt"]
        (bill,) = (
            json.loads(wheel.read(name)) for name in names if "/sboms/" in name and name.endswith(".json")
        )
        assert any("LICENSE" in name for name in names)
    assert bill["bomFormat"] == "CycloneDX"
    assert any("nlopt" in part["name"] for part in bill["components"])


def test_the_sdist_has_all_sources():
    with tarfile.open(only("*.tar.gz")) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    tracked = [path.relative_to(ROOT) for top in ("src", "include") for path in (ROOT / top).rglob("*.[ch]")]
    assert {str(path) for path in tracked} <= names
    assert {"python/gsid_build.py", "pyproject.toml", "LICENSE"} <= names
    assert not [name for name in names if name.endswith(".so")]


def test_the_doctor_of_the_wheel_finds_nothing_wrong(bare, tmp_path):
    result = command(bare / "gsid", "doctor", "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    checks = {check["name"]: check for check in json.loads(result.stdout)["checks"]}
    assert checks["variant"]["found"] == "without GPL libraries"
    assert checks["nlopt"]["licence"].startswith("LGPL")


def test_version_is_one_line(bare, tmp_path):
    assert re.fullmatch(r"gsid \d+\.\d+\.\d+\n", command(bare / "gsid", "--version", cwd=tmp_path).stdout)


def test_the_demo_gives_the_same_verdicts_as_in_the_clone(bare, tmp_path):
    printed, seconds = [], []
    for name, program in (("wheel", bare / "gsid"), ("clone", ROOT / ".venv/bin/gsid")):
        (tmp_path / name).mkdir()
        start = time.monotonic()
        result = command(program, "demo", cwd=tmp_path / name)
        seconds.append(time.monotonic() - start)
        assert result.returncode == 0, result.stdout + result.stderr
        lines = re.findall(r"^ +(yes|NO) +(.*)$", result.stdout, re.MULTILINE)
        printed.append([(verdict, re.sub(r"[\d.]+", "#", text)) for verdict, text in lines])
    print(f"demo: wheel {seconds[0]:.1f} s, clone {seconds[1]:.1f} s, {len(printed[0])} lines of yes")
    assert printed[0] == printed[1]
    assert [verdict for verdict, _ in printed[0]] == ["yes"] * 9
    assert seconds[0] <= SLOWER_MOST * seconds[1]
