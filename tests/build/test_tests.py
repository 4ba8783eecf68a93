"""The tests themselves and the list that runs them.

Each asserts something, and none replaces a name by its path in the package.
"""

import ast
import re
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parents[1]
CHECKS = ("raises", "warns", "fail")  # of pytest; and whatever is called assert_...


def parsed():
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(TESTS.rglob("*.py"))}


def called(node):
    """Names of the functions called in a node."""
    calls = [one.func for one in ast.walk(node) if isinstance(one, ast.Call)]
    return {one.attr if isinstance(one, ast.Attribute) else getattr(one, "id", "") for one in calls}


def asserts(node, helpers=frozenset()):
    names = called(node)
    return (
        any(isinstance(one, ast.Assert) for one in ast.walk(node))
        or any(name in CHECKS or name.startswith("assert_") for name in names)
        or bool(names & helpers)
    )


def test_every_test_asserts_something():
    """A bug: a test drew six pictures of a short record and looked at none of them."""
    trees = parsed()
    functions = [
        (path, one)
        for path, tree in trees.items()
        for one in ast.walk(tree)
        if isinstance(one, ast.FunctionDef)
    ]
    assert len(functions) > 1000
    helpers = frozenset(one.name for _, one in functions if not one.name.startswith("test_") and asserts(one))
    idle = [
        f"{path.relative_to(TESTS)}:{one.lineno} {one.name}"
        for path, one in functions
        if one.name.startswith("test_") and not asserts(one, helpers)
    ]
    assert not idle


def test_bug_two_files_of_tests_had_one_name():
    """pytest then collects neither, but only in a run of both folders."""
    names = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert not [name for name, n in names.items() if n > 1]


def test_no_test_names_what_it_replaces_by_a_path():
    """`monkeypatch.setattr("gsid.module.name", ...)` breaks when a file moves, and hides a missing seam."""
    named = [
        f"{path.relative_to(TESTS)}:{call.lineno}"
        for path, tree in parsed().items()
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        and getattr(call.func, "attr", "") in ("setattr", "patch")
        and call.args
        and isinstance(call.args[0], ast.Constant)
        and str(call.args[0].value).startswith("gsid.")
    ]
    assert not named


def test_programs_obey_signals_that_the_tests_inherit_as_ignored(tmp_path):
    """Bug: in a background job of a shell, tests that end a program by SIGINT, SIGQUIT or SIGHUP failed."""
    ended = "import signal, sys; signal.raise_signal(int(sys.argv[1]))"
    (tmp_path / "test_signals.py").write_text(
        "import signal, subprocess, sys\n"
        f"ENDED = {ended!r}\n"
        "def test_programs_end():\n"
        "    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):\n"
        "        ended = subprocess.run([sys.executable, '-c', ENDED, str(number.value)])\n"
        "        assert ended.returncode == -number\n"
        "        signal.raise_signal(number)  # the tests themselves go on\n"
    )

    def ignore():
        for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)

    shutil.copy(TESTS / "conftest.py", tmp_path)
    result = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        preexec_fn=ignore,
    )
    assert result.returncode == 0, result.stdout


def test_bug_tests_of_one_group_ran_in_several_processes(tmp_path):
    """pytest-xdist 3.8 ignores its groups with pytest 9.2: tests that measure time ran beside each other."""
    (tmp_path / "test_groups.py").write_text(
        "import os, pathlib, pytest, time\n"
        "HERE = pathlib.Path(__file__).parent\n"
        "@pytest.mark.xdist_group('clock')\n"
        "@pytest.mark.parametrize('number', range(8))\n"
        "def test_process(number):\n"
        "    assert number in range(8)\n"
        "    time.sleep(0.1)  # the other process has time to take the next one\n"
        "    (HERE / f'{number}.txt').write_text(str(os.getpid()))\n"
    )
    parallel = ["-n", "2", "--dist", "loadgroup"]
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *parallel, tmp_path],
        cwd=tmp_path,
        check=True,
        capture_output=True,
    )
    processes = [path.read_text() for path in tmp_path.glob("*.txt")]
    assert len(processes) == 8
    assert len(set(processes)) == 1


def test_bug_ci_called_a_target_that_did_not_exist():
    root = TESTS.parent
    wanted = re.findall(r"^make (\S+)", (root / ".ci/run").read_text(encoding="utf-8"), re.MULTILINE)
    help_text = subprocess.run(["make", "help"], cwd=root, capture_output=True, text=True, check=True).stdout
    assert "test" in wanted
    assert set(wanted) <= set(re.findall(r"^  ([a-z-]+)", help_text, re.MULTILINE))
