"""Decisions of the diagnosis from records between the fits: each from both sides of its limit."""

from gsid.diagnosis.from_records.draft import with_stack
from gsid.plant.model import PlantModel

STACK = {"rigid_body": {"gain": 10.0}, "viscous_friction": {"rate": 3.0}}


def model(stack):
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": 1000.0, "output": "rate", "effects": effects})


def test_bug_the_rate_of_a_held_sensor_moved_off_its_images():
    """The fit moved it from 2000 to 2028 Hz, where the simulation refuses it: a null was rejected."""
    larger = with_stack(
        model(STACK),
        STACK | {"sensor_sample_hold": {"rate_hz": 400.0}, "sensor_lag": {"time_constant_s": 1e-3}},
    )
    free = larger.free_names
    assert "sensor_sample_hold.rate_hz" not in free
    assert "sensor_lag.time_constant_s" in free
    assert "rigid_body.gain" in free
