"""Records that do not state whether their input was held: both readings are fitted."""

import dataclasses

import numpy as np
import pytest
from plants import axis_record, plant

from gsid import Record, read_record
from gsid.comparison import compare
from gsid.diagnosis.add import add
from gsid.diagnosis.from_records.diagnose import diagnose
from gsid.excitation.multisine import Multisine
from gsid.fitting.piecewise import fit_piecewise
from gsid.fitting.rational import fit
from gsid.greybox.fit import fit_plant
from gsid.models.load import load_model
from gsid.models.rational import RationalModel
from gsid.records.files import write_record
from gsid.response.estimate import frf
from gsid.response.frf import Frf

SEED = 20261122
FS_HZ = 3000.0
SHORT = 1500  # samples in a period, for fits by simulation


def response(truth: RationalModel, rng, f_hz, noise=1e-4) -> Frf:
    """A response with circular noise of a known size, of a record that does not state its hold."""
    g = truth.response(f_hz)
    sigma = noise * np.max(np.abs(g)) * np.ones(len(g))
    error = sigma * (rng.standard_normal(len(g)) + 1j * rng.standard_normal(len(g))) / np.sqrt(2)
    return dataclasses.replace(Frf.from_arrays(f_hz, g + error, sigma**2, fs_hz=FS_HZ), hold=None)


def axis(hold: str) -> RationalModel:
    return RationalModel([40.0, 900.0], [1.0, 30.0, 2000.0], 2e-3, fs_hz=FS_HZ, hold=hold)


@pytest.mark.parametrize("hold", [None, "zoh", "none"])
@pytest.mark.parametrize("ending", ["csv", "npz", "mat", "h5"])
def test_bug_a_file_that_does_not_state_its_hold_was_read_as_not_held(tmp_path, ending, hold):
    u = np.tile(np.random.default_rng(SEED).standard_normal(100), 4)
    write_record(tmp_path / f"r.{ending}", Record(u, u, FS_HZ, 100, 0, hold=hold))
    assert read_record(tmp_path / f"r.{ending}").hold == hold
    for stated in ("zoh", "none"):
        assert read_record(tmp_path / f"r.{ending}", hold=stated).hold == stated


@pytest.mark.parametrize("truth", ["zoh", "none"])
def test_above_a_tenth_of_the_rate_the_data_determine_the_hold(truth):
    """Bug: a held command of a silent record got half a sample too much delay, and a wrong shape."""
    f_hz = np.arange(1, 300) * 2.0  # to 0.2 of the rate
    model = fit(response(axis(truth), np.random.default_rng(SEED), f_hz), "2/1")
    assert (model.hold, model.hold_assumed) == (truth, True)
    assert model.cost == pytest.approx(model.cost_expected, rel=0.2)
    assert model.delay_s == pytest.approx(2e-3, abs=3 * model.std_delay_s)
    assert model.delay_hold_uncertainty_s == pytest.approx(0.5 / FS_HZ, rel=0.5)


@pytest.mark.parametrize("truth", ["zoh", "none"])
def test_far_below_the_rate_the_fit_takes_none_and_names_the_other_delay(truth):
    f_hz = np.arange(1, 50) * 1.0
    model = fit(response(axis(truth), np.random.default_rng(SEED), f_hz, noise=1e-2), "2/1")
    assert (model.hold, model.hold_assumed) == ("none", True)
    assert model.other_delay_s == pytest.approx(model.delay_s - 0.5 / FS_HZ, abs=1e-5)
    stated = fit(response(axis(truth), np.random.default_rng(SEED), f_hz, noise=1e-2), "2/1", hold="zoh")
    assert stated.delay_s == model.other_delay_s
    assert not stated.hold_assumed
    assert stated.delay_hold_uncertainty_s is None


def test_the_model_file_keeps_that_the_hold_was_assumed(tmp_path):
    f_hz = np.arange(1, 50) * 1.0
    model = fit(response(axis("zoh"), np.random.default_rng(SEED), f_hz), "2/1")
    model.save(tmp_path / "m.json")
    again = RationalModel.load(tmp_path / "m.json")
    assert again.hold_assumed
    assert again.other_delay_s == model.other_delay_s


def test_an_order_that_a_held_input_cannot_have_is_fitted_as_not_held():
    f_hz = np.arange(1, 50) * 1.0
    model = fit(response(axis("none"), np.random.default_rng(SEED), f_hz), "1/2")
    assert (model.hold, model.hold_assumed, model.other_delay_s) == ("none", True, None)


# ---- stacks of effects ---------------------------------------------------------------------------


AXIS = {
    "rigid_body": {"gain": 40.0},
    "viscous_friction": {"rate": 25.0},
    "transport_delay": {"delay_s": 1e-3},
}


def held_record(top_hz, noise, hold=None, n=3000, **more):
    """A held command on a delayed axis, from the simulator; the record does not state it."""
    u = Multisine.design(FS_HZ, n, (5, top_hz), rms=1.0).table()
    record = axis_record(u, 8, noise, SEED, gain=40.0, viscous_rate=25.0, delay_s=1e-3, **more)
    return dataclasses.replace(record, hold=hold)


def test_a_plant_is_fitted_under_both_and_the_data_tell(tmp_path):
    fit = fit_plant(plant(AXIS), held_record(900, 1e-4))
    assert (fit.hold, fit.hold_assumed) == ("zoh", True)
    assert fit.cost_per_dof == pytest.approx(1, abs=0.3)
    assert fit.delay_s == pytest.approx(1e-3, abs=4 * fit.model["transport_delay.delay_s"].std)
    assert fit.delay_hold_uncertainty_s == pytest.approx(0.5 / FS_HZ, rel=0.2)
    fit.model.save(tmp_path / "m.json")
    kept = load_model(tmp_path / "m.json").fit
    assert (kept["hold"], kept["hold_assumed"]) == ("zoh", True)
    assert kept["other_delay_s"] == fit.other_delay_s


def test_a_plant_equal_under_both_holds_counts_as_not_held():
    fit = fit_plant(plant(AXIS), held_record(60, 0.05))
    assert (fit.hold, fit.hold_assumed) == ("none", True)
    assert fit.other_delay_s == pytest.approx(fit.delay_s - 0.5 / FS_HZ, abs=2e-5)
    stated = fit_plant(plant(AXIS), held_record(60, 0.05, "zoh"))
    assert (stated.hold, stated.hold_assumed, stated.delay_hold_uncertainty_s) == ("zoh", False, None)
    assert stated.delay_s == pytest.approx(fit.other_delay_s, abs=1e-6)


def unheld_record(top_hz, noise, lag_s=0.0, hold=None):
    """A signal without lines above half the rate, on a delayed axis behind a lagging gyro, in closed form."""
    u = Multisine.design(FS_HZ, 3000, (5, top_hz), rms=1.0).table()
    s = 2j * np.pi * np.fft.rfftfreq(len(u), 1 / FS_HZ)
    y = np.fft.irfft(np.fft.rfft(u) * 40.0 / (s + 25.0) * np.exp(-1e-3 * s) / (lag_s * s + 1), len(u))
    y = np.tile(y, 8) + noise * np.random.default_rng(SEED).standard_normal(8 * len(u))
    return Record(np.tile(u, 8), y, FS_HZ, len(u), 0, hold=hold, y_unit="deg/s")


def test_bug_a_held_null_without_a_header_got_a_lag_by_name():
    """It was taken as not held: its sinc and images looked like a lag."""
    as_before = fit_plant(plant(AXIS), held_record(900, 1e-4, "none", SHORT))  # how a silent file was read
    assert as_before.cost_per_dof > 1.5
    found = diagnose(plant(AXIS), held_record(900, 1e-4, None, SHORT))
    stated = diagnose(plant(AXIS), held_record(900, 1e-4, "zoh", SHORT))
    assert found.adequate
    assert found.p_value == stated.p_value
    assert (found.hold, found.hold_assumed, stated.hold_assumed) == ("zoh", True, False)
    assert found.to_dict()["delay_hold_uncertainty_s"] == pytest.approx(0.5 / FS_HZ, rel=0.3)
    assert found.model.fit["hold_assumed"]


@pytest.mark.parametrize("record", [unheld_record, lambda *a: held_record(*a[:2], gyro_lag_s=a[2])])
def test_a_lag_that_is_missing_under_both_is_named(record):
    found = diagnose(plant(AXIS), record(200, 1e-3, 2e-3))
    assert found.verdict == "missing_effect"
    assert set(found.found[0]) & {"motor_lag", "sensor_lag"}
    assert found.hold_assumed


def test_friction_is_named_beside_an_unknown_hold_and_no_mode_that_imitates_it():
    found = diagnose(plant(AXIS), held_record(200, 1e-3, None, SHORT, coulomb_level=5.0))
    assert (found.verdict, found.hold, found.hold_assumed) == ("missing_effect", "zoh", True)
    assert [effects[0] for effects in found.found] == ["coulomb_friction"]


# ---- compare, piecewise --------------------------------------------------------------------------


@pytest.mark.parametrize("truth", ["zoh", "none"])
def test_bug_a_right_model_was_rejected_by_a_record_without_a_header(truth):
    """A stated model beside a silent record: the comparison takes the reading under which it is adequate."""
    record = {"zoh": held_record, "none": unheld_record}[truth]
    model = fit_plant(plant(AXIS), record(900, 1e-3, hold=truth)).model
    silent = compare(model, record(900, 1e-3), fitted=True)
    stated = compare(model, record(900, 1e-3, hold=truth), fitted=True)
    assert silent.adequate
    assert (silent.hold, silent.hold_assumed, stated.hold_assumed) == (truth, True, False)
    assert silent.p_value == stated.p_value
    assert silent.to_dict()["delay_hold_uncertainty_s"] == pytest.approx(0.5 / FS_HZ)
    wrong = {"zoh": "none", "none": "zoh"}[truth]
    assert not compare(model, record(900, 1e-3, hold=wrong), fitted=True).adequate


def test_a_rational_model_is_compared_under_both(caplog):
    record = held_record(900, 1e-3)
    model = fit(frf(record), "1/0")
    found = compare(model, record, fitted=True)
    assert found.adequate
    assert (found.hold, found.hold_assumed) == (model.hold, True)
    assert found.other_delay_s == model.other_delay_s
    assert not caplog.records  # no warning that model and record differ


@pytest.mark.parametrize(("truth", "half"), [("zoh", 0.5 / FS_HZ), ("none", -0.5 / FS_HZ)])
def test_the_delay_under_the_other_hold_differs_by_half_a_sample(truth, half):
    """A hold delays by half a sample: without it, the same record has a longer transport delay."""
    record = {"zoh": held_record, "none": unheld_record}[truth](900, 1e-3)
    model = RationalModel([40.0], [1.0, 25.0], 1e-3, fs_hz=FS_HZ, hold="zoh", y_unit=record.y_unit)
    found = compare(model, record)
    assert (found.hold, found.adequate) == (truth, True)
    assert found.other_delay_s == pytest.approx(1e-3 + half)
    assert found.delay_hold_uncertainty_s == pytest.approx(0.5 / FS_HZ)


def test_a_comparison_states_the_delay_of_the_fit_with_the_other_hold():
    """The fit may move the delay by other than half a sample, because other parameters move with it."""
    model = plant(AXIS)
    model.fit = {"hold": "zoh", "other_delay_s": 1.4e-3}
    found = compare(model, held_record(900, 1e-3))
    assert (found.hold, found.other_delay_s) == ("zoh", 1.4e-3)
    assert found.delay_hold_uncertainty_s == pytest.approx(0.4e-3)


def test_all_pieces_have_one_hold():
    rng, f_hz = np.random.default_rng(SEED), np.arange(1, 300) * 2.0
    model = fit_piecewise(response(axis("zoh"), rng, f_hz), "1/0", 3)
    assert {piece.hold_assumed for piece in model.pieces} == {True}
    assert len({piece.hold for piece in model.pieces}) == 1
    assert all(piece.other_delay_s is not None for piece in model.pieces)


# ---- what uses a model with an assumed hold -------------------------------------------------------


def test_a_step_of_the_ladder_takes_one_hold_and_keeps_that_it_was_assumed():
    done = add("coulomb_friction", plant(AXIS), held_record(200, 1e-2, coulomb_level=5.0))
    values = done.to_dict()
    assert values["hold_assumed"]
    assert done.model.fit["hold"] == values["hold"] == done.fit.hold
    assert values["delay_hold_uncertainty_s"] == pytest.approx(0.5 / FS_HZ, rel=0.3)


def test_bug_the_misfit_without_the_effect_decided_the_hold():
    """Friction leaves many times what a wrong hold does; the right model was rejected by the next record."""
    record = held_record(100, 1e-3, coulomb_level=20.0)
    assert fit_plant(plant(AXIS), record).hold == "none"
    done = add("coulomb_friction", plant(AXIS), record)
    delay = done.model["transport_delay.delay_s"]
    assert (done.fit.hold, done.fit.hold_assumed) == ("zoh", True)
    assert done.model.fit["hold"] == "zoh"
    assert delay.value == pytest.approx(1e-3, abs=4 * delay.std)
    assert done.fit.other_delay_s == pytest.approx(1e-3 + 0.5 / FS_HZ, abs=2e-5)
