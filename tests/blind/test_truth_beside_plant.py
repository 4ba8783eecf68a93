"""The product's plant against the truth simulator: two integrators that share nothing, effect by effect.

They may differ by what cannot be seen: in a record of 8 periods with the least noise of the trials
(0.03 deg/s), a difference of rms d adds P N (d / 0.03)^2 to the cost in chi-square units; 0.1 of that is
d = 4e-5 deg/s, beside an answer of about 12 deg/s rms.
"""

import json

import numpy as np
import pytest
import trials
import truth

UNSEEN = 4e-5  # deg/s rms

STICKING = {"coulomb_level": 60.0}
EFFECTS = {
    "nothing": {},
    "motor_lag": {"motor_lag_s": 0.002},
    "drive_quantization": {"quantization_step": 0.5},
    "drive_dead_zone": {"dead_zone_half_width": 0.5},
    "drive_saturation": {"saturation_limit": 40.0},
    "coulomb_friction": {"coulomb_level": 3.0},
    "coulomb_friction that sticks": STICKING,
    "stribeck_friction": {"coulomb_level": 3.0, "stribeck_extra": 2.0, "stribeck_velocity": 1.0},
    "presliding_friction": {"presliding_level": 3.0, "presliding_stiffness": 40.0},
    "quadratic_drag": {"quadratic_drag_rate": 0.02},
    "cubic_spring": {"cubic_stiffness": 1.0},
    "mass_unbalance": {"unbalance_level": 300.0, "unbalance_angle_deg": 30.0},
    "motor_cogging": {"cogging_level": 4.0, "cogging_cycles": 72.0, "cogging_phase_rad": 0.5},
    "hard_stop": {"stop_angle_deg": 2.0, "stop_stiffness": 500.0},
    "torque_bias": {"bias_level": 20.0, "cubic_stiffness": 1.0},  # alone it does not show in the rate
    "gear_backlash": {
        "gear_gap_deg": 0.003,
        "gear_stiffness": 7e5,
        "gear_inertia_ratio": 0.3,
        "gear_damping": 80.0,
    },
    "sensor_sample_hold": {"sample_hold_hz": 400.0},
}


def product_model(place, effects, params):
    """The same axis as a model file of the product, loaded."""
    from gsid.models.load import load_model

    if "gear_backlash" in effects:
        # The product's unit of inertia is the load, the truth's motor and load together.
        total = 1 + params["gear_inertia_ratio"]
        scaled = ("gain", "viscous_rate", "spring_stiffness", "gear_stiffness", "gear_damping")
        params = params | {name: params[name] * total for name in scaled}
        params["mode_residue"] /= total
    names = {**trials.CATALOGUE, "torque_bias": {"level": "bias_level"}}
    stack = [
        {"effect": effect, "params": {n: params[p] for n, p in names[effect].items() if p in params}}
        for effect in effects
    ]
    path = place / "model.json"
    path.write_text(json.dumps({"gsid_model": 1, "fs_hz": 3000, "output": "rate", "effects": stack}))
    return load_model(path)


@pytest.mark.parametrize("case", EFFECTS)
def test_plant_answers_as_the_truth(case, tmp_path):
    rng = np.random.default_rng(5)
    base = trials.draw_base(rng, None)
    u = trials.draw_commands(rng, base, 1)[1][1]
    params = base | EFFECTS[case]
    hidden = [] if case == "nothing" else [case.split()[0]]
    if case == "torque_bias":
        hidden.append("cubic_spring")
    # An axis with stops can have two periodic answers; the one that grows out of the linear one is meant.
    linear = truth.steady(base, u, tolerance=1e-6)[-1]
    expected = truth.steady(params, u, tolerance=1e-6, start=linear)[0]
    model = product_model(tmp_path, [*trials.BASE, *hidden], params)
    answer = model.simulate(u).y
    assert np.sqrt(np.mean((answer - expected) ** 2)) < UNSEEN
