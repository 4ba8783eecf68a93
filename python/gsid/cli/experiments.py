"""Files of several experiments in one folder, NAME01.csv, NAME02.csv, ..., and numbers for each channel."""

from __future__ import annotations

import math
from pathlib import Path

import click

from gsid.cli.files_in_use import FilesInUse


class Numbers(click.ParamType):
    """X,Y,...: a finite number for each channel."""

    name = "X,Y,..."

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = (math.nan,)
        if not all(map(math.isfinite, numbers)):
            self.fail(f"{value} is not a list of numbers, for example 0.1,0.04", param, ctx)
        return numbers


folder_option = click.option(
    "-o",
    "--output",
    "folder",
    metavar="DIR",
    type=click.Path(file_okay=False),
    required=True,
    help="Folder of the experiments, one CSV each; it is made if it does not exist.",
)


def files_in(folder: str, n: int) -> list[Path]:
    """Names of n files of experiments in a folder, which is made.

    Raises
    ------
    InputError
        One of them is an input of the command, or nothing can be written there.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    width = max(2, len(str(n)))
    paths = [Path(folder) / f"{i + 1:0{width}d}.csv" for i in range(n)]
    FilesInUse.of(click.get_current_context()).write(*paths)
    return paths
