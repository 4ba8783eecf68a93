"""The simulated axis of a model, against the simulation of that model; and that of another axis."""

import json

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.rig.axis import SimulatedAxis
from gsid.rig.axis_file import axis_parameters

FS, N = 3000.0, 3000
QUIET = {"noise_rms": 0.0, "noise_low_rms": 0.0, "fan_amplitude": 0.0}
LINEAR = {
    "transport_delay": {"delay_s": 0.0031},
    "rigid_body": {"gain": 5.5},
    "viscous_friction": {"rate": 20.0},
    "cable_spring": {"stiffness": 90.0},
    "flexible_mode": {"f_hz": 120.0, "zeta": 0.03, "residue": 0.2},
    "sensor_lag": {"time_constant_s": 0.002},
}


def saved(path, values, **more):
    effects = [
        Effect(effect, {name: Param(value) for name, value in params.items()})
        for effect, params in values.items()
    ]
    model = PlantModel(FS, effects, **{"y_unit": "deg/s"} | more)
    model.save(path)
    return model


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"coulomb_friction": {"level": 8.0}},
        {"drive_dead_zone": {"half_width": 2.0}, "cubic_spring": {"stiffness": 5.0}},
        {"sensor_sample_hold": {"rate_hz": 500.0}},
    ],
    ids=lambda more: " ".join(more) or "linear",
)
def test_the_axis_moves_as_its_model(tmp_path, more):
    model = saved(tmp_path / "m.json", LINEAR | more)
    u = Multisine.design(FS, N, (2, 250), rms=20.0, phases="random", seed=20261123).table()
    axis = SimulatedAxis(**axis_parameters(tmp_path / "m.json") | QUIET)
    _, y, _ = axis.step(np.tile(u, 6))
    wanted = model.simulate(u).y
    assert np.sqrt(np.mean((y[-N:] - wanted) ** 2)) < 5e-3 * np.std(wanted)


def test_the_parameters_that_an_axis_wrote_are_read_again(tmp_path):
    axis = SimulatedAxis(coulomb_level=2.5, gyro_lag_s=0.002, command_bits=10, seed=7)
    (tmp_path / "truth.json").write_text(json.dumps(axis.truth()))
    assert SimulatedAxis(**axis_parameters(tmp_path / "truth.json")).parameters == axis.parameters


@pytest.mark.parametrize(
    ("values", "more", "words"),
    [
        (LINEAR | {"bouc_wen": {}}, {}, "does not have this effect"),
        (LINEAR | {"motor_lag": {"time_constant_s": 0.001}}, {}, "does not have this effect"),
        ({"rigid_body": {"gain": 5.0}}, {"y_unit": "deg", "output": "angle"}, "a rate in deg/s"),
    ],
)
def test_what_the_axis_cannot_have_is_refused(tmp_path, values, more, words):
    if "bouc_wen" in values:
        from gsid.effects.types import catalogue

        values["bouc_wen"] = {one.name: one.typical for one in catalogue()["bouc_wen"].parameters}
    saved(tmp_path / "m.json", values, **more)
    with pytest.raises(InputError, match=words):
        axis_parameters(tmp_path / "m.json")


@pytest.mark.parametrize("parameters", [{"gain": "7"}, {"speed": 1.0}, {"gain": True}])
def test_a_file_with_other_parameters_is_refused(tmp_path, parameters):
    (tmp_path / "a.json").write_text(json.dumps({"parameters": parameters}))
    with pytest.raises(InputError, match="not a parameter of the simulated axis"):
        axis_parameters(tmp_path / "a.json")
