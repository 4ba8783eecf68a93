"""Parameters over the inertia as torques: both forms of each law give the same torque in newton metres."""

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.effects.types import catalogue
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.plant.units import torque_of

J = 0.02
W, THETA, COMMAND = 3.7, -1.3, 5.0  # deg/s, deg, command
LAWS = {  # torque of a coefficient in consistent units of angle
    ("rigid_body", "gain"): lambda c, w, theta: c * COMMAND,
    ("viscous_friction", "rate"): lambda c, w, theta: c * w,
    ("coulomb_friction", "level"): lambda c, w, theta: c,
    ("stribeck_friction", "level"): lambda c, w, theta: c,
    ("stribeck_friction", "extra"): lambda c, w, theta: c,
    ("presliding_friction", "level"): lambda c, w, theta: c,
    ("bouc_wen", "stiffness"): lambda c, w, theta: c * theta,
    ("quadratic_drag", "rate"): lambda c, w, theta: c * w * abs(w),
    ("cable_spring", "stiffness"): lambda c, w, theta: c * theta,
    ("quadratic_spring", "stiffness"): lambda c, w, theta: c * theta**2,
    ("cubic_spring", "stiffness"): lambda c, w, theta: c * theta**3,
    ("mass_unbalance", "level"): lambda c, w, theta: c,
    ("motor_cogging", "level"): lambda c, w, theta: c,
    ("hard_stop", "stiffness"): lambda c, w, theta: c * theta,
    ("gear_backlash", "stiffness"): lambda c, w, theta: c * theta,
    ("gear_backlash", "damping"): lambda c, w, theta: c * w,
    ("torque_bias", "level"): lambda c, w, theta: c,
}


@pytest.mark.parametrize("angle_unit", ["deg", "rad"])
@pytest.mark.parametrize("law", LAWS, ids=".".join)
def test_a_torque_is_the_same_in_both_forms(law, angle_unit):
    """In the unit of the model over the inertia, times the inertia; and in newton metres and radians."""
    radians = np.pi / 180 if angle_unit == "deg" else 1.0
    over_inertia = LAWS[law](2.5, W, THETA)
    value, unit = torque_of(*law, 2.5, J, angle_unit)
    assert unit.startswith("N m")
    assert LAWS[law](value, W * radians, THETA * radians) == pytest.approx(
        over_inertia * radians * J, rel=1e-12
    )


def test_every_parameter_of_the_catalogue_is_judged():
    """Those that are not in the table are no torques."""
    no_torque = {
        ("stribeck_friction", "velocity"),
        ("presliding_friction", "stiffness"),
        ("bouc_wen", "unloading"),
        ("bouc_wen", "loading"),
        ("mass_unbalance", "angle_deg"),
        ("motor_cogging", "cycles_per_rev"),
        ("motor_cogging", "phase_rad"),
        ("hard_stop", "angle_deg"),
        ("gear_backlash", "gap_deg"),
        ("gear_backlash", "inertia_ratio"),
    }
    for effect in catalogue().values():
        for name in (parameter.name for parameter in effect.parameters):
            found = torque_of(effect.id, name, 1.0, J)
            expected = effect.stage == "torque" and (effect.id, name) not in no_torque
            assert (found is not None) == expected, (effect.id, name)


def plant(**more):
    effects = [
        Effect("rigid_body", {"gain": Param(7.4)}),
        Effect("cable_spring", {"stiffness": Param(170.0)}),
    ]
    return PlantModel(3000.0, effects, **more)


def test_a_model_prints_torques_and_keeps_its_inertia(tmp_path):
    model = plant(inertia_kg_m2=J, u_unit="V")
    gain = 7.4 * np.pi / 180 * J
    assert f"{gain:.5g} N m per V" in repr(model)
    assert f"{170.0 * J:.5g} N m/rad" in model._repr_html_()
    model.save(tmp_path / "m.json")
    assert PlantModel.load(tmp_path / "m.json").inertia_kg_m2 == J
    assert "N m" not in repr(plant())


@pytest.mark.parametrize("inertia", [0.0, -1.0, np.inf, "1", True])
def test_an_inertia_that_is_none_is_refused(inertia):
    with pytest.raises(InputError, match="inertia_kg_m2"):
        plant(inertia_kg_m2=inertia)
    with pytest.raises(InputError, match="belongs to an angle"):
        plant(inertia_kg_m2=1.0, angle_unit="m")
