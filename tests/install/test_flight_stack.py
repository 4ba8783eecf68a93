"""The application for NASA's core Flight System, on a stand-in for its software bus."""

import re

import pytest
from projects import ROOT, cmake_project, require, run

pytestmark = pytest.mark.xdist_group("installed")


def test_the_cfs_application_measures_an_axis_on_the_bus(tmp_path):
    """A lost block, a message of another size and a NaN spoil the periods that they are in, and no other."""
    require("cmake")
    cmake_project("cfs_mission", tmp_path, f"-DGSID_CLONE={ROOT}")
    printed = run(tmp_path / "mission").stdout
    assert "GSID: measuring 50 lines" in printed
    assert re.search(r"message 0x18f0 of \d+ bytes refused", printed)
    assert printed.count("GSID: 1 blocks lost") == 2  # the lost one, and the refused one
    found = re.search(
        r"status 1, \d+ messages, 1 responses, (\d+) periods, (\d+) spoiled, worst error (.*) sigma", printed
    )
    assert found, printed
    assert (int(found[1]), int(found[2])) == (8, 3)
    # One of 50 lines of 8 periods, 7 complex degrees of freedom, is beyond 5 sigma in 1.2e-3 of the runs.
    assert float(found[3]) < 5
