"""docs/how-to/several_axes.md: its commands print what it shows."""

import shlex
import sys

import pages
import pytest

pytestmark = pytest.mark.xdist_group("several_axes")


@pytest.mark.long
def test_the_page(run, root, tmp_path):
    for block in pages.blocks(root / "docs/how-to/several_axes.md", "console"):
        for command, shown in pages.commands(block):
            name, *arguments = shlex.split(command)
            assert name == "gsid"
            program = [sys.executable, "-m", "gsid.cli.main", *arguments]
            result = run(*program, cwd=tmp_path, COLUMNS="100", NO_COLOR="1")
            assert result.returncode == 0, f"{command}\n{result.stderr}"
            pages.assert_same_text(result.stdout, shown)
