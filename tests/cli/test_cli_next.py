"""gsid next."""

import json
from pathlib import Path

from gsid.plant.effect import Effect, Param
from gsid.plant.model import PlantModel
from gsid.records.files import read_record

KEYS = {"amplitude", "n_periods", "n_realisations", "time_s", "expected_std", "reason"}


def test_the_next_excitation_of_a_record(gsid, rec_csv):
    result = gsid("next", rec_csv, "--sigma", "0.005", "-o", "u.csv", "--json")
    assert result.code == 0, result.err
    values = json.loads(result.out)
    assert values.keys() >= KEYS
    assert values["expected_std"] <= 0.00501
    assert len(values["line_amplitude"]) == len(values["f_hz"])
    assert "period_samples" in Path("u.csv").read_text()
    assert "largest command" in gsid("next", rec_csv).out


def test_parameters_reach_what_is_wanted(gsid, rec_csv):
    assert gsid("fit", rec_csv, "--order", "2/0", "-o", "m.json").code == 0
    result = gsid("next", rec_csv, "--model", "m.json", "--parameter-sigma", "0.05", "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out).keys() >= KEYS


def test_parameters_of_a_stack_reach_what_is_wanted(gsid, rec_csv):
    body = Effect("rigid_body", {"gain": Param(50.0)})
    damping = Effect("viscous_friction", {"rate": Param(20.0)})
    PlantModel(read_record(rec_csv).fs_hz, [body, damping], y_unit="deg/s").save("m.json")
    result = gsid("next", rec_csv, "--model", "m.json", "--parameter-sigma", "0.05", "--json")
    assert result.code == 0, result.err
    plan = json.loads(result.out)
    assert len(plan["expected"]) == 2
    assert max(plan["expected"]) == plan["expected_std"] <= 0.0501


def test_options_that_do_not_go_together(gsid, rec_csv):
    assert gsid("next", rec_csv, "--parameter-sigma", "0.01").code == 2
    assert gsid("next", rec_csv, "--limit-travel-deg", "1").code == 2
    assert gsid("next", rec_csv, "--rival", rec_csv).code == 2
    assert gsid("next", rec_csv, "--sigma", "0.01", "--realisation", "60").code == 2


def test_in_a_study_the_last_records_are_used(gsid, rec_csv):
    assert gsid("-C", "axis", "open", rec_csv).code == 0
    result = gsid("-C", "axis", "next", "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["study"]["outputs"][0].startswith("excitation/")
