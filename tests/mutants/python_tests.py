"""Runs the Python tests that cover a line, in a copy of the repository."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from pathlib import Path

from bounded_run import run
from mutant import Mutant
from python_mutants import statement_lines

MOST_S = 120.0  # of the tests that cover a line, the quickest first: so many seconds of them
LIMIT_LEAST_S, SLACK = 30, 4  # a mutant that takes so many times as long is stopped, and counts as found
TESTS = ["tests/python", "tests/cli"]


class PythonTests:
    """The tests of a copy of the repository, and which of them run which line.

    Parameters
    ----------
    tree : Path
        Copy of the repository, with its compiled modules.
    packages : Path
        Folder of the packages of requirements.txt.
    """

    def __init__(self, tree: Path, packages: Path) -> None:
        self.tree, self.packages = tree, packages
        self.durations: dict[str, float] = {}
        self.contexts: dict[str, dict[int, set[str]]] = {}

    def measure(self, folder: Path, files: list[str], tests: list[str]) -> None:
        """Find out which tests run which line, once: the answer is kept in a folder.

        Parameters
        ----------
        folder : Path
        files : list of str
            To be mutated.
        tests : list of str
            Paths of tests.
        """
        data, times = folder / "coverage", folder / "durations.xml"
        if not times.is_file():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            settings = folder / "settings.ini"  # coverage erases coverage.*
            settings.write_text(
                f"[run]\ndata_file = {data}\ninclude =\n" + "".join(f"    {f}\n" for f in files)
            )
            running = folder / "running.xml"
            options = ["--cov", "--cov-context=test", f"--cov-config={settings}", "--cov-report="]
            options += ["-n", "auto", "--dist", "loadgroup", f"--junitxml={running}"]
            self._pytest([*options, *tests], folder / "log.txt", None)
            running.rename(times)
        self._read(data, times, files)

    def _read(self, data: Path, times: Path, files: list[str]) -> None:
        from coverage import CoverageData

        for case in ElementTree.parse(times).iter("testcase"):
            name = f"{case.get('classname').replace('.', '/')}.py::{case.get('name')}"
            if case.find("failure") is None and case.find("skipped") is None and case.find("error") is None:
                self.durations[name] = float(case.get("time"))
        of_file = defaultdict(set)
        for name in self.durations:
            of_file[name.partition("::")[0]].add(name)
        covered = CoverageData(str(data))
        covered.read()
        for file in files:
            measured = next((one for one in covered.measured_files() if one.endswith(f"/{file}")), file)
            lines = covered.contexts_by_lineno(measured)
            self.contexts[file] = {line: self._tests_of(found, of_file) for line, found in lines.items()}

    def _tests_of(self, contexts: list[str], of_file: dict[str, set[str]]) -> set[str]:
        """What a fixture of a test runs counts for its whole file: another test may have used it before."""
        found = set()
        for context in contexts:
            name, _, phase = context.rpartition("|")
            found |= {name} & self.durations.keys() if phase == "run" else of_file[name.partition("::")[0]]
        return found

    def covering(self, mutant: Mutant) -> list[str]:
        """Tests that run the statement of a mutant, the quickest first, up to `MOST_S` in all.

        What runs at import, such as a constant, is covered by all tests of the file.
        """
        lines = self.contexts[mutant.file]
        text = (self.tree / mutant.file).read_text(encoding="utf-8")
        found = set().union(*(lines.get(line, set()) for line in statement_lines(text, mutant.line)))
        if not found and any(line in lines for line in statement_lines(text, mutant.line)):
            found = set().union(*lines.values())
        chosen, total = [], 0.0
        for name in sorted(found, key=lambda one: (self.durations[one], one)):
            total += self.durations[name]
            if chosen and total > MOST_S:
                break
            chosen.append(name)
        return chosen

    def judge(self, mutant: Mutant) -> tuple[str, str, int]:
        """Run the tests with a mutant in place.

        Returns
        -------
        status : {"killed", "survived", "uncovered"}
        by : str
            The test that found it.
        n_tests : int
            Tests chosen.
        """
        chosen = self.covering(mutant)
        if not chosen:
            return "uncovered", "", 0
        path = self.tree / mutant.file
        original = path.read_text(encoding="utf-8")
        names = self.tree / "chosen.txt"
        names.write_text("\n".join(chosen) + "\n")
        limit = LIMIT_LEAST_S + SLACK * sum(self.durations[name] for name in chosen)
        path.write_text(mutant.text, encoding="utf-8")
        try:
            code = self._pytest(["-x", f"@{names}"], self.tree / "log.txt", limit)
        except subprocess.TimeoutExpired:
            return "killed", "time", len(chosen)
        finally:
            path.write_text(original, encoding="utf-8")
        if code == 0:
            return "survived", "", len(chosen)
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", (self.tree / "log.txt").read_text(), re.M)
        return "killed", failed[1] if failed else f"exit code {code}", len(chosen)

    def _pytest(self, arguments: list[str], log: Path, limit_s: float | None) -> int:
        paths = os.pathsep.join(map(str, [self.tree / "python", self.packages]))
        # Without files of bytecode: one of a mutant could be taken for that of the next.
        environment = {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        return run(command, self.tree, log, limit_s, environment)
