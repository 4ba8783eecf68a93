"""What the tests of installations share: commands, and projects that skip where a tool is missing."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


def run(*command, cwd=ROOT, check=True, **variables) -> subprocess.CompletedProcess:
    """Run a command; `check` fails the test with its outputs when the command fails."""
    outer_make = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")
    environment = {name: value for name, value in os.environ.items() if name not in outer_make} | variables
    words = [str(word) for word in command]
    result = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True)
    assert not check or result.returncode == 0, f"{words}\n{result.stdout[-2000:]}\n{result.stderr[-4000:]}"
    return result


def require(*tools: str) -> None:
    """Skip the test when a program is missing, and report which."""
    if missing := [tool for tool in tools if shutil.which(tool) is None]:
        pytest.skip(f"no {', '.join(missing)}: `tools/setup install` installs it")


def cmake_project(folder: str, out: Path, *settings: str) -> None:
    """Build one of the projects here with CMake."""
    run("cmake", "-S", HERE / folder, "-B", out, *settings)
    run("cmake", "--build", out, "-j2")
