"""The catalogue as the command lists it."""

import json

from gsid.effects.types import catalogue


def test_the_table_has_a_line_for_each_effect(gsid):
    lines = gsid("effects").out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == list(catalogue())
    assert "delay_s [s]" in gsid("effects").out


def test_json_has_all_results(gsid):
    effects = {one["effect"]: one for one in json.loads(gsid("effects", "--json").out)["effects"]}
    assert list(effects) == list(catalogue())
    stribeck = effects["stribeck_friction"]
    assert [p["name"] for p in stribeck["parameters"]] == ["level", "extra", "velocity"]
    assert stribeck["parameters"][2]["null_value"] is None
    assert "coulomb_friction" in stribeck["confused_with"]


def test_one_effect(gsid):
    out = gsid("effects", "rigid_body", "coulomb_friction").out
    assert "rigid_body (torque)" in out
    assert "level" in out
    assert [one["effect"] for one in json.loads(gsid("effects", "rigid_body", "--json").out)["effects"]] == [
        "rigid_body"
    ]


def test_an_unknown_effect_is_bad_input(gsid):
    result = gsid("effects", "rigid_bdy")
    assert (result.code, result.out) == (3, "")
    assert "did you mean rigid_body?" in result.err
