"""make abi-check: what it calls compatible, and what not."""

import re
import shutil
from pathlib import Path

import pytest
from projects import ROOT, require, run

pytestmark = pytest.mark.xdist_group("installed")


@pytest.fixture
def earlier(tmp_path) -> Path:
    """Return a copy of the sources to change, as an earlier version."""
    require("abidiff", "cmake", "readelf")
    for folder in ("include", "src", "packaging"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    shutil.copy(ROOT / "CMakeLists.txt", tmp_path)
    return tmp_path


def changed(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_field_in_the_middle_of_a_struct_is_not_compatible_and_a_new_function_is(earlier):
    """The core lost a field of a frame; the host library has one more function, and no frames."""
    changed(
        earlier / "include/gsid/link.h", "    uint32_t tick;", "    uint32_t n_other;\n    uint32_t tick;"
    )
    text = (earlier / "include/gsid/host/steady.h").read_text()
    (declaration,) = re.findall(r"gsid_status gsid_steady_run_near\([^;]*;", text)
    changed(earlier / "include/gsid/host/steady.h", declaration, "")
    changed(earlier / "src/host/steady.c", "gsid_status gsid_steady_run_near(", "static gsid_status unused(")
    result = run("tools/abi_check", earlier, check=False)
    assert result.returncode == 1
    assert "n_other" in result.stdout
    for library, state in (("core", "differs"), ("core_single", "differs"), ("host", "compatible")):
        assert f"libgsid_{library}: {state}" in result.stdout
