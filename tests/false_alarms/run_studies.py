"""Run the studies of false alarms and put their tables into docs/explanation/false_alarms.md.

    make false-alarms [STUDY=NAME] [N=SEEDS] [TABLE=1]

Finished experiments are kept in build/false_alarms/NAME.jsonl: a run that was cut goes on there. Remove the
file to run a study again.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share the machine

import click
import study as studying
from page import put, table
from rich.console import Console
from rich.progress import Progress
from study import FIRST_SEED, POOLED_CONFIDENCE, Rate, Results, Study, rates, studies

ROOT = Path(__file__).resolve().parents[2]


def block(study: Study, results: Results, n_seeds: int) -> str:
    """What the page says of one study."""
    found = rates(study, results.outcomes, n_seeds)
    rows = [_row(rate) for rate in found]
    several = len({rate.outcome for rate in found}) > 1
    head = ["cell", "outcome", "nominal", "experiments", "rejected", "rate", "interval", ""]
    if not several:
        head, *rows = (row[:1] + row[2:] for row in [head, *rows])
    required = f"Interval: Clopper-Pearson, {study.confidence:.1%} of a cell"
    if study.pooled:
        required += f", {POOLED_CONFIDENCE:.0%} of all cells together"
    if study.window:
        low, high = study.window
        required += f"; the rate itself is required within {low:g} to {high:g} times the nominal one"
    return (
        f"## {study.title}\n\n{study.about}\n\n"
        f"Seeds {FIRST_SEED} to {FIRST_SEED + n_seeds - 1} of each cell, code {', '.join(results.commits)}. "
        f"{required}.\n\n{table(head, rows, left=2 if several else 1)}"
    )


def _row(rate: Rate) -> list[str]:
    verdict = {None: "not judged", True: "met", False: "MISSED"}[rate.met]
    return [
        rate.cell,
        rate.outcome.replace("_", " "),
        "" if rate.level is None else f"{'at most ' * rate.at_most}{rate.level:.3g}",
        str(rate.n),
        str(rate.hits),
        f"{rate.rate:.2%}",
        f"{rate.low:.2%} to {rate.high:.2%}",
        verdict,
    ]


@click.command(help="Run studies of false alarms, print their tables, and put them into the page.")
@click.argument("names", nargs=-1)
@click.option("--seeds", type=click.IntRange(1), help="Seeds of each cell. Default: those of the study.")
@click.option("--table", "only_count", is_flag=True, help="Run nothing: count what was run so far.")
@click.option(
    "--results", type=click.Path(path_type=Path), required=True, help="Folder of finished experiments."
)
@click.option("--page", type=click.Path(path_type=Path), help="Page that takes the tables.")
def main(
    names: tuple[str, ...], seeds: int | None, only_count: bool, results: Path, page: Path | None
) -> None:
    known = studies()
    unknown = [name for name in names if name not in known]
    if unknown:
        raise click.UsageError(f"unknown study {unknown[0]}: there are {', '.join(known)}")
    missed = []
    for name in names or known:
        study, path = known[name], results / f"{name}.jsonl"
        n_seeds = seeds or study.n_seeds
        done = Results.load(path) if only_count else _run(study, path, n_seeds)
        text = block(study, done, n_seeds)
        print(text, flush=True)
        if page:
            put(str(page), name, text)
        missed += [
            f"{name}, {rate.cell}" for rate in rates(study, done.outcomes, n_seeds) if rate.met is False
        ]
    if missed:
        print("error: missed: " + "; ".join(missed), file=sys.stderr)
        sys.exit(1)


def _run(study: Study, path: Path, n_seeds: int) -> Results:
    seeds = f"seeds {FIRST_SEED} to {FIRST_SEED + n_seeds - 1}"
    print(f"{study.name}: {len(study.cells)} cells, {seeds}, into {path}", file=sys.stderr)
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task(study.name)
        return studying.run(
            study, path, n_seeds, lambda n, n_all: progress.update(bar, completed=n, total=n_all)
        )


if __name__ == "__main__":
    main()
