"""docs/reference/thesis.md names commands and tests that exist."""

import re

import click

from gsid.cli.main import gsid


def test_every_test_and_command_exists(root):
    text = (root / "docs/reference/thesis.md").read_text()
    tests = re.findall(r"`(tests/\S+\.py)::(\w+)`", text)
    assert len(tests) > 15
    for path, name in tests:
        assert f"def {name}(" in (root / path).read_text(), f"{path}::{name}"
    for words in re.findall(r"`gsid ([a-z][a-z -]*)`", text):
        command, context = gsid, click.Context(gsid)
        for word in words.split():
            if isinstance(command, click.Group):
                command = command.get_command(context, word)
                assert command is not None, words
