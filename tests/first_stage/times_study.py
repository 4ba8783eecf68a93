"""Time of each step of a diagnosis, from the records alone and with a model whose values are 30 % off.

The trials are those of the study of the diagnosis from records (hard.py): of six four have one hidden effect,
one has none, one has a law outside the catalogue. Processor and clock time of each step are taken in one
process, with one thread of OpenBLAS; clock times are meaningful on a computer that does nothing else. Results
stay in a file; a broken run goes on where it stopped. Another version is measured with its package in
PYTHONPATH and a file of its own, which `--before` puts beside.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # the package's own threads share the cores

import argparse
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import hard
import numpy as np
from first_stage_study import put_into
from from_records_study import STARTS, markdown, record_of
from study_pool import Row, add_line, read_lines

import gsid
from gsid.diagnosis.from_records.run import Run
from gsid.plant.model import PlantModel

TARGET = "from-records-times"
SEED = 5150
KINDS = ("single", "single", "null", "single", "foreign", "single")
BUDGET_S = 600.0  # no diagnosis ends by the clock
DRAFT = ("spectra", "linear structure", "given model", "first draft")
SUMS = ("records to first draft", "all")
LIMITS = {"records to first draft": "median 0.5", "all": "median 3, worst 30; unknown 60"}


@contextmanager
def timed(run: Run, step: str) -> Iterator[None]:
    """`Run.timed` with processor time: {step: [processor, clock]} in `Run.seconds`."""
    began = time.process_time(), time.perf_counter()
    try:
        yield
    finally:
        spent = time.process_time() - began[0], time.perf_counter() - began[1]
        run.seconds[step] = [a + b for a, b in zip(run.seconds.get(step, (0.0, 0.0)), spent, strict=True)]


def diagnosed(seed: int, number: int) -> list[Row]:
    """Times and verdict of one trial from each start.

    Parameters
    ----------
    seed, number : int
    """
    kind = KINDS[number % len(KINDS)]
    trial = hard.make_hard(seed, number, kind)
    records = [record_of(u, y) for u, y in trial.records]
    models = {"records": None, "30": PlantModel.from_dict(trial.models[0.3], "null")}
    rows = []
    for start, model in models.items():
        began = time.process_time(), time.perf_counter()
        found = gsid.diagnose_records(records, model, time_s=BUDGET_S)
        spent = [time.process_time() - began[0], time.perf_counter() - began[1]]
        steps = found.seconds | {"all": spent}
        rows.append(
            {"kind": kind, "start": start, "verdict": found.verdict, "effects": list(found.effects)}
            | {"steps": steps | {SUMS[0]: _sum([steps[step] for step in DRAFT if step in steps])}}
        )
    return rows


def _sum(times: Sequence[Sequence[float]]) -> list[float]:
    return [float(part) for part in np.sum(times, axis=0)]


def run(results: Path, seed: int, n: int) -> list[Row]:
    """Rows of n trials; those that are in the file are not made again.

    Parameters
    ----------
    results : Path
    seed, n : int
    """
    Run.timed = timed
    diagnosed(seed, 0)  # what the first call loads is no step of a diagnosis
    done = {tuple(entry["task"]) for entry in read_lines(results)}
    for number in range(n):
        if (seed, number) not in done:
            rows = diagnosed(seed, number)
            add_line(results, {"task": (seed, number), "rows": rows})
            print(number, *(f"{row['verdict']} {row['steps']['all'][0]:.1f} s" for row in rows), flush=True)
    return rows_of(results, seed, n)


def rows_of(results: Path, seed: int, n: int) -> list[Row]:
    """Rows of the first n trials of a seed.

    Parameters
    ----------
    results : Path
    seed, n : int
    """
    entries = {tuple(entry["task"]): entry["rows"] for entry in read_lines(results)}
    return [row for number in range(n) for row in entries.get((seed, number), [])]


def _times(rows: Sequence[Row], start: str, step: str) -> list[list[float]]:
    return [row["steps"][step] for row in rows if row["start"] == start and step in row["steps"]]


def _cell(times: Sequence[Sequence[float]], which: int) -> str:
    """Median, 95 % and worst of processor (0) or clock time (1)."""
    if not times:
        return "-"
    values = [one[which] for one in times]
    return f"{np.median(values):.2f} ({np.quantile(values, 0.95):.1f}, {max(values):.1f})"


def table(rows: Sequence[Row], before: Sequence[Row], command: str) -> str:
    """Times of each step as Markdown.

    Parameters
    ----------
    rows, before : sequence of dict
        Of this version, and of another one of the same trials, which may have none.
    command : str
        That made them.
    """
    steps = list(dict.fromkeys(step for row in rows for step in row["steps"] if step not in SUMS))
    lines = []
    for start in dict.fromkeys(row["start"] for row in rows):
        for step in [*steps, *SUMS]:
            times, others = _times(rows, start, step), _times(before, start, step)
            if times:
                cells = [_cell(others, 0), _cell(times, 0), _cell(times, 1)]
                lines.append([STARTS[start], step, len(times), *cells, LIMITS.get(step, "")])
    head = ["start", "step", "n", "processor s before", "processor s", "clock s", "limit, s"]
    unknown = [row["steps"]["all"] for row in rows if row["verdict"] == "unknown_effect"]
    text = [f"Made by `{command}`. Median (95 %, worst).", "", *markdown(head, lines)]
    text.append(
        f"The {len(unknown)} unknown: {_cell(unknown, 0)} s of processor time, {_cell(unknown, 1)} s."
    )
    if before:
        same = sum(a["effects"] == b["effects"] for a, b in zip(rows, before, strict=False))
        text.append(f"The effects of {same} of {min(len(rows), len(before))} diagnoses are those of before.")
    return "\n".join(text)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and write its table."""
    parser = argparse.ArgumentParser(description="Time each step of the diagnosis from records.")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--n", type=int, default=100, help="trials")
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--before", type=Path, help="results of another version")
    parser.add_argument("--page", type=Path, help="page to put the table into")
    args = parser.parse_args(arguments)
    rows = run(args.results, args.seed, args.n)
    before = rows_of(args.before, args.seed, args.n) if args.before else []
    text = table(rows, before, f"make {TARGET} SEED={args.seed} N={args.n}")
    print(text)
    if args.page:
        put_into(args.page, text, TARGET)


if __name__ == "__main__":
    main()
