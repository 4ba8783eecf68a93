"""Values of a model moved on the page, against the verb that predicts the output of a saved model."""

import base64

import numpy as np
import pytest

import gsid
from gsid.base.errors import InputError
from gsid.effects.types import catalogue
from gsid.excitation.multisine import Multisine
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.spectrum.spectra import read_as
from gsid.webpage.bench import Bench, numbers_of, picture_of, sheet_of, slider_range

FS, N, SEED = 3000.0, 1500, 20261123


def params(**values):
    return {name: Param(value) for name, value in values.items()}


@pytest.fixture(scope="module")
def model():
    effects = [
        Effect("rigid_body", params(gain=7.4)),
        Effect("viscous_friction", params(rate=11.0)),
        Effect("coulomb_friction", params(level=15.0)),
        Effect("transport_delay", params(delay_s=0.005)),
    ]
    return PlantModel(FS, effects, y_unit="deg/s")


@pytest.fixture(scope="module", params=["zoh", None])
def record(request, model):
    print("seed", SEED)
    u = Multisine.design(FS, N, (2, 250), rms=20.0, phases="random", seed=SEED).table()
    y = np.tile(model.simulate(u).y, 4)
    noise = np.random.default_rng(SEED).normal(0, 0.01 * np.std(y), len(y))
    return Record(np.tile(u, 4), y + noise, FS, N, 0, hold=request.param, y_unit="deg/s", name="rec")


def predicted(model, record, hold=None):
    """The prediction; where the record states no hold, under that of the model that was not moved."""
    measured = [gsid.spectra(record)]
    return gsid.predict(model, read_as(measured, hold) if hold else measured)[0]


def test_the_values_of_the_model_give_its_prediction(model, record):
    bench = Bench(model, record)
    found = bench.simulated({}, [])
    assert found.fit_percent == pytest.approx(predicted(model, record).fit_percent, abs=1e-6)


def test_a_moved_value_gives_the_prediction_of_a_model_that_has_it(model, record):
    bench = Bench(model, record)
    for level in (2.0, 40.0, 15.0):
        moved = model.with_values([7.4, 11.0, level, 0.005])
        found = bench.simulated({"coulomb_friction.level": level}, [])
        assert found.rms_error == pytest.approx(predicted(moved, record, found.hold).rms_error, rel=1e-6)


def between_stops(angle_deg):
    effects = [
        Effect("rigid_body", params(gain=7.4)),
        Effect("viscous_friction", params(rate=1.0)),
        Effect("cable_spring", params(stiffness=170.0)),
        Effect("hard_stop", params(angle_deg=angle_deg, stiffness=3000.0)),
    ]
    return PlantModel(FS, effects, y_unit="deg/s")


def test_bug_a_stop_that_was_moved_away_left_the_axis_on_another_orbit():
    """Driven above its resonance, an axis between stops has a second orbit, on which it strikes them."""
    u = 20 * np.sin(2 * np.pi * np.arange(1000) / 1000)
    free = between_stops(1e3).simulate(u).y
    swing_deg = np.ptp(np.cumsum(free - np.mean(free))) / FS / 2
    noise = np.random.default_rng(SEED).normal(0, 0.01 * np.std(free), 4000)
    record = Record(np.tile(u, 4), np.tile(free, 4) + noise, FS, 1000, 0, hold="zoh", y_unit="deg/s")
    bench = Bench(between_stops(0.7 * swing_deg), record)
    assert bench.fitted.fit_percent < 0
    found = bench.simulated({"hard_stop.angle_deg": 1.1 * swing_deg}, [])
    assert found.rms_error == predicted(between_stops(1.1 * swing_deg), record).rms_error
    np.testing.assert_allclose(found.y_model, free, atol=0.01 * np.std(free))  # it strikes no stop


def test_an_output_that_does_not_settle_is_not_shown_as_a_steady_state():
    """Stops that are struck hard give an output that never repeats."""
    u = Multisine.design(FS, 3000, (1, 60), rms=20.0, phases="random", seed=1).table()
    y = np.random.default_rng(SEED).normal(0, 10.0, 12000)
    record = Record(np.tile(u, 4), y, FS, 3000, 0, hold="zoh", y_unit="deg/s")
    one = Bench(between_stops(1e3), record).simulated(
        {"hard_stop.angle_deg": 1.0, "hard_stop.stiffness": 1e5, "cable_spring.stiffness": 20.0}, []
    )
    assert numbers_of(one)["unsettled"] > 1e-3 * one.rms_output
    still = Bench(between_stops(1e3), record).simulated({}, [])
    assert numbers_of(still)["unsettled"] == 0


def test_an_effect_that_is_out_gives_the_prediction_of_a_model_without_it(model, record):
    bench = Bench(model, record)
    found = bench.simulated({"viscous_friction.rate": 5.0}, ["coulomb_friction"])
    part = model.without_effect("coulomb_friction").with_values([7.4, 5.0, 0.005])
    assert found.rms_error == pytest.approx(predicted(part, record, found.hold).rms_error, rel=1e-6)


@pytest.mark.parametrize(
    ("values", "out", "words"),
    [
        ({"coulomb_friction.level": -1}, [], "out of its range"),
        ({"coulomb_friction.level": float("nan")}, [], "out of its range"),
        ({"coulomb_friction.level": True}, [], "out of its range"),
        ({"coulomb_friction.level": "1"}, [], "out of its range"),
        ({"coulomb_friction.size": 1.0}, [], "no such parameter"),
        ({}, ["rigid_body"], "cannot be left out"),
        ({}, ["hard_stop"], "no such effect"),
        ({"transport_delay.delay_s": 9.0}, [], "cannot be simulated"),
        ({"rigid_body.gain": 1e9}, ["viscous_friction", "coulomb_friction"], None),
    ],
)
def test_what_cannot_be_simulated_is_an_error_in_words(model, record, values, out, words):
    bench = Bench(model, record)
    if words is None:
        assert np.all(np.isfinite(bench.simulated(values, out).y_model))
        return
    with pytest.raises(InputError, match=words):
        bench.simulated(values, out)
    assert bench.simulated({}, []).fit_percent > 90


def test_an_unstable_model_is_an_error_in_words(model, record):
    weak = model.with_effect("cubic_spring", {"stiffness": 0.0})
    with pytest.raises(InputError, match="unstable"):
        Bench(weak, record).simulated({"cubic_spring.stiffness": -1e8}, [])


def test_the_picture_has_the_extremes_of_a_long_signal_and_every_sample_of_a_part(model, record):
    one = Bench(model, record).simulated({}, [])
    whole = picture_of(one, 300)
    assert all(len(unpacked(drawn["x"])) <= 420 for drawn in whole.values())
    assert max(unpacked(whole["model"]["y"])) == pytest.approx(np.max(one.y_model), rel=1e-4)
    part = picture_of(one, 300, (0.1, 0.15), with_measured=False)
    assert list(part) == ["model", "difference"]
    assert len(unpacked(part["model"]["x"])) == pytest.approx(0.05 * FS, abs=3)
    assert unpacked(part["model"]["x"])[0] == pytest.approx(0.1, abs=1 / FS)


def unpacked(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_a_small_move_costs_fewer_steps_than_a_search_and_a_large_one_has_the_same_output(model, record):
    bench, plain = Bench(model, record), Bench(model, record)
    _, near = bench._plant(frozenset())
    _, cold = plain._plant(frozenset())
    cold._kept = None
    for values in ([7.5, 11.0, 15.0, 0.005], [70.0, 1.0, 200.0, 0.0005], [7.4, 0.0, 0.0, 0.005]):
        near.bound(np.inf), cold.bound(np.inf)
        found, wanted = near.run_near(values), cold.run(values)
        shift = np.mean(found.y - wanted.y)  # the mean of a body without friction is arbitrary
        np.testing.assert_allclose(found.y - shift, wanted.y, atol=1e-6 * np.std(wanted.y))
        if values[0] == 7.5:
            assert near.moves < 0.8 * cold.moves


def test_the_sheet_has_a_unit_or_1_and_a_range_around_each_value(model):
    for effect in sheet_of(model):
        for known in effect["parameters"]:
            assert known["low"] <= known["value"] <= known["high"], known
            assert isinstance(known["unit"], str)


@pytest.mark.parametrize("effect", catalogue().values(), ids=catalogue())
def test_each_slider_of_the_catalogue_is_finite_and_inside_the_descriptors_range(effect):
    for known in effect.parameters:
        low, high, is_log = slider_range(known, known.typical)
        assert known.lower <= low < high <= known.upper
        assert high - low <= 1e5 * max(abs(known.typical), 1)
        assert low > 0 or not is_log


def test_numbers_are_plain_for_json(model, record):
    assert all(
        value is None or isinstance(value, (float, str))
        for value in numbers_of(predicted(model, record)).values()
    )
