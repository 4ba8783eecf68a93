"""Runs the Python tests that cover a line, in a copy of the repository."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

from bounded_run import run
from mutant import Mutant
from python_mutants import assigned, lines_that_use, statement_lines

MOST_S = 60.0  # of the tests that cover a line, the quickest first: so many seconds of them
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
        self.setups: dict[str, float] = {}
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
        data, times = folder / "coverage", folder / "durations.jsonl"
        if not times.is_file():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            settings = folder / "settings.ini"  # coverage erases coverage.*
            settings.write_text(
                f"[run]\ndata_file = {data}\ninclude =\n" + "".join(f"    {f}\n" for f in files)
            )
            running = folder / "running.jsonl"
            options = ["--cov", "--cov-context=test", f"--cov-config={settings}", "--cov-report="]
            options += ["-n", "auto", "--dist", "loadgroup", "-p", "durations", f"--durations-file={running}"]
            self._pytest([*options, *tests], folder / "log.txt", None)
            running.rename(times)
        self._read(data, times, files)

    def _read(self, data: Path, times: Path, files: list[str]) -> None:
        from coverage import CoverageData

        good: dict[str, bool] = defaultdict(lambda: True)
        for one in map(json.loads, times.read_text().splitlines()):
            name, file = one["test"], one["test"].partition("::")[0]
            good[name] &= one["outcome"] == "passed"
            if one["when"] == "call":
                self.durations[name] = one["seconds"]
            else:
                self.setups[file] = max(self.setups.get(file, 0.0), one["seconds"])
        self.durations = {name: seconds for name, seconds in self.durations.items() if good[name]}
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
            test, _, phase = context.rpartition("|")
            name = test.partition("@")[0]  # what follows is a group of xdist's
            found |= {name} & self.durations.keys() if phase == "run" else of_file[name.partition("::")[0]]
        return found

    def covering(self, mutant: Mutant) -> list[str]:
        """Tests that run the statement of a mutant, the quickest first, up to `MOST_S` in all.

        A constant runs at import: the tests that run a line with its name cover it. Other statements that
        run at import are covered by all tests of the file.
        """
        text = self._text(mutant.file)
        lines = statement_lines(text, mutant.line)
        names = assigned(text, mutant.line)
        found = self._running(mutant.file, lines)
        if not found and names:
            found = set().union(*(self._using(file, names) for file in self.contexts))
        return self._quickest(found or self._importing(mutant.file, lines))

    def _text(self, file: str) -> str:
        return (self.tree / file).read_text(encoding="utf-8")

    def _running(self, file: str, lines: range) -> set[str]:
        """Tests that run any of these lines."""
        return set().union(*(self.contexts[file].get(line, set()) for line in lines))

    def _importing(self, file: str, lines: range) -> set[str]:
        """All tests of a file, if these lines run at its import."""
        known = self.contexts[file]
        return set().union(*known.values()) if any(line in known for line in lines) else set()

    def _using(self, file: str, names: set[str]) -> set[str]:
        """Tests that run a line of a file with any of these names."""
        text = self._text(file)
        places = [statement_lines(text, line) for line in lines_that_use(text, names)]
        return set().union(*(self._running(file, one) or self._importing(file, one) for one in places))

    def _quickest(self, names: set[str]) -> list[str]:
        """Tests in the order of their time with the longest setup of their file, which is needed once."""

        def needs(name: str) -> float:
            return self.durations[name] + self.setups[name.partition("::")[0]]

        chosen: list[str] = []
        for name in sorted(names, key=lambda one: (needs(one), one)):
            if chosen and self._total([*chosen, name]) > MOST_S:
                break
            chosen.append(name)
        return chosen

    def _total(self, names: list[str]) -> float:
        """Seconds that tests take together."""
        files = {name.partition("::")[0] for name in names}
        return sum(self.durations[name] for name in names) + sum(self.setups[file] for file in files)

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
        limit = LIMIT_LEAST_S + SLACK * self._total(chosen)
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
        paths = os.pathsep.join(map(str, [self.tree / "python", self.packages, Path(__file__).parent]))
        # Without files of bytecode: one of a mutant could be taken for that of the next.
        environment = {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        return run(command, self.tree, log, limit_s, environment)
