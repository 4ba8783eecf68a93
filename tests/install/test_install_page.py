"""The commands of docs/how-to/install.md, as a user types them."""

import re

import pytest
from projects import ROOT, require, run

PAGE = ROOT / "docs/how-to/install.md"
pytestmark = pytest.mark.xdist_group("installed")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)


@pytest.mark.long
def test_the_commands_of_the_page_run(tmp_path):
    require("cmake", "pkg-config")
    script = "set -eu\n" + "".join(blocks("sh"))
    own = {"HOME": str(tmp_path), "BUILD": str(tmp_path / "build"), "CFLAGS": "-O1"}
    printed = run("bash", "-c", script, **own).stdout
    assert "0.0000 3.0000" in printed


def test_the_cmake_lines_of_the_page_are_those_of_the_projects(tmp_path):
    projects = [path.read_text() for path in ROOT.glob("tests/install/cmake_*/CMakeLists.txt")]
    for block in blocks("cmake"):
        lines = [line for line in block.splitlines() if not line.startswith("target_link_libraries")]
        assert any(all(line in project for line in lines) for project in projects), block
