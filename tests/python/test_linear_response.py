"""Frequency responses of the linear part of a plant."""

import numpy as np
import pytest

from gsid.plant.linear_response import linear_view

MODE = {"rigid_body": {"gain": 2.0}, "flexible_mode": {"f_hz": 179.0, "zeta": 0.0, "residue": 1.0}}
SPRING = {"rigid_body": {"gain": 2.0}, "cable_spring": {"stiffness": (2 * np.pi * 179.0) ** 2}}


@pytest.mark.parametrize("stack", [MODE, SPRING], ids=["mode", "spring"])
@pytest.mark.filterwarnings("error")
def test_an_undamped_resonance_on_a_line_is_large_but_finite(stack):
    """A bug: on the line of the resonance the response was NaN, with a warning of a division by zero."""
    command = np.abs(linear_view(stack, np.array([170.0, 179.0, 190.0]), 3000.0).command)
    assert np.all(np.isfinite(command))
    assert command[1] > 1e3 * max(command[0], command[2])
