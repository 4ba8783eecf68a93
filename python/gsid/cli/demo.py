"""gsid demo"""

from __future__ import annotations

import sys

import click

from gsid.cli.common import EXIT_CRITERION, EXIT_GOOD, json_option, print_json, print_table, say


@click.command(short_help="Measure, fit and compare the simulated axis, from end to end.")
@click.option(
    "--folder", metavar="DIR", type=click.Path(), default="demo", help="Where the files go. [default: demo]"
)
@click.option("--seed", metavar="N", type=click.IntRange(0), default=1, help="Of the noise. [default: 1]")
@json_option
def demo(folder: str, seed: int, as_json: bool) -> int:
    """Excite a simulated gimbal axis over a serial line, fit a model and compare.

    Once without friction, where the model stands beside the truth, and once with Coulomb friction, where a
    linear model fails.

    Exit code 1 when the runs do not show what they should.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from gsid.demo import demo as run_demo

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not sys.stderr.isatty(), transient=True) as bars:
        task = bars.add_task("periods", total=None)
        result = run_demo(
            folder,
            seed=seed,
            on_step=lambda text: bars.console.print(f"-- {text}", highlight=False),
            on_progress=lambda p: bars.update(task, completed=p.good, total=p.asked),
        )
    if as_json:
        print_json(result.to_dict())
        return EXIT_GOOD if result.passed else EXIT_CRITERION

    rows = [
        [t.name, f"{t.truth:.7g}", f"{t.estimate:.7g}", f"{t.std:.2g}", f"{t.n_sigma:+.2f}", t.unit]
        for t in result.linear.truth
    ]
    print_table(
        ["parameter", "truth", "estimate", "sigma", "off by [sigma]", "unit"],
        rows,
        left=["parameter", "unit"],
    )
    print()
    for experiment in (result.linear, result.friction):
        print(f"{experiment.name}: {experiment.comparison!r}")
        print()
    for text, passed in result.checks.items():
        print(f"  {'yes' if passed else 'NO ':3}  {text}")
    print(f"\nreport: {result.report}")
    if not result.passed:
        say("the demo did not show what it should")
    return EXIT_GOOD if result.passed else EXIT_CRITERION
