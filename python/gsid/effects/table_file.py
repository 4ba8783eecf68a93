"""Torque laws given by points: a header line `w,torque`, `theta,torque` or `u,torque`, then rows of numbers.

Further columns, and `# key: value` lines before the header, are allowed. `# unit:` is the unit of the first
column. Torque is over inertia and positive against the motion: friction has the sign of the rate.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

from gsid.base.errors import InputError
from gsid.base.files import write_atomically

if TYPE_CHECKING:
    import numpy as np

VARIABLES = {"w": "rate", "theta": "angle", "u": "command"}  # as in expressions, and in words
TORQUE = "torque"


def short_name(name: str, where: str = "") -> str:
    """Return the short name of a variable, for example "w" for "rate".

    Raises
    ------
    InputError
        The name is not a variable.
    """
    for short, long in VARIABLES.items():
        if name in (short, long):
            return short
    raise InputError("not a variable of a torque law", where, name, f"use one of {', '.join(VARIABLES)}")


def write_table(path: str | Path, columns: dict[str, np.ndarray], notes: dict[str, str]) -> None:
    """Write a table.

    Parameters
    ----------
    path : path
    columns : dict of (n,) arrays
        Columns by name, the variable first.
    notes : dict of str
        Keys and values of the lines before the header.
    """

    def write(part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as file:
            file.writelines(f"# {key}: {value}\n" for key, value in notes.items())
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows([f"{x:.10g}" for x in row] for row in zip(*columns.values(), strict=True))

    write_atomically(path, write)


def read_table(path: str | Path) -> tuple[str, list[float], list[float], str]:
    """Read a table.

    Parameters
    ----------
    path : path

    Returns
    -------
    variable : str
        "w", "theta" or "u".
    at, torque : lists of float
    unit : str
        Unit of the variable; "" if the file does not state it.

    Raises
    ------
    InputError
        The file cannot be read, or is not a table. `where` names the line.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("cannot read the table", str(path), None, "give a text file of points") from error
    notes = dict(line[1:].partition(":")[::2] for line in lines if line.startswith("#"))
    unit = {key.strip(): value.strip() for key, value in notes.items()}.get("unit", "")
    rows = [(i, line) for i, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    names = [name.strip() for name in rows[0][1].split(",")] if rows else []
    if TORQUE not in names[1:]:
        hint = f"write the header as `w,{TORQUE}`, `theta,{TORQUE}` or `u,{TORQUE}`"
        raise InputError("the table has no torque column", str(path), ",".join(names), hint)
    short, column = short_name(names[0], str(path)), names.index(TORQUE)
    points = [_point(line, column, len(names), f"{path}: line {i}") for i, line in rows[1:]]
    return short, [x for x, _ in points], [y for _, y in points], unit


def _point(line: str, column: int, n_columns: int, where: str) -> tuple[float, float]:
    cells = line.split(",")
    try:
        if len(cells) == n_columns:
            return float(cells[0]), float(cells[column])
    except ValueError:
        pass
    raise InputError("invalid row in the table", where, line.strip(), f"write {n_columns} numbers in a row")
