"""Seeded samples of mutants of the comparison, the grey-box fit, the diagnosis and the C core.

Which do the tests find? Each mutant is judged by the tests that execute its line (`python_tests`, `c_tests`),
in a copy of the repository; those of the diagnosis by its own tests. What is known is kept in a file of
results, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from threading import Lock
from types import ModuleType

import c_mutants
import mutants_page
import python_mutants
from c_tests import CTests
from mutant import Mutant
from python_tests import TESTS, PythonTests

ROOT = Path(__file__).parents[2]
SEED, SAMPLE = 20260322, 200
TARGETS = {
    "comparison": ["python/gsid/comparison.py"],
    "greybox": ["python/gsid/greybox/*.py"],
    "diagnosis": ["python/gsid/diagnosis/from_records/*.py", "python/gsid/diagnosis/missing_torque/*.py"],
    "core": ["src/core/*.c"],
}
TESTS_OF = {  # of a part with tests of its own
    "diagnosis": [
        "tests/first_stage",
        *(
            f"tests/python/test_{name}.py"
            for name in (
                "diagnose",
                "diagnosis_limits",
                "fingerprints",
                "hold_check",
                "missing_torque",
                "ringing",
                "rounds",
            )
        ),
    ],
}
COUNTED = ("killed", "survived", "uncovered")  # not: "same" as the source, or "invalid"


def sources(target: str) -> list[str]:
    """Files of a target, as paths in the repository."""
    return sorted(str(path.relative_to(ROOT)) for glob in TARGETS[target] for path in ROOT.glob(glob))


def drawn(target: str, seed: int) -> list[Mutant]:
    """All mutants of a target in an order drawn from a seed.

    The place of a mutant depends on its own line only, so that an edit elsewhere leaves the sample as it is.
    """
    placed: list[tuple[float, Mutant]] = []
    for file in sources(target):
        made = numbered(tools_of(file).mutants(file, (ROOT / file).read_text(encoding="utf-8")))
        placed += [(random.Random(f"{seed} {target} {one.name}").random(), one) for one in made]
    return [one for _, one in sorted(placed, key=lambda pair: pair[0])]


def tools_of(file: str) -> ModuleType:
    """What makes the mutants of a file's language, and knows which texts mean the same in it."""
    return python_mutants if file.endswith(".py") else c_mutants


def numbered(mutants: Iterable[Mutant]) -> Iterator[Mutant]:
    """Equal changes of equal lines, distinguished by a number."""
    known: Counter[str] = Counter()
    for one in mutants:
        known[one.name] += 1
        yield replace(one, number=known[one.name])


def copied(folder: Path) -> Path:
    """The repository as it stands, with its compiled modules, in a folder of its own."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True)
    modules = [str(path.relative_to(ROOT)) for path in (ROOT / "python/gsid").glob("*.so")]
    names = [*listed.stdout.split("\0")[:-1], *modules]
    _without_others(folder, {folder / name for name in names})
    for name in names:
        source, target = ROOT / name, folder / name
        if source.is_file() and not (target.is_file() and target.read_bytes() == source.read_bytes()):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    (folder / "build").mkdir(exist_ok=True)
    for name in ("blind", "firmware"):  # programs that tests run
        if (ROOT / "build" / name).is_dir() and not (folder / "build" / name).exists():
            (folder / "build" / name).symlink_to(ROOT / "build" / name)
    if not (folder / ".venv").exists():
        (folder / ".venv").symlink_to(ROOT / ".venv")
    for name in ("with.txt", "setup.stamp"):  # what `make` installs is installed
        shutil.copy(ROOT / "build" / name, folder / "build" / name)
    return folder


def _without_others(folder: Path, kept: set[Path]) -> None:
    """Remove sources of an earlier state: the Makefile compiles all that it finds."""
    for here, folders, files in os.walk(folder):
        folders[:] = [one for one in folders if Path(here) != folder or one not in ("build", ".venv")]
        for name in files:
            if Path(here) / name not in kept:
                (Path(here) / name).unlink()


class Results:
    """Lines of JSON, one for each mutant judged; those of other versions of a source do not count.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self.path, self._lock = path, Lock()
        self._versions = {file: version(file) for target in TARGETS for file in sources(target)}
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        known = [json.loads(line) for line in lines]
        self.known = {
            (one["target"], one["id"]): one
            for one in known
            if self._versions.get(one["file"]) == one["version"]
        }

    def get(self, target: str, mutant: Mutant) -> dict | None:
        """What is known of a mutant."""
        found = self.known.get((target, mutant.name))
        return found and found | {"line": mutant.line}

    def add(self, target: str, mutant: Mutant, status: str, by: str, n_tests: int, seconds: float) -> dict:
        """Keep what came out."""
        one = {
            "target": target,
            "id": mutant.name,
            "version": self._versions[mutant.file],
            "file": mutant.file,
            "line": mutant.line,
            "operator": mutant.operator,
            "before": mutant.before,
            "after": mutant.after,
            "key": mutant.key,
            "status": status,
            "by": by,
            "n_tests": n_tests,
            "seconds": round(seconds, 1),
        }
        with self._lock, self.path.open("a", encoding="utf-8") as out:
            out.write(json.dumps(one) + "\n")
            self.known[target, one["id"]] = one
        return one


def version(file: str) -> str:
    """Of the program that a source stands for: comments do not count."""
    meaning = tools_of(file).meaning((ROOT / file).read_text(encoding="utf-8"))
    return hashlib.sha256(str(meaning).encode()).hexdigest()[:16]


def run(
    target: str, mutants: list[Mutant], n: int, judges: list, results: Results, until: float
) -> list[dict]:
    """The first `n` mutants in the order drawn that count, as far as they are judged within the time."""
    free: SimpleQueue = SimpleQueue()
    for judge in judges:
        free.put(judge)

    def judged(mutant: Mutant) -> dict | None:
        found = results.get(target, mutant)
        if found is None and time.monotonic() < until:
            judge, start = free.get(), time.monotonic()
            try:
                found = results.add(target, mutant, *judge.judge(mutant), time.monotonic() - start)
            finally:
                free.put(judge)
            print(
                f"{target}: {found['status']:9} {found['file']}:{found['line']} {found['by']}",
                file=sys.stderr,
            )
        return found

    counted: list[dict] = []
    with ThreadPoolExecutor(max(len(judges), 1)) as pool:
        at = 0
        while at < len(mutants) and len(counted) < n:
            batch = mutants[at : at + max(2 * len(judges), 1)]
            at += len(batch)
            counted += [one for one in pool.map(judged, batch) if one and one["status"] in COUNTED]
    return counted[:n]


def judges_of(target: str, folder: Path, n: int, tests: list[str]) -> list:
    """One judge for each copy of the repository.

    What covers a line is measured once for each version of the sources and of the tests.
    """
    in_c, tests = target == "core", TESTS_OF.get(target, tests)
    alike = [each for each in TARGETS if (each == "core", TESTS_OF.get(each)) == (in_c, TESTS_OF.get(target))]
    files = sorted({file for each in alike for file in sources(each)})
    version = digest(files, ["tests/c"] if in_c else tests)
    made = []
    for i in range(n):
        tree = copied(folder / f"tree{i}")
        if in_c:
            judge = CTests(tree)
            judge.measure(folder / f"programs-{version}", files)
        else:
            judge = PythonTests(tree, folder / "packages")
            judge.measure(folder / f"coverage-{version}", files, tests)
        made.append(judge)
    return made


def digest(files: list[str], tests: list[str]) -> str:
    """Of these files, and of these tests or all files in these folders of tests."""
    found = {path for name in tests for path in (ROOT / name.partition("::")[0], *(ROOT / name).rglob("*"))}
    every = [ROOT / file for file in files] + sorted(
        path for path in found if path.suffix in (".py", ".c", ".h")
    )
    return hashlib.sha256(b"".join(path.read_bytes() for path in every)).hexdigest()[:8]


def _commit() -> str:
    command = ["git", "describe", "--always", "--dirty=+"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout.strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=SAMPLE, help="mutants of each target")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--target", action="append", choices=TARGETS, help="default: all")
    parser.add_argument("--minutes", type=float, default=120, help="no mutant is begun after so many")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--tests", nargs="+", default=TESTS, help="files or folders of Python tests")
    parser.add_argument("--folder", type=Path, default=ROOT / "build/mutants")
    parser.add_argument("--page", type=Path, help="write this page")
    arguments = parser.parse_args()
    until = time.monotonic() + 60 * arguments.minutes
    arguments.folder.mkdir(parents=True, exist_ok=True)
    results = Results(arguments.folder / "results.jsonl")
    found = {}
    for target in arguments.target or TARGETS:
        mutants = drawn(target, arguments.seed)  # before the copies: sources may change meanwhile
        is_over = time.monotonic() >= until  # then the page is made of what is known
        judges = (
            [] if is_over else judges_of(target, arguments.folder.resolve(), arguments.jobs, arguments.tests)
        )
        found[target] = run(target, mutants, arguments.n, judges, results, until)
        print(f"{target}: {dict(Counter(one['status'] for one in found[target]))}", file=sys.stderr)
    if arguments.page:
        known = arguments.page.read_text(encoding="utf-8") if arguments.page.is_file() else ""
        text = mutants_page.text(known, found, arguments.seed, arguments.n, _commit())
        arguments.page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
