"""docs/reference/thesis.md names commands and tests that exist, and every figure and equation."""

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


#: The last figure and the last equation of each chapter.
FIGURES = {3: 15, 4: 26, 5: 11, 6: 1, 7: 16}
EQUATIONS = {3: 10, 4: 12, 5: 16, 6: 8, 7: 30}


def listed(text, word):
    """Numbers behind a word, such as (4, 7) of "Figs. 4.6 to 4.9 and 4.13"."""
    found = set()
    for numbers in re.findall(rf"{word}s?\. ([0-9., toand]+)", text):
        for first, last in re.findall(r"(\d+\.\d+)(?: to (\d+\.\d+))?", numbers):
            chapter, begin = (int(x) for x in first.split("."))
            end = int(last.split(".")[1]) if last else begin
            found |= {(chapter, n) for n in range(begin, end + 1)}
    return found


def test_every_figure_and_equation_of_chapters_3_to_7_has_a_row(root):
    text = (root / "docs/reference/thesis.md").read_text()
    places = "\n".join(line.split("|")[1] for line in text.splitlines() if line.startswith("| "))
    for word, last in (("Fig", FIGURES), ("eq", EQUATIONS)):
        wanted = {(chapter, n) for chapter, most in last.items() for n in range(1, most + 1)}
        missing = sorted(wanted - listed(places, word))
        assert not missing, f"{word}. without a row: {missing}"
