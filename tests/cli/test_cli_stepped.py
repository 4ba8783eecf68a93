"""A stepped sine from design over the serial line to its response."""

import json

import numpy as np


def test_from_design_over_the_line_to_the_response(gsid):
    design = ("--fs", 3000, "--period", 600, "--band", "20:120", "--periods", 3, "--amplitude", 2)
    made = gsid("design", "stepped-sine", *design, "-o", "u.csv", "--json")
    assert made.code == 0, made.err
    n_lines = json.loads(made.out)["n_lines"]
    axis = "--linear --noise-scale 0.3"
    ran = gsid("run", "--simulate", axis, "--u", "u.csv", "-o", "rec.csv", "--plot", "g.svg", "--json")
    assert ran.code == 0, ran.err
    values = json.loads(ran.out)
    assert len(values["f_hz"]) == n_lines
    assert (values["n_periods"], values["settle_samples"]) == (1, 0)
    response = json.loads(gsid("frf", "rec.csv", "--json").out)
    assert response["n_dof"] == 2
    assert response["period_samples"] == 600
    assert response["g_re"] == values["g_re"]
    # the multisine measures the same response
    multisine = ("--period", 3000, "--band", "20:120", "--amplitude", 0.3, "--periods", 8, "-o", "m.csv")
    assert gsid("run", "--simulate", axis, *multisine).code == 0
    joined = json.loads(gsid("join", "rec.csv", "m.csv", "--alpha", "1e-4", "--json").out)
    assert len(joined["overlaps"][0]["f_hz"]) == n_lines
    assert joined["agree"] is True
    assert np.all(np.array(joined["var_g"]) > 0)


def test_bug_the_next_excitation_after_a_stepped_sine_exceeded_its_measured_peak(gsid):
    design = ("--fs", 3000, "--period", 600, "--band", "20:120", "--periods", 3, "--amplitude", 2)
    assert gsid("design", "stepped-sine", *design, "-o", "u.csv").code == 0
    axis = "--linear --noise-scale 3"
    assert gsid("run", "--simulate", axis, "--u", "u.csv", "-o", "rec.csv").code == 0
    plan = json.loads(gsid("next", "rec.csv", "--sigma", "0.001", "--json").out)
    assert plan["amplitude"] <= 2.01
