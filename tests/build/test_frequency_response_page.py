"""docs/how-to/frequency_response.md: its program runs, its commands print what it shows."""

import shlex
import sys

import pages
from pages import assert_same_text, commands


def test_the_page(run, root, tmp_path):
    page = root / "docs/how-to/frequency_response.md"
    (program,) = pages.blocks(page, "python")
    (tmp_path / "made.py").write_text(program)
    programs = {"gsid": [sys.executable, "-m", "gsid.cli.main"], "python": [sys.executable]}
    for block in pages.blocks(page, "console"):
        for command, shown in commands(block):
            name, *arguments = shlex.split(command)
            result = run(*programs[name], *arguments, cwd=tmp_path)
            assert result.returncode == 0, f"{command}\n{result.stderr}"
            assert_same_text(result.stdout, shown)
