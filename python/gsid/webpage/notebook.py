"""The page from Python, for example from a notebook: the server runs in a process of its own."""

from __future__ import annotations

import atexit
import os
import signal
import subprocess
import sys
import tempfile
from html import escape
from pathlib import Path

from gsid.base.errors import InputError
from gsid.records.files import KINDS, write_record
from gsid.records.record import Record
from gsid.study.folder import Study, usable_name

END_S = 20.0  # for the server to stop its command, after which it is ended by force


class Studio:
    """A running page. It ends with `stop`, or with the Python process.

    Attributes
    ----------
    address : str
        To open in a browser of this computer; it has the token.
    folder : Path
        Of the study.
    """

    def __init__(self, folder: Path, port: int, browser: bool) -> None:
        command = [sys.executable, "-m", "gsid.cli.main", "studio", "--folder", str(folder)]
        command += ["--port", str(port), *([] if browser else ["--no-browser"])]
        self.folder = folder
        with tempfile.TemporaryFile() as errors:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                start_new_session=True,  # Ctrl-C in a notebook interrupts the cell, not the page
            )
            assert self._process.stdout is not None
            _, _, self.address = self._process.stdout.readline().strip().partition(": ")
            if not self.address:
                self._process.wait()
                errors.seek(0)
                why = errors.read().decode(errors="replace").strip()
                raise InputError("gsid studio has not started", str(folder), why)
        atexit.register(self.stop)

    def stop(self) -> None:
        """End the server; a step that runs is stopped and noted. The study stays."""
        atexit.unregister(self.stop)
        if self._process.poll() is None:
            os.kill(self._process.pid, signal.SIGINT)
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._process.wait()

    @property
    def is_running(self) -> bool:
        """Whether the server has not ended."""
        return self._process.poll() is None

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        return f"Studio({self.address if self.is_running else 'stopped'}, study {self.folder})"

    def _repr_html_(self) -> str:
        if not self.is_running:
            return f"gsid studio of {escape(str(self.folder))}: stopped"
        link = f'<a href="{escape(self.address)}" target="_blank">gsid studio</a>'
        return f"{link} of {escape(str(self.folder))}; <code>.stop()</code> ends it"


def studio(
    *records: Record | str | os.PathLike,
    folder: str | os.PathLike = "study",
    port: int = 0,
    browser: bool = True,
) -> Studio:
    """Open records in the page of a study.

    Parameters
    ----------
    *records : Record or path_like
        A Record is written into the study as .npz, under its name.
    folder : path_like
        Of the study; created if it does not exist.
    port : int
        On 127.0.0.1; 0: any free port.
    browser : bool
        Whether to open the page in a browser.

    Returns
    -------
    Studio
        The running page: `address`, `stop()`. In a notebook it is shown as a link.

    Raises
    ------
    InputError
        The folder is not a study, a file has no usable name, or the server has not started: the port is
        in use, or another page has the study open.
    """
    study = Study(folder)
    kept = [_add(study, record) for record in records]
    if kept:
        study.begin_experiment(kept)
    return Studio(study.folder, port, browser)


def _add(study: Study, record: Record | str | os.PathLike) -> str:
    if not isinstance(record, Record):
        return study.add_file(record, experiment=None)
    name = usable_name(record.name or "record")
    if name.lower().endswith(KINDS):
        name = Path(name).stem
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.npz"
        write_record(path, record)
        return study.add_file(path, experiment=None)
