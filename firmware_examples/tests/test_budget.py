"""Limits of code size, stack and instructions of the firmware, on both processors."""

from __future__ import annotations

import json
import subprocess

import pytest
from emulator import ROOT

CPUS = ("m7", "m4")


@pytest.fixture(scope="module")
def budget() -> dict:
    """The figures of docs/reference/budget.md."""
    command = [ROOT / ".venv/bin/python", ROOT / "tools/firmware_budget", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        pytest.fail(done.stderr, pytrace=False)
    return json.loads(done.stdout)


@pytest.fixture
def instructions(budget) -> dict:
    """Counts of the emulator. The tests of code and stack do not need them."""
    if budget["uncounted"]:
        pytest.skip(budget["uncounted"])
    return budget["instructions"]


@pytest.mark.parametrize("cpu", CPUS)
def test_code(budget, cpu):
    """6 KiB for the core alone, the C library's 3.5 KiB not counted; 16 KiB with the fit for both."""
    assert budget["code"]["multisine and streaming FRF, spread engine"][cpu][0] <= 6 * 1024
    assert sum(budget["code"]["the last, and a fit with delay by IWLS"][cpu]) <= 16 * 1024


@pytest.mark.parametrize("cpu", CPUS)
def test_stack(budget, cpu):
    assert budget["stack"]["the example, all at once, outside the fit"][cpu][0] <= 1024


@pytest.mark.parametrize("cpu", CPUS)
def test_one_line_alone(instructions, cpu):
    """Excitation and response, including the tick in which the period ends."""
    assert instructions["stepped sine"][cpu][2] <= 110


@pytest.mark.parametrize("cpu", CPUS)
@pytest.mark.parametrize("case", ["spread 1", "spread 50", "spread 500", "spread 500, input measured"])
def test_spread_engine(instructions, cpu, case):
    _, median, most = instructions[case][cpu]
    assert most <= 300
    assert most <= 1.2 * median


@pytest.mark.parametrize("cpu", CPUS)
def test_a_linear_plant_always_costs_the_same(instructions, cpu):
    least, _, most = instructions["plant of four linear effects"][cpu]
    assert least == most <= 2200
