"""Studies of false alarms: how often a test rejects what is right, counted over many simulated experiments.

A study is one file of this folder. The file NAME.py holds

    STUDY = Study(
        name="NAME",                               # of this file, its results and its block in the page
        title="What the test claims",              # heading of its block
        about="What is simulated, and what is right there.",
        cells=(Cell("8 periods, 20 lines", {"periods": 8, "lines": 20}), ...),
        run=run,
        levels=(0.01, 0.05),                       # nominal false-alarm rates
        n_seeds=1000,                              # of each cell, `make false-alarms`
        n_short=40,                                # of each cell, `make test-long`
    )

and the experiment, a function at module level (it runs in other processes):

    def run(cell: Cell, seed: int) -> float | dict[str, float | bool]:
        rng = cell.rng(seed)                       # independent of every other cell and seed
        ... = cell.setting["periods"]
        return p_value

It returns one p-value, or several outcomes by name. A p-value (a float) is counted as a rejection at each
nominal level it does not exceed; an event (a bool) is counted as it is. Events of `never` must not happen at
all, other events are counted and not judged. `run_studies.py` finds the file, `make false-alarms STUDY=NAME`
runs it, and `make test-long` runs the first `n_short` seeds of a cell. The page needs a block of that name.

Each rate has its Clopper-Pearson interval: a cell is met when its 99.9 % interval (`Study.confidence`)
contains the nominal level, and all cells together when the 95 % interval of the pooled rate does.
"""

from __future__ import annotations

import importlib
import json
import subprocess
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

HERE = Path(__file__).parent
FIRST_SEED = 1
N_PROCESSES = 2
CELL_CONFIDENCE = 0.999
POOLED_CONFIDENCE = 0.95
POOLED = "all cells"


@dataclass(frozen=True)
class Cell:
    """One setting of the experiment.

    Attributes
    ----------
    name : str
        Unique within the study. The random numbers depend on it.
    setting : Any
        What `run` needs.
    at_most : bool
        The test only promises a rate no larger than the nominal one here. Such a cell is not pooled.
    judged : bool
        False where the records are not what the test assumes: the rate is shown, not judged, and not pooled.
    """

    name: str
    setting: Any = None
    at_most: bool = False
    judged: bool = True

    @property
    def pooled(self) -> bool:
        """Whether it counts in the pooled rate."""
        return self.judged and not self.at_most

    def rng(self, seed: int) -> np.random.Generator:
        """Random numbers of one experiment, independent of those of other cells and seeds."""
        return np.random.default_rng([zlib.crc32(self.name.encode()), seed])


Outcome = dict[str, float | bool]


@dataclass(frozen=True)
class Study:
    """A test, the cells it is tried in, and the levels it claims; see the top of this file.

    Attributes
    ----------
    window : (float, float) or None
        Rates as multiples of the nominal level within which each cell must lie too, once it has all its
        seeds: few ones scatter more.
    pooled : bool
        Whether cells are judged together too: the pooled rate needs independent experiments.
    never : tuple of str
        Events that must not happen.
    batch : int
        Experiments that a process takes at a time; 1 where one experiment takes seconds.
    """

    name: str
    title: str
    about: str
    cells: tuple[Cell, ...]
    run: Callable[[Cell, int], float | Outcome]
    levels: tuple[float, ...]
    n_seeds: int
    n_short: int
    confidence: float = CELL_CONFIDENCE
    window: tuple[float, float] | None = None
    pooled: bool = True
    never: tuple[str, ...] = ()
    batch: int = 8

    def __post_init__(self) -> None:
        names = [cell.name for cell in self.cells]
        if len(set(names)) < len(names):
            raise ValueError(f"{self.name} has two cells of one name")


def studies() -> dict[str, Study]:
    """All studies of this folder, by name."""
    other = {"study", "run_studies", "conftest"}
    names = sorted(
        path.stem
        for path in HERE.glob("*.py")
        if path.stem not in other and not path.stem.startswith("test_")
    )
    return {name: importlib.import_module(name).STUDY for name in names}


# ---- running -----------------------------------------------------------------------------------------------


def experiment(study: Study, cell: Cell, seed: int) -> Outcome:
    """Run one experiment; a lone p-value is named p_value."""
    outcome = study.run(cell, seed)
    if not isinstance(outcome, dict):
        outcome = {"p_value": outcome}
    plain = {name: value.item() if hasattr(value, "item") else value for name, value in outcome.items()}
    for name, value in plain.items():
        if not isinstance(value, bool) and not 0 <= value <= 1:
            raise ValueError(f"{study.name}, {cell.name}, seed {seed}: {name} is {value}, not a p-value")
    return plain


def _one(task: tuple[str, int, int]) -> tuple[int, int, Outcome]:
    name, i, seed = task
    study = importlib.import_module(name).STUDY
    return i, seed, experiment(study, study.cells[i], seed)


@dataclass
class Results:
    """Outcomes of a study, one JSON line per finished experiment, so that a run that was cut goes on."""

    path: Path
    outcomes: dict[tuple[str, int], Outcome] = field(default_factory=dict)
    commits: list[str] = field(default_factory=list)

    @classmethod
    def load(cls, path: Path) -> Results:
        """Read what there is; a last line that was cut is removed from the file."""
        results = cls(path)
        text = path.read_text() if path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            path.write_text(whole)
        for line in whole.splitlines():
            results._keep(json.loads(line))
        return results

    def _keep(self, line: dict) -> None:
        self.outcomes[line["cell"], line["seed"]] = line["outcome"]
        if line["commit"] not in self.commits:
            self.commits.append(line["commit"])

    def append(self, cell: str, seed: int, outcome: Outcome, commit: str) -> None:
        """Add an experiment to the file."""
        line = {"cell": cell, "seed": seed, "outcome": outcome, "commit": commit}
        with open(self.path, "a") as file:
            file.write(json.dumps(line) + "\n")
        self._keep(line)


def run(study: Study, path: Path, n_seeds: int, on_done: Callable[[int, int], None]) -> Results:
    """Run the experiments that the file does not hold yet, in two processes.

    `on_done` gets the numbers of finished and of all experiments.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    results, commit = Results.load(path), current_commit()
    seeds = range(FIRST_SEED, FIRST_SEED + n_seeds)
    # Seed by seed, so that a run that was cut has all cells.
    tasks = [
        (study.name, i, seed)
        for seed in seeds
        for i, cell in enumerate(study.cells)
        if (cell.name, seed) not in results.outcomes
    ]
    n_all = len(study.cells) * n_seeds
    with ProcessPoolExecutor(N_PROCESSES) as pool:
        try:
            done = pool.map(_one, tasks, chunksize=study.batch)
            for n, (i, seed, outcome) in enumerate(done, n_all - len(tasks) + 1):
                results.append(study.cells[i].name, seed, outcome, commit)
                on_done(n, n_all)
        finally:
            pool.shutdown(cancel_futures=True)
    return results


def current_commit() -> str:
    """Name of the code that is run, "+" where it differs from the commit."""
    command = ["git", "-C", str(HERE), "describe", "--always", "--dirty=+", "--exclude=*"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


# ---- counting ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rate:
    """How often an outcome came, with its Clopper-Pearson interval.

    Attributes
    ----------
    cell, outcome : str
    level : float or None
        Nominal; None for an event.
    n, hits : int
    low, high : float
        Interval of the rate.
    met : bool or None
        Whether it is what it should be; None where nothing is required.
    at_most : bool
        The level is a bound.
    """

    cell: str
    outcome: str
    level: float | None
    n: int
    hits: int
    low: float
    high: float
    met: bool | None
    at_most: bool = False

    @property
    def rate(self) -> float:
        return self.hits / self.n


def rates(study: Study, outcomes: dict[tuple[str, int], Outcome], n_seeds: int | None = None) -> list[Rate]:
    """Count the first seeds (default: all) of every cell, then all cells together."""
    last = FIRST_SEED + n_seeds - 1 if n_seeds else np.inf
    parts = [
        (cell, [out for (name, seed), out in outcomes.items() if name == cell.name and seed <= last])
        for cell in study.cells
    ]
    found = [rate for cell, part in parts for rate in _rates(study, cell, part, study.confidence)]
    pool = [out for cell, part in parts if cell.pooled for out in part]
    if study.pooled and sum(cell.pooled for cell in study.cells) > 1:
        found += _rates(study, Cell(POOLED), pool, POOLED_CONFIDENCE)
    return found


def _rates(study: Study, cell: Cell, outcomes: list[Outcome], confidence: float) -> Iterator[Rate]:
    names = dict.fromkeys(name for outcome in outcomes for name in outcome)
    for name in names:
        values = [outcome[name] for outcome in outcomes if name in outcome]
        if isinstance(values[0], bool):
            met = not any(values) if name in study.never else None
            low, high = interval(sum(values), len(values), confidence)
            yield Rate(cell.name, name, None, len(values), sum(values), low, high, met)
            continue
        for level in study.levels:
            hits = sum(value <= level for value in values)
            low, high = interval(hits, len(values), confidence)
            met = low <= level and (cell.at_most or level <= high)
            if study.window and cell.name != POOLED and len(values) >= study.n_seeds:
                met = met and study.window[0] * level <= hits / len(values) <= study.window[1] * level
            verdict = bool(met) if cell.judged else None
            yield Rate(cell.name, name, level, len(values), hits, low, high, verdict, cell.at_most)


def interval(hits: int, n: int, confidence: float) -> tuple[float, float]:
    """Clopper-Pearson interval of a rate."""
    ci = binomtest(hits, n).proportion_ci(confidence)
    return float(ci.low), float(ci.high)
