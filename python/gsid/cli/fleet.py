"""gsid fleet"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsid.cli.common import EXIT_CRITERION, EXIT_GOOD
from gsid.cli.files_in_use import INPUT
from gsid.cli.options import json_option
from gsid.cli.output import print_json, print_message, print_step, steps_shown

if TYPE_CHECKING:
    from gsid.fleet.plan import Shard
    from gsid.fleet.recipe import Recipe
    from gsid.fleet.run import Counter


class _ShardType(click.ParamType):
    """I/N."""

    name = "I/N"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        index, _, count = str(value).partition("/")
        if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
            self.fail(f"{value} is not I/N with I from 1 to N, for example 2/8", param, ctx)
        return int(index), int(count)


class _Fleet(click.Group):
    """`gsid fleet RECIPE.toml` is `gsid fleet run RECIPE.toml`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = ["run", *args]
        return super().parse_args(ctx, args)


FDR = click.option(
    "--fdr",
    metavar="Q",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.01,
    show_default=True,
    help="False discovery rate of the units reported as drifted or as outliers.",
)
OUT = click.option(
    "--out",
    "folder",
    metavar="DIR",
    type=click.Path(file_okay=False),
    default="fleet",
    show_default=True,
    help="Folder of the plan, the results, the tables and the page.",
)


@click.group(cls=_Fleet, short_help="Run one recipe over many units, and compare the units.")
def fleet() -> None:
    """Run one recipe over many units, and compare the units.

    `gsid fleet RECIPE.toml REC...` is `gsid fleet run RECIPE.toml REC...`: see `gsid fleet run --help`.
    """


@fleet.command(short_help="Compute what is missing of a fleet, and merge it.")
@click.argument("recipe", metavar="RECIPE.toml", type=INPUT)
@click.argument("records", metavar="REC...", nargs=-1, required=True, type=click.Path())
@OUT
@click.option("--workers", metavar="N", type=click.IntRange(1), help="Processes. [default: one per core]")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Dask scheduler, for example tcp://host:8786. [default: a cluster on this machine, for this run]",
)
@click.option(
    "--shard",
    type=_ShardType(),
    help="Run part I of N in this process, without a scheduler; `gsid fleet merge` joins the parts.",
)
@click.option("--retry-failed", is_flag=True, help="Compute failed units again.")
@FDR
@json_option
def run(
    *,
    recipe: str,
    records: Sequence[str],
    folder: str,
    workers: int | None,
    scheduler: str | None,
    shard: tuple[int, int] | None,
    retry_failed: bool,
    fdr: float,
    as_json: bool,
) -> int:
    """Compute what is missing of a fleet, and merge it.

    REC are records and folders of records. The recipe names a verb, its options, and how names of files
    belong to units. Each unit runs in a process of its own: one that crashes is a failed unit. Results are
    kept by the content of records, model and options, so that a second run computes only what is missing.
    Ctrl-C keeps what is done.

    Exit codes: 0 all units done, 1 some failed, 3 bad recipe.
    """
    context = click.get_current_context()
    if shard is not None and (scheduler is not None or workers is not None):
        raise click.UsageError("--shard needs no scheduler and no workers: leave them out", context)
    if scheduler is not None and workers is not None:
        raise click.UsageError("--workers is for the cluster of this machine: leave it out", context)
    from gsid.fleet.extra import require
    from gsid.fleet.plan import Shard
    from gsid.fleet.recipe import read_recipe

    require(*(() if shard else ("dask", "distributed", "pyarrow")))
    part = Shard(*(shard or (1, 1)))
    status = _computed(
        read_recipe(recipe),
        records,
        Path(folder),
        part,
        is_alone=shard is not None,
        retry_failed=retry_failed,
        cluster=(scheduler, workers),
    )
    if shard is None:
        return _merged([folder], folder, fdr, as_json)
    if as_json:
        print_json({"status": status})
    print_message(f"`gsid fleet merge {folder}` joins the parts when all {part.count} have run")
    return EXIT_CRITERION if status["failed"] or status["changed"] else EXIT_GOOD


@fleet.command(short_help="Merge the results of shards into one table and one page.")
@click.argument(
    "folders", metavar="DIR...", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False)
)
@OUT
@FDR
@json_option
def merge(*, folders: Sequence[str], folder: str, fdr: float, as_json: bool) -> int:
    """Merge the results of shards into one table and one page.

    DIR are the folders of all shards of one recipe. Each planned unit is once in the tables, also if two
    shards computed it.
    """
    return _merged(folders, folder, fdr, as_json)


@fleet.command(short_help="Show and remove results that the plan does not need.")
@click.argument("folder", metavar="DIR", type=click.Path(exists=True, file_okay=False), default="fleet")
@click.option("--yes", is_flag=True, help="Remove them. [default: only show the sizes]")
@click.option("--all", "everything", is_flag=True, help="Also the results that the plan needs.")
@json_option
def clean(*, folder: str, yes: bool, everything: bool, as_json: bool) -> None:
    """Show and remove results that the plan does not need.

    They are of other options, of changed records, of older versions, or unfinished files. Nothing is removed
    without --yes.
    """
    from gsid.fleet.clean import remove, sizes

    found = sizes(folder, everything=everything)
    if as_json:
        print_json({"kept": vars(found.kept), "removable": vars(found.removable), "removed": yes})
    else:
        print(f"kept: {found.kept}")
        print(f"{'removed' if yes else 'removable'}: {found.removable}")
    if yes:
        remove(folder, everything=everything)
    elif found.removable.files:
        print_message("nothing was removed: repeat with --yes")


def _computed(
    recipe: Recipe,
    records: Sequence[str],
    folder: Path,
    shard: Shard,
    *,
    is_alone: bool,
    retry_failed: bool,
    cluster: tuple[str | None, int | None],
) -> dict[str, int]:
    """Plan, and run what is missing; returns the units of this run by status."""
    from gsid.cli.fleet_verb import VerbOfRecipe
    from gsid.fleet.forks import Setup
    from gsid.fleet.plan import units_of, write_plan
    from gsid.fleet.run import Counter, forget_failures, missing_jobs, run_here
    from gsid.fleet.store import Store
    from gsid.fleet.unit import version

    verb = VerbOfRecipe(recipe)
    print_step("planning")
    header = verb.header() | {"version": version()}
    plan = write_plan(folder, shard, header, units_of(records, recipe), verb.job)
    store, setup = Store(folder), Setup(str(folder.absolute()), verb.modules, recipe.limits)
    if retry_failed:
        forget_failures(plan, store)
    total = len({job.key for job in missing_jobs(plan, store)})
    with steps_shown() as show:
        counter = Counter(total, show)
        with _kept_by_ctrl_c(counter):
            if is_alone and total:
                run_here(setup, missing_jobs(plan, store), counter)
            elif total:
                from gsid.fleet.cluster import Cluster, run_on

                run_on(Cluster(*cluster), setup, missing_jobs(plan, store), counter, print_message)
    if counter.status["changed"]:
        print_message(
            f"warning: {counter.status['changed']} records were changed while they were read: repeat"
        )
    return counter.status


@contextlib.contextmanager
def _kept_by_ctrl_c(counter: Counter) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        done = sum(counter.status.values())
        print_message(
            f"{done} of {counter.total} units are done and kept; the same command goes on with the rest"
        )
        raise


def _merged(folders: Sequence[str], output: str, fdr: float, as_json: bool) -> int:
    """Merge, test the units, write the page, and print the summary."""
    from gsid.fleet.findings import find
    from gsid.fleet.page import sentences, write_page
    from gsid.fleet.table import FAILED, MISSING, merge

    print_step("merging")
    merged = merge(folders, output)
    found = find(output, fdr)
    page = write_page(output, found, merged)
    if as_json:
        flags = {name: list(map(vars, getattr(found, name))) for name in ("drifted", "outliers")}
        print_json(
            {"status": merged.status, "failed": dict(merged.failed), "effects": found.n_missing} | flags
        )
    else:
        for status, n in merged.status.items():
            print(f"{status}: {n}")
        for unit, why in merged.failed:
            print(f"failed: {unit}: {why}")
        for text in sentences(found)[1:]:
            print(text)
    print_message(f"wrote {page}")
    return EXIT_CRITERION if merged.status[FAILED] or merged.status[MISSING] else EXIT_GOOD
