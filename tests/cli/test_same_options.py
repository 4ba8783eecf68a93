"""An option of one name means the same in every command, in the same words."""

import re
from collections.abc import Iterator

import click
import pytest

from gsid.cli.main import gsid as verbs

# Option: commands in which it is another thing, and why.
OTHER_THINGS = {
    "--u": {"gsid run": "a file with the command, not a column of a record"},
    "--settle": {
        "gsid run": "samples or periods, also after a lost command",
        "gsid design stepped-sine": "before each sine",
    },
    "--limit-travel-deg": {
        "gsid run": "of the integral of the rate, from the start",
        "gsid look": "of the position from the start, on both sides or one",
    },
    "--param": {"gsid simulate": "values of the axis; `gsid add` takes start values and bounds"},
    "--kind": {
        "gsid design prbs": "of a sequence",
        "gsid design sweep": "of a sweep",
        "gsid design transient": "of a signal",
    },
    "--output": dict.fromkeys(
        ("gsid start", "gsid diagnose"), "what y is: rate, angle or acceleration; its file is -o"
    )
    | dict.fromkeys(("gsid gimbal", "gsid design orthogonal"), "a folder of several experiments"),
    "--port": {"gsid studio": "of the page; `gsid run` takes a serial port"},
    "--library": {"gsid": "for every verb; `gsid add` takes the effect to add"},
}
# Option: what may differ, and why.
OWN_WORDS = {
    "--output": ({"help", "metavar"}, "each verb writes another file"),
    "--model": ({"help"}, "each verb does something else with the model"),
    "--seed": ({"help"}, "each verb draws something else"),
}


def commands(command: click.Command, path: str) -> Iterator[tuple[str, click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            yield from commands(command.get_command(context, name), f"{path} {name}")


def facts(option: click.Option) -> dict[str, object]:
    """What is to be the same; defaults may differ."""
    words = re.sub(r" \[default[^]]*\]", "", option.help or "")
    return {"help": words, "metavar": option.metavar, "type": option.type.to_info_dict()}


OPTIONS: dict[str, dict[str, click.Option]] = {}
for path, command in commands(verbs, "gsid"):
    for option in command.params:
        if isinstance(option, click.Option):
            OPTIONS.setdefault(option.opts[-1], {})[path] = option
SHARED = {name: where for name, where in OPTIONS.items() if len(where) > 1}


@pytest.mark.parametrize("name", SHARED)
def test_an_option_has_the_same_words_everywhere(name):
    own, _ = OWN_WORDS.get(name, (set(), ""))
    seen: dict[str, list[str]] = {}
    for path, option in SHARED[name].items():
        if path not in OTHER_THINGS.get(name, {}):
            said = {key: value for key, value in facts(option).items() if key not in own}
            seen.setdefault(str(said), []).append(path)
    assert len(seen) <= 1, "\n".join(f"{', '.join(paths)}: {said}" for said, paths in seen.items())


def test_the_exceptions_are_of_options_that_exist():
    for name, where in OTHER_THINGS.items():
        assert set(where) <= set(SHARED[name]), name
    assert set(OWN_WORDS) <= set(SHARED)
    assert len(SHARED) > 20
    assert len(OTHER_THINGS) + len(OWN_WORDS) <= 11
