"""gsid demo"""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsid.base.tables import Table
from gsid.cli.common import EXIT_CRITERION, EXIT_GOOD
from gsid.cli.options import SEED, json_option
from gsid.cli.output import print_json, print_ladder, print_message, print_step, print_table, prints_lines

if TYPE_CHECKING:
    from gsid.demo import Demo
    from gsid.demo.missing import Search
    from gsid.report import Truth


@click.command(short_help="Measure the simulated axis and find the effect hidden in it.")
@click.option(
    "--folder",
    metavar="DIR",
    type=click.Path(),
    default="demo",
    help="Folder of the files written. [default: demo]",
)
@click.option(
    "--seed",
    metavar="N",
    type=SEED,
    default=1,
    help="Random seed of the noise and of the hidden effect. [default: 1]",
)
@json_option
def demo(folder: str, seed: int, as_json: bool) -> int:
    """Measure a simulated gimbal axis over a serial line, fit and compare models, and find a hidden effect.

    There are three runs. Without friction, the fitted parameters are compared with the true ones. With
    Coulomb friction, a linear model fails. In the third, the axis has an effect chosen by the seed: gsid
    diagnoses it, adds it, and compares the result with the truth at the end.

    The exit code is 1 if a run does not give the expected result.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from gsid.demo import demo as run_demo

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)

    def show(text: str) -> None:
        if prints_lines():
            print_step(text)
        else:
            console.print(f"-- {text}", highlight=False)

    with Progress(*columns, console=console, disable=not sys.stderr.isatty(), transient=True) as bars:
        task = bars.add_task("periods", total=None)
        result = run_demo(
            folder,
            seed=seed,
            on_step=show,
            on_progress=lambda p: bars.update(task, completed=p.good, total=p.requested),
        )
    if as_json:
        print_json(result.to_dict())
        return EXIT_GOOD if result.passed else EXIT_CRITERION

    _print(result)
    if not result.passed:
        print_message("the demo did not give the expected results")
    return EXIT_GOOD if result.passed else EXIT_CRITERION


def _print(result: Demo) -> None:
    _print_truth(result.linear.truth)
    print()
    for experiment in (result.linear, result.friction):
        print(f"{experiment.name}: {experiment.comparison!r}")
        print()
    _print_search(result.search)
    for text, passed in result.checks.items():
        print(f"  {'yes' if passed else 'NO ':3}  {text}")
    print(f"\nreport: {result.report}\n")
    if rows := result.search.compared_with_truth():
        _print_truth(rows)
        print()
    print(result.search.answer_sentence)
    print(f"Find it by clicks: {_program()} studio --folder {shlex.quote(_short(result.study))}")


def _program() -> str:
    """This program as it was called, or its name if the shell finds it."""
    called = Path(sys.argv[0])
    is_elsewhere = called.name == "gsid" and shutil.which("gsid") is None
    return shlex.quote(_short(called)) if is_elsewhere else "gsid"


def _short(path: Path) -> str:
    """Relative to the current folder, where it is inside."""
    path = path.absolute()
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


def _print_search(found: Search) -> None:
    print(f"hidden effect (SHA-256 {found.hidden.sha256}): {found.comparison!r}")
    print()
    print(repr(found.diagnosis))
    print()
    if found.ladder.rungs:
        print_ladder(found.ladder)
        print()


def _print_truth(rows: Sequence[Truth]) -> None:
    cells = [
        [t.name, f"{t.truth:.7g}", f"{t.estimate:.7g}", f"{t.std:.2g}", f"{t.n_sigma:+.2f}", t.unit]
        for t in rows
    ]
    header = ["parameter", "truth", "estimate", "sigma", "off by [sigma]", "unit"]
    print_table(Table(header, cells, left=["parameter", "unit"]))
