"""A command with a time limit, which ends whatever it started."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path


def run(
    command: Sequence[str | Path],
    folder: Path,
    log: Path,
    limit_s: float | None = None,
    environment: Mapping[str, str] | None = None,
) -> int:
    """Run a command in a folder, its output into a file.

    Parameters
    ----------
    command : sequence of str
    folder, log : Path
    limit_s : float, optional
        [s]; default none.
    environment : mapping of str, optional
        Variables besides those of this process.

    Returns
    -------
    int
        Exit code.

    Raises
    ------
    subprocess.TimeoutExpired
        It was stopped at the limit.
    """
    with log.open("w", encoding="utf-8") as out:
        process = subprocess.Popen(
            list(map(str, command)),
            cwd=folder,
            env=os.environ | dict(environment or {}),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            return process.wait(limit_s)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
