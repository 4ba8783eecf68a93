"""gsid export-c"""

import json

from gsid.models.rational import RationalModel


def test_two_files_and_what_they_hold(gsid, tmp_path):
    RationalModel([7.4], [1, 11], 0.0051, fs_hz=3000, hold="zoh").save(tmp_path / "rig.json")
    result = gsid("export-c", tmp_path / "rig.json", "--json")
    assert result.code == 0, result.err
    told = json.loads(result.out)
    assert told["files"] == [str(tmp_path / "rig.h"), str(tmp_path / "rig.c")]
    assert (told["n_states"], told["delay_samples"], told["feedforward"]) == (1, 15.3, [])
    assert "float rig_step(rig *m, float u)" in (tmp_path / "rig.c").read_text()


def test_an_unstable_model_is_bad_input(gsid, tmp_path):
    RationalModel([1], [1, -2], 0.0051, fs_hz=3000, hold="zoh").save(tmp_path / "rig.json")
    result = gsid("export-c", tmp_path / "rig.json")
    assert result.code == 3
    assert "not stable" in result.err
    assert "hint:" in result.err
    assert not (tmp_path / "rig.c").exists()


def test_a_name_that_c_does_not_take(gsid, tmp_path):
    RationalModel([1], [1, 2], 0.0051, fs_hz=3000, hold="zoh").save(tmp_path / "rig.json")
    assert gsid("export-c", tmp_path / "rig.json", "-o", tmp_path / "2fast.c").code == 2


def test_another_rate_is_the_rate_of_the_code(gsid, tmp_path):
    RationalModel([7.4], [1, 11], 0.005, fs_hz=3000, hold="zoh").save(tmp_path / "rig.json")
    result = gsid("export-c", tmp_path / "rig.json", "--fs", 1000, "--json")
    told = json.loads(result.out)
    assert (told["fs_hz"], told["delay_samples"]) == (1000, 5)
    assert "1000 calls a second" in (tmp_path / "rig.c").read_text()


def test_another_rate_of_a_model_in_z_is_refused(gsid, tmp_path):
    RationalModel([0.1], [1, -0.5], domain="z", fs_hz=3000).save(tmp_path / "rig.json")
    result = gsid("export-c", tmp_path / "rig.json", "--fs", 1000)
    assert result.code == 3
    assert "1000 and 3000 Hz" in result.err
