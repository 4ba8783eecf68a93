"""The shape of a law is refined beside the refitted linear part."""

import numpy as np
import pytest

import gsid
from gsid.diagnosis.missing_torque import refit
from gsid.diagnosis.missing_torque.kept_out import keep_out
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.plant.effect import Effect, Param

FS_HZ, PERIOD, SEED = 1000.0, 2000, 5


def axis(gain, **laws):
    """All linear values are in proportion to the gain."""
    stack = {
        "rigid_body": {"gain": gain},
        "viscous_friction": {"rate": 8.0 * gain / 60},
        "cable_spring": {"stiffness": 900.0 * gain / 60},
        **laws,
    }
    effects = [
        Effect(id, {name: Param(value) for name, value in values.items()}) for id, values in stack.items()
    ]
    return gsid.PlantModel(FS_HZ, effects, "angle")


def records_of(law, values):
    """Two levels, with a noise of a thousandth of the output."""
    rng = np.random.default_rng(SEED)
    turn = 2 * np.pi * np.arange(PERIOD) / PERIOD
    u = 8 * sum(np.cos(line * turn + rng.uniform(0, 2 * np.pi)) for line in range(1, 120, 2))
    plant, found = axis(60.0, **{law: values}), []
    for amplitude in (1.0, 0.7):
        y = np.tile(plant.simulate(amplitude * u).y, 6)
        y += 1e-3 * np.std(y) * rng.standard_normal(len(y))
        found.append(gsid.Record(np.tile(amplitude * u, 6), y, FS_HZ, PERIOD, 0, hold="zoh"))
    return found


@pytest.mark.parametrize(
    ("law", "values", "with_first_shape"),
    [
        ("motor_cogging", {"level": 500.0, "cycles_per_rev": 217.0, "phase_rad": 0.7}, 2.94),
        ("stribeck_friction", {"level": 20.0, "extra": 20.0, "velocity": 23.0}, 2.16),
        ("presliding_friction", {"level": 60.0, "stiffness": 11.0}, 1.60),
    ],
)
def test_the_shape_is_refined_beside_the_refitted_linear_part(law, values, with_first_shape):
    """From a gain two thirds too large; `with_first_shape` is the cost with the shape of the scan."""
    best = first_stage(records_of(law, values), axis(100.0)).ranking[0]
    print("seed", SEED, law, best.cost_per_dof)
    assert best.effects == (law,)
    assert best.cost_per_dof < 0.8 * with_first_shape


@pytest.mark.parametrize(
    ("law", "values", "n_coefficients"),
    [
        ("presliding_friction", {"level": 60.0, "stiffness": 11.0}, 1),
        ("coulomb_friction", {"level": 60.0}, 1),
    ],
)
def test_the_scatter_of_a_strength_includes_that_of_the_shape(monkeypatch, law, values, n_coefficients):
    """What is kept out moves the shape too: its derivative, by finite differences, is a column of its own."""
    jacobians = {}

    def kept_out(problem, fit, jacobian, *rest):
        jacobians[fit.cost] = jacobian
        return keep_out(problem, fit, jacobian, *rest)

    monkeypatch.setattr(refit, "keep_out", kept_out)
    best = first_stage(records_of(law, values), axis(100.0)).ranking[0]
    assert best.effects == (law,)
    n_shapes = len(values) - n_coefficients
    jacobian = jacobians[min(jacobians)]  # of the best law
    assert jacobian.shape[1] == len(axis(60.0).free_names) + n_coefficients + n_shapes
    assert np.all(np.linalg.norm(jacobian, axis=0) > 0)
