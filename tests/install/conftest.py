"""An installation in a temporary folder."""

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from projects import require, run


@dataclass
class Installation:
    """What `make install` has made."""

    prefix: Path
    make: Callable[..., subprocess.CompletedProcess]  # another target with the same PREFIX


@pytest.fixture(scope="session")
def installed(tmp_path_factory) -> Installation:
    require("cmake", "pkg-config")
    top = tmp_path_factory.mktemp("installed")

    def make(target: str, *settings: str, **options) -> subprocess.CompletedProcess:
        quick = ["CFLAGS=-O1", f"BUILD={top / 'build'}", f"PREFIX={top / 'prefix'}"]
        return run("make", target, *quick, *settings, **options)

    make("install")
    return Installation(top / "prefix", make)
