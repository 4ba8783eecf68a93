"""gsid design next: the experiment that distinguishes two models."""

import json
from dataclasses import replace

import numpy as np
import pytest

import gsid
from gsid.diagnosis.next_experiment import next_experiment
from gsid.excitation.multisine import Multisine
from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.records.files import read_record, write_record
from gsid.records.record import Record

FS, N, PERIODS, SEED = 1000.0, 1000, 4, 20261123


def params(**values):
    return {name: Param(value) for name, value in values.items()}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A record, and two models: with dry friction, and with dry friction that gives first."""
    print("seed", SEED)
    folder = tmp_path_factory.mktemp("next")
    effects = [Effect("rigid_body", params(gain=7.4)), Effect("viscous_friction", params(rate=11.0))]
    linear = PlantModel(FS, effects, y_unit="deg/s")
    dry = linear.with_effect("coulomb_friction", {"level": 15.0})
    dry.save(folder / "dry.json")
    linear.with_effect("presliding_friction", {"level": 15.0, "stiffness": 500.0}).save(
        folder / "giving.json"
    )
    u = Multisine.design(FS, N, (1, 100), rms=20.0, phases="random", seed=SEED).table()
    y = np.tile(dry.simulate(u).y, PERIODS)
    noise = np.random.default_rng(SEED).normal(0, 0.01 * np.std(y), len(y))
    record = Record(np.tile(u, PERIODS), y + noise, FS, N, 0, hold="zoh", y_unit="deg/s", u_unit="A")
    write_record(folder / "rec.csv", record)
    return folder


def test_the_best_experiment_is_written_as_a_period_of_the_command(files, gsid, tmp_path):
    made = tmp_path / "next.csv"
    models = ["--model", files / "dry.json", "--rival", files / "giving.json"]
    found = gsid("design", "next", files / "rec.csv", *models, "-o", made, "--json")
    assert found.code == 0
    answer = json.loads(found.out)
    ranked = next_experiment(*_models(files), _spectra(files))
    assert [one["words"] for one in answer["experiments"]] == [one.words for one in ranked]
    assert ranked[0].words in answer["sentence"]
    period = read_record(made, y="u")
    assert (period.fs_hz, period.period_samples, period.hold) == (FS, N, "zoh")
    assert np.max(np.abs(period.u - ranked[0].command)) == 0


def test_bug_models_in_the_other_order_were_not_distinguished(files, gsid):
    """The friction that gives first imitates the dry one; in that order there was no experiment."""
    one, other = (
        json.loads(gsid("design", "next", files / "rec.csv", "--model", a, "--rival", b, "--json").out)
        for a, b in [(files / "dry.json", files / "giving.json"), (files / "giving.json", files / "dry.json")]
    )
    assert one == other
    assert "To distinguish dry.json from giving.json" in one["sentence"]


def test_the_travel_of_both_models_is_within_the_limit(files, gsid):
    """A softer axis travels further: an experiment was checked with the model that was given first."""
    record, limit = files / "rec.csv", 0.02
    soft = PlantModel.load(files / "dry.json")
    soft["rigid_body.gain"].value *= 3
    soft.save(files / "soft.json")
    for a, b in [("dry.json", "soft.json"), ("soft.json", "dry.json")]:
        models = ["--model", files / a, "--rival", files / b]
        found = json.loads(gsid("design", "next", record, *models, "--json").out)["experiments"]
        allowed = [one for one in found if one["travel"] / 2 <= limit]
        assert allowed != found
        within = gsid("design", "next", record, *models, "--limit-travel-deg", limit, "--json")
        assert json.loads(within.out)["experiments"] == allowed
        for one in found:
            command = next(e for e in next_experiment(soft, soft, _spectra(files)) if e.words == one["words"])
            assert one["travel"] >= command.travel * (1 - 1e-9)


@pytest.mark.parametrize(
    ("change", "text"), [({"output": "angle"}, "output"), ({"angle_unit": "rad"}, "unit of the angle")]
)
def test_models_of_different_outputs_are_refused(files, gsid, change, text):
    replace(PlantModel.load(files / "dry.json"), **change).save(files / "other.json")
    models = ["--model", files / "dry.json", "--rival", files / "other.json"]
    found = gsid("design", "next", files / "rec.csv", *models)
    assert found.code != 0
    assert f"the models differ in their {text}" in found.err


def test_no_experiment_exceeds_the_limits(files, gsid, tmp_path):
    models = ["--model", files / "dry.json", "--rival", files / "giving.json"]
    limits = ["--limit-command", 30, "--limit-travel-deg", 0.05]
    found = gsid("design", "next", files / "rec.csv", *models, *limits, "--json")
    ranked = json.loads(found.out)["experiments"]
    assert ranked
    assert max(one["peak"] for one in ranked) <= 30
    assert max(one["travel"] for one in ranked) <= 0.1  # from end to end


def test_models_that_no_experiment_distinguishes_give_a_sentence_and_no_file(files, gsid, tmp_path):
    made = tmp_path / "next.csv"
    models = ["--model", files / "dry.json", "--rival", files / "dry.json"]
    found = gsid("design", "next", files / "rec.csv", *models, "-o", made)
    assert found.code == 0
    assert "No experiment of the menu distinguishes" in found.out
    assert not made.exists()
    assert f"{made} was not written" in found.err


def _models(folder):
    return [PlantModel.load(folder / name) for name in ("dry.json", "giving.json")]


def _spectra(folder):
    return gsid.spectra(read_record(folder / "rec.csv"))
