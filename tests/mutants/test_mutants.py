"""The tool itself: which mutants it makes, and how it judges those of a small project."""

import subprocess
import sys
from pathlib import Path

import mutants_page
import pytest
from bounded_run import run
from mutant import Mutant

NEEDED = "`make mutants` installs what its own tests need"
pytest.importorskip("pytest_cov", reason=NEEDED)
c_mutants, python_mutants, python_tests, run_mutants = (
    pytest.importorskip(name, reason=NEEDED)
    for name in ("c_mutants", "python_mutants", "python_tests", "run_mutants")
)
PACKAGES = Path(__file__).parents[2] / "build/mutants/packages"
LAW = """from __future__ import annotations

WIDTH = 3


def law(x: float | None) -> float | None:
    if x < WIDTH and not x == 0:
        return 2 * x
    return -x


def spare(x):
    return x + 1
"""
SETTINGS = """from dataclasses import dataclass


@dataclass
class Settings:
    limit: float = 1.5
    spare: float = 1.5


SETTINGS = Settings()
"""
USE = """from settings import SETTINGS


def is_large(x):
    return x > SETTINGS.limit


def is_huge(x):
    return x > 10 * SETTINGS.spare
"""
TESTS = """from law import law


def test_law():
    assert law(2) == 4
    assert law(5) == -5
"""


def test_the_mutants_of_python_leave_annotations_alone():
    made = {(one.line, one.after) for one in python_mutants.mutants("law.py", LAW)}
    for expected in (
        (3, "WIDTH = 4"),
        (7, "if x <= WIDTH and not x == 0:"),
        (7, "if x >= WIDTH and not x == 0:"),
        (7, "if x < WIDTH or not x == 0:"),
        (8, "return 2 / x"),
        (9, "return x"),
    ):
        assert expected in {(line, " ".join(after.split())) for line, after in made}
    assert not [line for line, _ in made if line == 6]


def test_bug_an_exception_with_a_dotted_name_ended_the_run():
    text = "def f(x):\n    try:\n        return x + 1\n    except np.linalg.LinAlgError:\n        return 0\n"
    assert "return x - 1" in {one.after for one in python_mutants.mutants("f.py", text)}


def test_the_mutants_of_c():
    source = "int f(int a) {\n    if (a < 2)\n        a += 1;\n    g(a);\n    return a ? a : -1;\n}\n"
    made = {(one.line, one.after) for one in c_mutants.mutants("f.c", source)}
    assert made == {
        (2, "if (a <= 2)"),
        (2, "if (a >= 2)"),
        (2, "if (a < 3)"),
        (2, "if (a < 1)"),
        (2, "if (!(a < 2))"),
        (3, "a -= 1;"),
        (3, "a += 2;"),
        (3, "a += 0;"),
        (4, ";"),
        (5, "return (a);"),
        (5, "return (-1);"),
        (5, "return a ? a : 0;"),
        (5, "return a ? a : -2;"),
    }


def project_in(folder, tests):
    """One module and its test, with the lines that the test executes."""
    for name, text in (("python/law.py", LAW), ("tests/test_law.py", tests)):
        path = folder / "tree" / name
        path.parent.mkdir(parents=True)
        path.write_text(text)
    found = python_tests.PythonTests(folder / "tree", PACKAGES)
    found.measure(folder / "coverage", ["python/law.py"], ["tests"])
    return found


@pytest.fixture
def project(tmp_path):
    return project_in(tmp_path, TESTS)


@pytest.mark.parametrize(
    ("old", "new", "status"),
    [
        ("return 2 * x", "return 2 / x", "killed"),
        ("return 2 * x", "return 2 * x + 0", "survived"),
        ("return x + 1", "return x - 1", "uncovered"),
        ("WIDTH = 3", "WIDTH = 1", "killed"),  # executed at import, and used by the test
        ("return 2 * x", "while True: pass", "killed"),
    ],
)
def test_a_mutant_is_judged_by_the_tests_of_its_line(project, monkeypatch, old, new, status):
    monkeypatch.setattr(python_tests, "LIMIT_LEAST_S", 5 if "while" in new else 300)
    line = LAW[: LAW.index(old)].count("\n") + 1
    mutant = Mutant.of("python/law.py", line, "by hand", LAW, LAW.replace(old, new))
    assert project.judge(mutant)[0] == status
    assert (project.tree / "python/law.py").read_text() == LAW


def test_bug_tests_of_a_group_judged_no_mutant(tmp_path):
    """The name of a test then ends with that of the group."""
    group = 'import pytest\n\npytestmark = pytest.mark.xdist_group("law")\n'
    project = project_in(tmp_path, group + TESTS)
    line = LAW[: LAW.index("return 2 * x")].count("\n") + 1
    mutant = Mutant.of("python/law.py", line, "by hand", LAW, LAW.replace("2 * x", "2 / x"))
    assert project.covering(mutant) == ["tests/test_law.py::test_law"]
    assert project.judge(mutant)[0] == "killed"


def test_a_constant_is_judged_by_the_tests_of_the_lines_that_use_it(tmp_path):
    """A file of constants runs at import alone: none of its mutants was covered."""
    test = "from use import is_large\n\n\ndef test_is_large():\n    assert not is_large(1)\n"
    files = {"python/settings.py": SETTINGS, "python/use.py": USE, "tests/test_use.py": test}
    for name, text in files.items():
        path = tmp_path / "tree" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    tests = python_tests.PythonTests(tmp_path / "tree", PACKAGES)
    tests.measure(tmp_path / "coverage", ["python/settings.py", "python/use.py"], ["tests"])

    def judged(name, value):
        old = f"{name}: float = 1.5"
        line = SETTINGS[: SETTINGS.index(old)].count("\n") + 1
        new = SETTINGS.replace(old, f"{name}: float = {value}")
        return tests.judge(Mutant.of("python/settings.py", line, "by hand", SETTINGS, new))

    assert judged("limit", 0.5) == ("killed", "tests/test_use.py::test_is_large", 1)
    assert judged("limit", 2.5) == ("survived", "", 1)
    assert judged("spare", 0.5) == ("uncovered", "", 0)


def test_what_a_file_sets_up_counts_once(project, monkeypatch):
    """A quick test behind a slow fixture came first: it took as long as all others together."""
    project.durations = {"a.py::slow": 9.0, "a.py::quick": 0.1, "b.py::one": 1.0, "b.py::other": 2.0}
    project.setups = {"a.py": 30.0, "b.py": 0.5}
    names = project.durations.keys()
    assert project._quickest(names) == ["b.py::one", "b.py::other", "a.py::quick", "a.py::slow"]
    monkeypatch.setattr(python_tests, "MOST_S", 35.0)
    assert project._quickest(names) == ["b.py::one", "b.py::other", "a.py::quick"]


def test_each_part_has_sources():
    """A part whose files have moved would be judged as found whole."""
    for part in run_mutants.TARGETS:
        assert run_mutants.sources(part), part
    for files in (*run_mutants.TARGETS.values(), *run_mutants.TESTS_OF.values()):
        for file in files:
            assert list(run_mutants.ROOT.glob(file.partition("::")[0])), file


def test_a_part_with_tests_of_its_own_is_judged_by_them():
    assert run_mutants.TESTS_OF.keys() <= run_mutants.TARGETS.keys()


def test_the_page_has_each_mutant_that_was_not_found():
    one = {"file": "a.c", "line": 7, "before": "a || b", "after": "a && b", "key": "a.c: a || b => a && b"}
    found = [one | {"status": status} for status in ("killed", "survived", "uncovered")]
    page = mutants_page.text("", {"core": found, "comparison": []}, 7, 200, "abc1234")
    assert "| core | abc1234 | 3 | 1 | 2 | 6 % to 79 % |" in page  # Wilson
    assert "| comparison | abc1234 | 0 | 0 | 0 |  |" in page
    assert "| a.c:7 | `a \\|\\| b` → `a && b` | not looked into yet |" in page
    assert "| a.c:7 | `a \\|\\| b` → `a && b` | no test executes the line |" in page


def test_the_parts_that_were_not_judged_stay_as_they_are():
    def survivor(before):
        return {"file": "a.c", "line": 7, "before": before, "after": "", "key": "", "status": "survived"}

    first = mutants_page.text("", {"core": [survivor("a;")], "greybox": [survivor("b;")]}, 7, 200, "abc1234")
    page = mutants_page.text(first, {"core": []}, 7, 200, "def5678")
    rows = [line for line in page.splitlines() if line.startswith(("| core", "| greybox"))]
    assert rows == ["| core | def5678 | 0 | 0 | 0 |  |", "| greybox | abc1234 | 1 | 0 | 1 | 0 % to 79 % |"]
    assert "`a;`" not in page
    assert "`b;`" in page
    assert page.index("## Core") < page.index("## Greybox")
    assert mutants_page.text(page, {}, 7, 200, "0") == page


def test_a_run_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    """What is known is not judged again; of a source that has changed everything is."""
    monkeypatch.setattr(run_mutants, "ROOT", tmp_path)
    monkeypatch.setattr(run_mutants, "TARGETS", {"law": ["law.py"]})
    (tmp_path / "law.py").write_text(LAW)
    judged = []

    class Judge:
        def judge(self, mutant):
            judged.append(mutant.after)
            return "survived", "", 1

    def again(n, until=float("inf")):
        results = run_mutants.Results(tmp_path / "results.jsonl")
        return run_mutants.run("law", run_mutants.drawn("law", 7), n, [Judge()], results, until)

    assert again(4, until=0.0) == []  # no time
    first = again(4)
    assert len(first) == 4
    assert len(again(4)) == len(judged) == 4
    six = again(6)
    assert six[:4] == first
    assert len(judged) == 6
    (tmp_path / "law.py").write_text('"""Doc."""  # and a comment\n' + LAW)
    assert again(6) == [one | {"line": one["line"] + 1} for one in six]
    assert len(judged) == 6
    (tmp_path / "law.py").write_text(LAW.replace("spare", "other"))
    again(4)
    assert len(judged) == 10


def test_new_tests_are_measured(tmp_path, monkeypatch):
    """A bug: what covers a line was not measured again; a test that has gone counted as one that failed."""
    monkeypatch.setattr(run_mutants, "ROOT", tmp_path)
    for name, text in (("law.py", LAW), ("tests/test_law.py", TESTS)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)

    def of(*tests):
        return run_mutants.digest(["law.py"], list(tests))

    before = of("tests")
    assert before == of("tests") == of("tests/test_law.py::test_law")
    (tmp_path / "tests/test_law.py").write_text(TESTS.replace("test_law()", "test_other()"))
    renamed = of("tests")
    (tmp_path / "tests/helper.py").write_text("")
    (tmp_path / "law.py").write_text(LAW + "\n")
    assert len({before, renamed, of("tests")}) == 3


def test_an_edit_elsewhere_leaves_the_sample_as_it_is(tmp_path, monkeypatch):
    """Of 200 mutants drawn again after an edit of one line those of the other lines are drawn again."""
    monkeypatch.setattr(run_mutants, "ROOT", tmp_path)
    monkeypatch.setattr(run_mutants, "TARGETS", {"law": ["law.py"]})

    def drawn(text):
        (tmp_path / "law.py").write_text(text)
        return [one.name for one in run_mutants.drawn("law", 7) if "spare" not in one.before]

    before = drawn(LAW)
    after = drawn("FURTHER = 5\n" + LAW)
    assert len(set(before)) == len(before) > 10
    assert [name for name in after if "FURTHER" not in name] == before


def test_comments_do_not_change_the_meaning_of_c():
    assert c_mutants.meaning("int a; /* b */\n\n  int c; // d\n") == c_mutants.meaning("int a;int c;")
    assert c_mutants.meaning("int a;") != c_mutants.meaning("int b;")


def test_what_a_stopped_command_started_is_ended(tmp_path):
    code = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(60)'])"
    with pytest.raises(subprocess.TimeoutExpired):
        run([sys.executable, "-c", code], tmp_path, tmp_path / "log.txt", 1.0)
    assert run([sys.executable, "-c", "raise SystemExit(3)"], tmp_path, tmp_path / "log.txt", 60.0) == 3
