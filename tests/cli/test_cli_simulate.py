"""gsid simulate --effect: what is refused before a line is opened."""

import pytest


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--effect", "cubic_sprint"), 3, "did you mean cubic_spring?"),
        (("--effect", "gear_backlash"), 3, "it can: drive_dead_zone"),
        (("--effect", "coulomb_friction", "--param", "levle=1"), 3, "did you mean level?"),
        (("--effect", "coulomb_friction", "--param", "level=-1"), 2, "out of its range"),
        (("--effect", "coulomb_friction", "--param", "level"), 2, "is not NAME=VALUE"),
        (("--param", "level=1"), 2, "--param needs --effect"),
    ],
)
def test_an_effect_that_cannot_be_hidden_is_refused(gsid, arguments, code, words):
    result = gsid("simulate", *arguments)
    assert (result.code, words in result.err, result.out) == (code, True, ""), result.err
    assert "hint:" in result.err
