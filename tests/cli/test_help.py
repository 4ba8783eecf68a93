"""What the command says about itself, and how fast."""

import importlib
import os
import subprocess
import sys

import click
import pytest

from gsid.cli.main import VERBS


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_every_verb(gsid, snapshot, verb):
    result = gsid(verb, "--help")
    assert (result.code, result.err) == (0, "")
    snapshot(f"help_{verb}", result.out)


def test_help(gsid, snapshot):
    snapshot("help", gsid("--help").out)
    for kind in (
        "multisine",
        "orthogonal",
        "prbs",
        "sweep",
        "stepped-sine",
        "transient",
        "budget",
        "next",
        "compare-methods",
    ):
        snapshot(f"help_design_{kind}", gsid("design", kind, "--help").out)
    for kind in ("run", "merge", "clean"):
        snapshot(f"help_fleet_{kind}", gsid("fleet", kind, "--help").out)
    assert gsid("-h").out == gsid("--help").out


def test_no_verb_shows_the_help(gsid):
    result = gsid()
    assert result.code == 2
    assert result.out == ""
    assert "Verbs:" in result.err


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_words_and_documented_options(verb):
    word = verb.replace("-", "_")
    command = getattr(importlib.import_module(f"gsid.cli.{word}"), word)
    commands = command.commands.values() if isinstance(command, click.Group) else [command]
    for one in commands:
        assert one.help
        options = [p for p in one.params if isinstance(p, click.Option)]
        # a choice shows its words in any case
        silent = [p.opts[-1] for p in options if not (p.help or isinstance(p.type, click.Choice))]
        assert not silent, f"options without a word: {silent}"


def test_version(gsid):
    import gsid as package

    assert gsid("--version").out == f"gsid {package.__version__}\n"


def test_python_m_gsid_is_the_command():
    run = subprocess.run([sys.executable, "-m", "gsid", "--version"], capture_output=True, text=True)
    assert (run.returncode, run.stdout[:5]) == (0, "gsid ")


def test_help_imports_nothing_heavy():
    heavy = "matplotlib|pandas|control|scipy|numpy|h5py|rich"
    code = f"import sys, gsid.cli.main; print([m for m in '{heavy}'.split('|') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


FREQUENT = ("response.estimate", "comparison", "models.load", "fitting.rational", "fitting.order")
OF_DIAGNOSIS = ("structure.start", "diagnosis.from_records.diagnose")


@pytest.mark.parametrize("module", [*FREQUENT, *OF_DIAGNOSIS])
def test_frequent_commands_start_without_scipy_stats(module):
    code = f"import sys, gsid.{module}; print('scipy.stats' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("3", "3")])
def test_the_command_calculates_with_one_thread_of_openblas(given, used):
    """A bug: threads that waited for each other more than doubled the processor time of `gsid diagnose`."""
    environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    environment |= {"OPENBLAS_NUM_THREADS": given} if given else {}
    code = "import os, gsid.cli.main as c; c.main(['--version']); print(os.environ['OPENBLAS_NUM_THREADS'])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert run.stdout.splitlines()[-1] == used
