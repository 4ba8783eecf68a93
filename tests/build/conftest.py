"""What the tests of the build share."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture
def run(root):
    """Run a command in the clone, or in `cwd`, and give its result with both outputs as text."""

    def run(*command, cwd=root, **variables):
        outer_make = ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")
        environment = {
            name: value for name, value in os.environ.items() if name not in outer_make
        } | variables
        words = [str(word) for word in command]
        return subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True)

    return run


@pytest.fixture
def tree(root, tmp_path) -> Path:
    """Return a copy of the C sources and the Makefile to plant violations in."""
    for folder in ("include", "src", "tools"):
        shutil.copytree(root / folder, tmp_path / folder)
    for makefile in (root / "Makefile", *root.glob("tests/*/*.mk"), *root.glob("firmware_examples/*.mk")):
        copy = tmp_path / makefile.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(makefile, copy)
    return tmp_path
