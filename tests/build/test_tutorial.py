"""docs/tutorial/first_hour.md: its commands print what it shows, and those of README.md's loop do."""

import os
import re
import shlex
import subprocess
import sys
import time

import pages
import pytest
from pages import assert_same_text, commands

pytestmark = [pytest.mark.long, pytest.mark.xdist_group("tutorial")]  # the module's fixture is made once
PAGE = "docs/tutorial/first_hour.md"
GSID = (sys.executable, "-m", "gsid.cli.main")


def blocks_in_order(text):
    """Language and text of each block."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


class SecondTerminal:
    """Starts a simulated axis and waits until its port is there."""

    def __init__(self, folder):
        self.folder, self.link, self.started = folder, folder / "axis", []

    def wait_until(self, condition, what):
        deadline = time.monotonic() + 60
        while not condition():
            assert time.monotonic() < deadline, what
            time.sleep(0.05)

    def start(self, command):
        self.wait_until(
            lambda: not os.path.lexists(self.link), "the axis before it did not end with its host"
        )
        words = [*GSID, *shlex.split(command)[1:]]
        self.started.append(subprocess.Popen(words, cwd=self.folder, stdout=subprocess.DEVNULL))
        self.wait_until(self.link.exists, "the axis did not start")

    def close(self):
        for process in self.started:
            process.terminate()
            process.wait(10)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("first_hour")


@pytest.fixture(scope="module")
def printed(root, folder):
    """What each command of the page prints, run in its order."""
    terminal, printed = SecondTerminal(folder), {}
    try:
        for language, text in blocks_in_order((root / PAGE).read_text()):
            if language == "json":
                (folder / "axis.json").write_text(text)
            elif language == "sh" and text.startswith("gsid simulate"):
                terminal.start(text)
            elif language == "console":
                for command, _ in commands(text):
                    words = [*GSID, *shlex.split(command)[1:]]
                    result = subprocess.run(words, cwd=folder, capture_output=True, text=True)
                    assert result.returncode == 0, f"{command}\n{result.stderr}"
                    printed[command] = result.stdout
    finally:
        terminal.close()
    return printed


def test_the_first_hour(printed, root):
    shown = [pair for block in pages.blocks(root / PAGE, "console") for pair in commands(block)]
    assert len(shown) == len(printed) == 10
    for command, text in shown:
        assert_same_text(printed[command], text)


def test_the_loop_of_the_readme(printed, root):
    loop = commands(pages.blocks(root / "README.md", "console")[0])
    assert len(loop) == 6
    for command, text in loop:
        assert_same_text(printed[command], text)


def test_the_diagnosis_of_the_readme(printed, root, folder):
    """The parts between the dots one by one."""
    ((command, shown),) = commands(pages.blocks(root / "README.md", "shell-session")[0])
    lines = printed[command].splitlines()
    parts = [part.strip().splitlines() for part in shown.split("...\n") if part.strip()]
    assert len(parts) == 2
    for part in parts:
        first = next(i for i, line in enumerate(lines) if line.split()[:2] == part[0].split()[:2])
        assert_same_text("\n".join(lines[first : first + len(part)]), "\n".join(part))
    assert (folder / "missing.png").stat().st_size > 0


def test_the_model_of_the_tutorial_is_a_file(root):
    shown = dict(blocks_in_order((root / PAGE).read_text()))["json"]
    assert (root / "docs/tutorial/axis.json").read_text() == shown
