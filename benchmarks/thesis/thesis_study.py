"""What the chapters of the study share: the axis, gsid's commands, and the rows of the page."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import shlex
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from gsid.cli.main import main

#: The axis of every measurement, as options of `gsid simulate`. Its linear part is the default axis. Friction
#: and a torque that depends on the angle distort, a slow random torque is the process noise, and the gyro has
#: its own clock.
AXIS = (
    "--gyro free-running --stops -5:5 --torque-noise 1.2 --coulomb 4"
    " --set cogging_level=8 --set cogging_cycles=120 --set cogging_phase_rad=1.2"
)
FS_HZ = 3000
PERIOD = 6000
LINES = f"--fs {FS_HZ} --period {PERIOD}"
#: Half of the gyro's refresh rate. A response above it contains images, and is neither fitted nor drawn.
HIGHEST_HZ = 200
WAIT = 15 * FS_HZ
#: The share of periods and waiting times that the quick form of the study keeps.
QUICK = 0.04


@dataclass(frozen=True)
class Row:
    """One figure: its place in the thesis, its value there and here, how it was made, and why they differ."""

    place: str
    what: str
    thesis: str
    gsid: float | int | str
    command: str
    why: str = ""

    def text(self) -> str:
        """Value of gsid as the page prints it."""
        return f"{self.gsid:.4g}" if isinstance(self.gsid, float) else str(self.gsid)


def rows_of(place: str, command: str, *figures: tuple) -> list[Row]:
    """Rows of one place and command: each figure has what, thesis, gsid and, if they differ, why."""
    return [Row(place, what, thesis, gsid, command, *why) for what, thesis, gsid, *why in figures]


class Study:
    """Commands of the study, run in one folder.

    Parameters
    ----------
    folder : Path
        Records, responses, models and pictures are made here.
    quick : bool
        Measure few periods and draw nothing. The figures are not those of the page, but they change when
        those of the page do.
    """

    def __init__(self, folder: Path, quick: bool = False) -> None:
        self.folder = folder
        self.quick = quick
        folder.mkdir(parents=True, exist_ok=True)

    def gsid(self, command: str, picture: str = "") -> dict[str, Any]:
        """Run a command in the folder and return what it prints with --json."""
        plot = f" --plot {picture}.png" if picture and not self.quick else ""
        out, messages = io.StringIO(), io.StringIO()
        with (
            contextlib.chdir(self.folder),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(messages),
        ):
            code = main([*shlex.split(f"{command}{plot}"), "--json"])
        if code:
            raise RuntimeError(f"gsid {command}: exit code {code}\n{messages.getvalue()}")
        return json.loads(out.getvalue() or "{}")

    def draw(self, figure: Callable[[], Figure], name: str) -> None:
        """Draw a picture, unless the study is quick."""
        if not self.quick:
            figure().savefig(self.folder / f"{name}.png")

    def record(self, name: str, excitation: str, periods: int, *, wait: int = WAIT, seed: int = 1) -> str:
        """Measure the axis, unless the folder has this record, and return the command.

        Parameters
        ----------
        name : str
            The record is NAME.csv. The excitation is NAME_u.csv.
        excitation : str
            Command of `gsid design` that makes it.
        periods, wait : int
            Periods to measure, and samples before them.
        seed : int
            Random seed of the noise.
        """
        share = QUICK if self.quick else 1
        periods, wait = min(periods, max(3, round(share * periods))), round(share * wait)
        self.gsid(f"{excitation} -o {name}_u.csv")
        command = (
            f"run --simulate '{AXIS} --seed {seed}' --u {name}_u.csv --periods {periods} --settle {wait}"
            f" -o {name}.csv"
        )
        self.once(command, f"{name}.csv", self.folder / f"{name}_u.csv")
        return command

    def once(self, command: str, made: str, *inputs: Path) -> None:
        """Run a command that takes long, unless the file is there from the same command and inputs."""
        digest = hashlib.sha256(command.encode() + b"".join(path.read_bytes() for path in inputs)).hexdigest()
        mark = self.folder / f"{made}.sha256"
        if not ((self.folder / made).is_file() and mark.is_file() and mark.read_text() == digest):
            self.gsid(command)
            mark.write_text(digest)


def write_rows(path: Path, rows: list[Row]) -> None:
    """Write the rows of a chapter as JSON."""
    path.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n", encoding="utf-8")


def read_rows(path: Path) -> list[Row]:
    """Read the rows of a chapter."""
    return [Row(**row) for row in json.loads(path.read_text(encoding="utf-8"))]
