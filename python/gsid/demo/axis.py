"""A simulated axis in a separate process, measured over a serial line like a real axis."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gsid.excitation.multisine import Multisine
from gsid.records.files import write_record
from gsid.records.record import Record
from gsid.rig.run import Progress, run

FS_HZ = 3000.0
PERIOD = 6000
SETTLE_PERIODS = 2


@dataclass
class Bench:
    """Folder of the files, and callbacks for the progress.

    Attributes
    ----------
    folder : Path
    on_step : callable
        Called with a short description of each step before it starts.
    on_progress : callable or None
        Called with the progress of a run over the serial line.
    """

    folder: Path
    on_step: Callable[[str], None] = field(default=lambda text: None)
    on_progress: Callable[[Progress], None] | None = None

    def measure(
        self,
        name: str,
        excitation: Multisine,
        periods: int,
        *,
        seed: int,
        effect: str = "",
        params: Mapping[str, float] | None = None,
        truth_file: Path | None = None,
    ) -> Record:
        """Drive a simulated axis and keep the record as NAME.csv.

        Parameters
        ----------
        name : str
        excitation : Multisine
        periods : int
            Good periods, after two periods of settling.
        seed : int
            Random seed of the noise.
        effect, params
            Effect hidden in the axis, as in `gsid simulate --effect --param`.
        truth_file : Path, optional
            File to which the axis writes its parameters.
        """
        with simulated_axis(seed, effect, params or {}, truth_file) as port:
            record = run(
                port,
                excitation,
                periods=periods,
                settle=SETTLE_PERIODS * PERIOD,
                on_progress=self.on_progress,
            )
        record.name = f"{name}.csv"
        write_record(self.folder / record.name, record)
        return record


@contextlib.contextmanager
def simulated_axis(
    seed: int, effect: str, params: Mapping[str, float], truth_file: Path | None
) -> Iterator[str]:
    """Serve a simulated axis in a separate process, like `gsid simulate`; yields the path of the port."""
    command = [sys.executable, "-m", "gsid.cli.main", "simulate", "--once", "--seed", str(seed)]
    if effect:
        command += ["--effect", effect]
    for name, value in params.items():
        command += ["--param", f"{name}={value!r}"]
    if truth_file:
        command += ["--truth", str(truth_file)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            port = process.stdout.readline().strip()
            if not port:
                raise RuntimeError(f"the simulated axis did not start: {process.stderr.read()}")
            yield port
            process.wait(timeout=10)  # it ends when the port is closed
        finally:
            process.terminate()
