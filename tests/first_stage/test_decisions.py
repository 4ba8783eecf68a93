"""Decisions of the diagnosis from records between the fits: each from both sides of its limit."""

from types import SimpleNamespace

import hard
import pytest
import trials

from gsid.diagnosis.from_records.draft import with_stack
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import Decision
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of

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


def test_bug_a_mode_at_the_end_of_the_band_stood_in_for_a_lag():
    """It was named, though the lag fits better; without lags in the catalogue it was named as well."""
    trial = hard.make_hard(21710, 1, "single")
    assert [effect["id"] for effect in trial.key["effects"]] == ["motor_lag"]
    records = [Record(u, y, trials.FS_HZ, trials.N, 0, hold="zoh") for u, y in trial.records]
    given = PlantModel.from_dict(trial.models[0.05], "null")
    found = first_stage(spectra_of(records), given)
    assert found.conclusion.effects == ("motor_lag",)
    found = first_stage(spectra_of(records), given, without={"motor_lag", "sensor_lag"})
    print(found.conclusion)
    assert found.conclusion.kind != "named"
    assert "flexible_mode" not in found.conclusion.effects


NOISE = SimpleNamespace(fit=SimpleNamespace(cost_per_dof=1.09, n_dof=100_000))
MORE = SimpleNamespace(fit=SimpleNamespace(cost_per_dof=1.11, n_dof=100_000))
FEW = SimpleNamespace(fit=SimpleNamespace(cost_per_dof=1.11, n_dof=200))  # 3 sqrt(2 / n_dof) is 0.3


@pytest.mark.parametrize(
    ("null", "laws", "draft", "verdict"),
    [
        (NOISE, [], "unknown_effect", "adequate"),
        (MORE, [], "unknown_effect", "unknown_effect"),
        (FEW, [], "unknown_effect", "adequate"),
        (NOISE, ["a fit"], "unknown_effect", "unknown_effect"),
        (NOISE, [], "nearest_effect", "nearest_effect"),  # its fits were not made in time
        (None, [], "unknown_effect", "unknown_effect"),
    ],
)
def test_bug_a_slow_held_sensor_was_unknown_though_the_simulation_left_noise(null, laws, draft, verdict):
    """The first stage, which has no images above the band, left four times the noise."""
    run = SimpleNamespace(null=null, laws=laws, decision=Decision(draft), settings=DEFAULTS)
    Run.accept_noise(run)
    assert run.decision.verdict == verdict
