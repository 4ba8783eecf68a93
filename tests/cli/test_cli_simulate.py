"""gsid simulate --effect: what is refused before a line is opened."""

import pytest

from gsid.effects.types import catalogue
from gsid.rig.axis import HIDDEN


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--effect", "cubic_sprint"), 3, "did you mean cubic_spring?"),
        (("--effect", "gear_backlash"), 3, "it has drive_dead_zone"),
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


def test_an_effect_without_a_law_of_the_axis_is_not_simulated(gsid):
    """A new effect is a file in src/effects; the axis, which tests it, gets its law separately or refuses."""
    without = [effect for effect in catalogue() if effect not in HIDDEN]
    assert "quadratic_drag" not in without
    for effect in without:
        result = gsid("simulate", "--effect", effect)
        assert result.code == 3, effect
        assert "does not have this effect" in result.err
        assert "hint: it has drive_dead_zone" in result.err
