"""tools/check_wording passes on the tree, and finds everyday words in text but not in code."""

import sys

import pytest


@pytest.fixture
def check(run, root, tmp_path):
    """Run the check on one file with this text."""

    def check(name, text):
        path = tmp_path / name
        path.write_text(text)
        return run(sys.executable, root / "tools/check_wording", path)

    return check


def test_the_tree_as_it_stands_is_clean(run, root):
    result = run(sys.executable, root / "tools/check_wording")
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize(
    ("name", "text", "line", "words"),
    [
        ("page.md", "# Title\n\nThe result is told at the end.\n", 3, "told"),
        ("page.md", "A record, Said to be good.\n", 1, "Said"),
        ("page.md", "Its answer is sealed first.\n", 1, "sealed"),
        ("page.md", "A length that there is.\n", 1, "that there is"),
        ("page.md", "```sh\nmake\n```\nThe house\n", 4, "The house"),
        ("code.py", '"""Summary.\n\nThe period that was asked for.\n"""\n', 3, "asked for"),
        ("code.py", "x = 1  # nobody knows\n", 1, "nobody"),
        ("code.py", "x = 1  # a fault that is not seen\n", 1, "not seen"),
        ("code.py", '"""Samples thrown away at the start."""\n', 1, "thrown away"),
        ("code.py", '"""Not looked at for spectra."""\n', 1, "looked at"),
        ("page.md", "The mean period is taken off first.\n", 1, "taken off"),
        ("page.md", "The line stands out of the noise.\n", 1, "stands out"),
        ("code.py", 'raise ValueError(f"took back {x}")\n', 1, "took back"),
        ("code.py", '"""Mean over periods (source, eq. 4.10)."""\n', 1, "source"),
        ("code.py", "x = 1  # DIS-1; source, eqs. 5.12 to 5.16\n", 1, "source"),
        ("code.h", "/* The mean (source, eqs. 4.10\n * and 4.11). */\n", 1, "source"),
        ("code.h", "/* Summary.\n * Is heard at the end. */\nint x;\n", 2, "heard"),
    ],
)
def test_everyday_words_are_found(check, name, text, line, words):
    result = check(name, text)
    assert result.returncode == 1
    assert f'{name}:{line}: "{words}": write ' in result.stdout


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("page.md", "```console\n$ gsid run\nit said so\n```\n\n    told\n\n`said`, saying, retold.\n"),
        ("code.py", "told = said = 1\n"),
        ("code.c", "int told; /* The value. */\n"),
        ("page.md", "The record names its file (source and date), a header, source and objects.\n"),
    ],
)
def test_code_and_longer_words_are_not_looked_at(check, name, text):
    assert check(name, text).returncode == 0
