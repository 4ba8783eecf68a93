"""Starting values of an added effect: close to the truth before any fit by simulation."""

import numpy as np
import pytest
from plants import FS_HZ, axis_record, plant

from gsid.diagnosis.effect_starts import effect_starts, fixed_parameters
from gsid.diagnosis.held_sensor_rates import likely_rates
from gsid.effects.types import catalogue, find
from gsid.excitation.multisine import Multisine
from gsid.greybox.fit import fit_plant
from gsid.spectrum.realisation import spectra

SEED = 20261122
N, BAND, NOISE = 1500, (2.0, 100.0), 0.02
AXIS = {"gain": 7.4, "viscous_rate": 11.0, "spring_stiffness": 170.0, "delay_s": 0.0054}
STACK = {
    "rigid_body": {"gain": 7.7},
    "viscous_friction": {"rate": 10.5},
    "cable_spring": {"stiffness": 175.0},
    "transport_delay": {"delay_s": 0.0052},
}


def realisation(band=BAND, **hidden):
    print("seed", SEED)
    multisine = Multisine.design(FS_HZ, N, band, phases="random", seed=SEED, amplitude=3.0)
    return spectra(axis_record(multisine.table(), 6, NOISE, SEED, "r", **AXIS | hidden))


def fitted(measured, without=()):
    stack = {effect: params for effect, params in STACK.items() if effect not in without}
    return fit_plant(plant(stack), measured)


@pytest.fixture(scope="module")
def rough():
    """An axis with dry friction and a quadratic drag."""
    return realisation(coulomb_level=2.0, drag_rate=1.0)


@pytest.mark.parametrize(
    ("hidden", "effect", "true", "within"),
    [
        ({"coulomb_level": 2.0}, "coulomb_friction", {"level": 2.0}, 0.1),
        ({}, "cable_spring", {"stiffness": 170.0}, 0.05),
        ({}, "transport_delay", {"delay_s": 0.0054}, 0.05),
        ({}, "viscous_friction", {"rate": 11.0}, 0.05),
    ],
)
def test_the_first_start_is_close_to_the_truth(hidden, effect, true, within):
    fit = fitted(realisation(**hidden), without={effect})
    start = effect_starts(fit, find(effect))[0]
    for name, value in true.items():
        assert start[f"{effect}.{name}"].value == pytest.approx(value, rel=within)
    assert start["rigid_body.gain"].value == pytest.approx(7.4, rel=0.02)
    assert fit.cost_of(start) < 0.1 * fit.cost


def test_a_law_of_the_model_stays_as_it_is(rough):
    """A drag beside a friction that the model has: the friction's part of the output is left out."""
    fit = fit_plant(plant(STACK | {"coulomb_friction": {"level": 1.0}}), rough)
    start = effect_starts(fit, find("quadratic_drag"))[0]
    assert start["coulomb_friction.level"].value == fit.model["coulomb_friction.level"].value
    assert fit.cost_of(start) < fit.cost
    found = fit_plant(start, rough).model
    assert found["quadratic_drag.rate"].value == pytest.approx(1.0, rel=0.1)
    assert found["coulomb_friction.level"].value == pytest.approx(2.0, rel=0.1)


def test_parameters_that_are_fixed_stay_fixed():
    measured = realisation(coulomb_level=2.0)
    model = plant(STACK)
    model["transport_delay.delay_s"].free = False
    for start in effect_starts(fit_plant(model, measured), find("coulomb_friction")):
        assert start["transport_delay.delay_s"].value == 0.0052
        assert not start["transport_delay.delay_s"].free


def test_a_lag_takes_its_time_from_the_delay():
    fit = fitted(realisation())
    start = effect_starts(fit, find("motor_lag"))[0]
    lag_s, delay_s = start["motor_lag.time_constant_s"].value, start["transport_delay.delay_s"].value
    assert lag_s + delay_s == pytest.approx(0.0054, abs=2e-4)


@pytest.mark.parametrize("rate_hz", [750.0, 120.0])
def test_the_rate_of_a_held_sensor_is_exact(rate_hz):
    """750 Hz shows its images above the excitation, 120 Hz among it."""
    fit = fitted(realisation(band=(3.0, 180.0), gyro_refresh_hz=rate_hz))
    rates = likely_rates(fit, find("sensor_sample_hold")["rate_hz"].grid)
    assert rates[0] == pytest.approx(rate_hz, rel=1e-9)


def test_only_parameters_without_a_derivative_are_held():
    held = {effect.id: fixed_parameters(effect) for effect in catalogue().values()}
    assert {effect: names for effect, names in held.items() if names} == {
        "drive_quantization": ("step",),
        "sensor_sample_hold": ("rate_hz",),
    }


def test_every_effect_of_the_catalogue_has_a_start(rough):
    """Also those that are not in the data: none fails, and none starts outside its bounds."""
    fit = fitted(rough)
    for effect in catalogue().values():
        if effect.null_kind == "never" or any(each.id == effect.id for each in fit.model.effects):
            continue
        for start in effect_starts(fit, effect):
            added = start.effects[-1]
            assert added.id == effect.id
            for p in effect.parameters:
                assert p.lower <= added.params[p.name].value <= p.upper
            assert np.isfinite(fit.cost_of(start)), effect.id
