"""A plugin of pytest that writes how long the setup, the call and the teardown of each test took."""

from __future__ import annotations

import json
from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--durations-file", type=Path, help="write lines of JSON into this file")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):  # the workers' reports reach the main process
        config.pluginmanager.register(_Writer(config.getoption("--durations-file")))


class _Writer:
    def __init__(self, path: Path) -> None:
        self.path = path

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        one = {
            "test": report.nodeid.partition("@")[0],  # what follows is a group of xdist's
            "when": report.when,
            "outcome": report.outcome,
            "seconds": round(report.duration, 3),
        }
        with self.path.open("a", encoding="utf-8") as out:
            out.write(json.dumps(one) + "\n")
