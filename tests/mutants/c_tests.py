"""Builds and runs the C test programs that execute a line, in a copy of the repository."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from collections import defaultdict
from pathlib import Path

from bounded_run import run
from mutant import Mutant

PRECISIONS = ("double", "float")
COVERAGE = "-O0 --coverage"
MOST_S = 120.0  # of the programs that execute a line, the quickest first: so many seconds of them
SLACK_S, SLACK = 10, 5  # a program that takes so much longer is stopped, and counts as failed
PLAIN = "-O2"  # without -g: two sources that mean the same give the same object


class CTests:
    """The C test programs of a copy of the repository, and which of them execute which line.

    Parameters
    ----------
    tree : Path
        Copy of the repository; `make` builds in it.
    """

    def __init__(self, tree: Path) -> None:
        self.tree = tree
        self.seconds: dict[str, float] = {}
        self.programs: dict[str, dict[int, set[str]]] = {}

    def measure(self, folder: Path, files: list[str]) -> None:
        """Build all programs; find out which of them execute which line, once: that is kept in a folder.

        Parameters
        ----------
        folder : Path
        files : list of str
            To be mutated.
        """
        names = sorted(path.stem for path in (self.tree / "tests/c").glob("test_*.c"))
        self._make(PLAIN, "build", [one for name in names for one in _paths("build", name)])
        known = folder / "programs.json"
        if not known.is_file():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            lines = self._executed(folder, names, files)
            seconds = {one: self._timed(one) for name in names for one in _paths("build", name)}
            known.write_text(json.dumps({"lines": lines, "seconds": seconds}))
        self._keep_objects()
        found = json.loads(known.read_text())
        self.seconds = found["seconds"]
        self.programs = {
            file: {int(line): set(of) for line, of in lines.items()} for file, lines in found["lines"].items()
        }

    def _executed(self, folder: Path, names: list[str], files: list[str]) -> dict[str, dict[int, list[str]]]:
        """Of each file and line with code the test programs that execute it in double precision."""
        built = "build/coverage"
        first = {name: _paths(built, name)[0] for name in names}
        self._make(COVERAGE, built, list(first.values()))
        lines: dict[str, dict[int, list[str]]] = {file: defaultdict(list) for file in files}
        for name, program in first.items():
            counts = folder / name
            environment = {"GCOV_PREFIX": str(counts), "GSID_TEST_QUICK": "1"}
            run([self.tree / program], self.tree, folder / "log.txt", environment=environment)
            where = Path(f"{counts}{self.tree}") / built / "double/core"
            for data in sorted(where.glob("*.gcda")):
                shutil.copy(self.tree / built / "double/core" / f"{data.stem}.gcno", where)
                command = ["gcov", "--json-format", "--stdout", data.name]
                report = json.loads(
                    subprocess.run(command, cwd=where, capture_output=True, check=True).stdout
                )
                for one in report["files"]:
                    if one["file"] in lines:
                        for line in one["lines"]:
                            executing = lines[one["file"]][line["line_number"]]
                            if line["count"]:
                                executing.append(name)
            shutil.rmtree(counts)
        return lines

    def _timed(self, program: str) -> float:
        start = time.monotonic()
        if run([self.tree / program], self.tree, self.tree / "log.txt"):
            raise RuntimeError(f"{program} fails without any mutant: {(self.tree / 'log.txt').read_text()}")
        return time.monotonic() - start

    def covering(self, mutant: Mutant) -> list[str]:
        """Programs that execute the line of a mutant, in both precisions, the quickest first.

        A line without code, such as a constant table, is covered by all programs of the file.
        """
        lines = self.programs[mutant.file]
        names = lines[mutant.line] if mutant.line in lines else set().union(*lines.values())
        programs = [one for name in names for one in _paths("build", name)]
        chosen, total = [], 0.0
        for program in sorted(programs, key=lambda one: (self.seconds[one], one)):
            total += self.seconds[program]
            if chosen and total > MOST_S:
                break
            chosen.append(program)
        return chosen

    def judge(self, mutant: Mutant) -> tuple[str, str, int]:
        """Build and run the programs with a mutant in place.

        Returns
        -------
        status : {"killed", "survived", "uncovered", "same", "invalid"}
            "same": the compiler makes the same object of it; "invalid": it does not compile.
        by : str
            The program that found it.
        n_tests : int
            Programs chosen.
        """
        path = self.tree / mutant.file
        original = path.read_text(encoding="utf-8")
        path.write_text(mutant.text, encoding="utf-8")
        try:
            return self._judged(mutant)
        finally:
            path.write_text(original, encoding="utf-8")

    def _judged(self, mutant: Mutant) -> tuple[str, str, int]:
        name, build = f"{Path(mutant.file).stem}.o", self.tree / "build"
        if not self._make(PLAIN, "build", [f"build/{of}/core/{name}" for of in PRECISIONS], must=False):
            return "invalid", "", 0
        if all(
            (build / of / "core" / name).read_bytes() == (build / "original" / of / name).read_bytes()
            for of in PRECISIONS
        ):
            return "same", "", 0
        chosen = self.covering(mutant)
        for program in chosen:
            if not self._make(PLAIN, "build", [program], must=False):
                return "killed", f"{program} does not link", len(chosen)
            try:
                limit = SLACK_S + SLACK * self.seconds[program]
                code = run([self.tree / program], self.tree, self.tree / "log.txt", limit)
            except subprocess.TimeoutExpired:
                return "killed", f"{program}, time", len(chosen)
            if code:
                return "killed", program, len(chosen)
        return ("survived" if chosen else "uncovered"), "", len(chosen)

    def _keep_objects(self) -> None:
        """Objects of the core as the unchanged sources give them."""
        for precision in PRECISIONS:
            kept = self.tree / "build/original" / precision
            shutil.copytree(self.tree / "build" / precision / "core", kept, dirs_exist_ok=True)

    def _make(self, flags: str, build: str, targets: list[str], *, must: bool = True) -> bool:
        command = ["make", "-s", f"CFLAGS={flags}", f"BUILD={build}", *targets]
        good = run(command, self.tree, self.tree / "make.txt") == 0
        if must and not good:
            raise RuntimeError(f"make failed: {(self.tree / 'make.txt').read_text()}")
        return good


def _paths(build: str, name: str) -> list[str]:
    """A test's programs: one with the host library, else one in each precision."""
    if name.startswith("test_host_"):
        return [f"{build}/tests/{name}"]
    return [f"{build}/{precision}/tests/{name}" for precision in PRECISIONS]
