"""gsid design compare-methods."""

import json

from gsid.models.rational import RationalModel

COMMON = ("--fs", 1000, "--period", 1000, "--band", "2:100", "--limit-command", 3)


def test_four_methods_in_the_same_time(gsid):
    RationalModel([60.0], [1, 30.0], 0.003, fs_hz=1000.0, hold="zoh", y_unit="deg/s").save("m.json")
    options = ("--duration", 120, "--noise-rms", 0.5, "--model", "m.json", "--simulations", 3)
    result = gsid("design", "compare-methods", *COMMON, *options, "--plot", "m.svg", "--json")
    assert result.code == 0, result.err
    values = json.loads(result.out)
    assert [one["name"] for one in values["methods"]] == ["multisine", "stepped-sine", "sweep", "prbs"]
    assert all(len(one["sigma"]) == len(one["sigma_simulated"]) for one in values["methods"])
    text = gsid("design", "compare-methods", *COMMON, *options)
    assert "stepped-sine" in text.out
    short = gsid("design", "compare-methods", *COMMON, "--duration", 5, "--noise-rms", 0.5).out
    assert "needs" in short


def test_the_noise_is_needed(gsid):
    assert gsid("design", "compare-methods", *COMMON, "--duration", 5).code == 2
    assert gsid("design", "compare-methods", "--noise-rms", 1, *COMMON[:-2], "--duration", 5).code == 2
