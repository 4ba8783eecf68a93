"""make abi-check: a field in the middle of a public struct is not compatible."""

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


def test_a_field_in_the_middle_of_a_struct_is_not_compatible(earlier):
    header = earlier / "include/gsid/rational.h"
    text = header.read_text()
    assert "    gsid_real delay_s;" in text
    header.write_text(text.replace("    gsid_real delay_s;", "    uint32_t n_other;\n    gsid_real delay_s;"))
    result = run("tools/abi_check", earlier, check=False)
    assert result.returncode == 1
    assert "n_other" in result.stdout
    assert "libgsid_core: differs" in result.stdout
