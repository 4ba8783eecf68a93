"""What the firmware may cost: the figures of the design, on both processors."""

from __future__ import annotations

import json
import subprocess

import pytest
from emulator import ROOT

CPUS = ("m7", "m4")


@pytest.fixture(scope="module")
def budget() -> dict:
    """What docs/budget.md is made of."""
    command = [ROOT / ".venv/bin/python", ROOT / "tools/firmware_budget", "--json"]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)


@pytest.mark.parametrize("cpu", CPUS)
def test_code(budget, cpu):
    """The core's alone; the C library's is under it even with the fit."""
    assert budget["code"]["multisine and streaming FRF, spread engine"][cpu][0] <= 6 * 1024
    assert sum(budget["code"]["the last, and a fit with delay by IWLS"][cpu]) <= 16 * 1024


@pytest.mark.parametrize("cpu", CPUS)
def test_stack(budget, cpu):
    assert budget["stack"]["the example, all at once, outside the fit"][cpu][0] <= 1024


@pytest.mark.parametrize("cpu", CPUS)
def test_one_line_alone(budget, cpu):
    """Excitation and response, the tick in which the period ends included."""
    assert budget["instructions"]["stepped sine"][cpu][2] <= 110


@pytest.mark.parametrize("cpu", CPUS)
@pytest.mark.parametrize("case", ["spread 1", "spread 50", "spread 500", "spread 500, input measured"])
def test_spread_engine(budget, cpu, case):
    _, median, most = budget["instructions"][case][cpu]
    assert most <= 300
    assert most <= 1.2 * median
