"""Commands of gsid that run beside the page, one at a time, each in a process group of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shlex
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from gsid.base.progress import ProgressText
from gsid.webpage.words import INTERRUPTED

# -P: the study, which is the working folder, is not searched for modules; a file in it may be named click.py
COMMAND = (sys.executable, "-P", "-m", "gsid.cli.main")
CLOSE_S = 5.0  # the same when the server ends
MAX_STDOUT = 64 << 20  # bytes of one command
MAX_LINE = 1 << 16
STOP_S = 60.0  # between Ctrl-C and the end by force: a diagnosis still judges and draws


@dataclass
class Job:
    """A command that runs.

    Attributes
    ----------
    arguments : tuple of str
        Words after `gsid`.
    step : str
        What it does now; a `ProgressText` with its parts once the command has printed one.
    messages : list of str
        Notes, warnings and errors so far.
    stdout : bytes
        Its standard output, once it has ended.
    exit_code : int or None
        None while it runs.
    is_stopping : bool
        Whether it was asked to stop.
    added : tuple of str
        Further words of the command, which are neither shown nor noted.
    kept_open : tuple of int
        Descriptors that the command inherits.
    """

    stdin = asyncio.subprocess.DEVNULL
    close_s = CLOSE_S

    arguments: tuple[str, ...]
    step: str = "starting"
    messages: list[str] = field(default_factory=list)
    stdout: bytes = b""
    exit_code: int | None = None
    is_stopping: bool = False
    added: tuple[str, ...] = ()
    kept_open: tuple[int, ...] = ()
    _process: asyncio.subprocess.Process | None = None
    _force: asyncio.TimerHandle | None = None

    @property
    def command(self) -> str:
        """The command as typed in the folder of the study."""
        return shlex.join(["gsid", *self.arguments])

    async def run(self, folder: Path, on_change: Callable[[], None]) -> None:
        """Run the command in this folder until it ends.

        Parameters
        ----------
        folder : Path
        on_change : callable
            Called after each line of progress.
        """
        self._process = await asyncio.create_subprocess_exec(
            *COMMAND, *self.arguments, *self.added,
            cwd=folder,
            stdin=self.stdin,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
            pass_fds=self.kept_open,
            limit=MAX_LINE,
            env=os.environ | {"NO_COLOR": "1", "COLUMNS": "120", "GSID_PROGRESS": "json"},
        )  # fmt: skip
        if self.is_stopping:
            self._signal(signal.SIGINT)
        try:
            self.stdout, _ = await asyncio.gather(self._read_stdout(), self._follow(on_change))
            code = await self._process.wait()
            self.exit_code = INTERRUPTED if code == -signal.SIGINT else code  # as a shell reports it
        finally:
            self.kill()
            if self._force is not None:
                self._force.cancel()

    async def _read_stdout(self) -> bytes:
        found = bytearray()
        while block := await self._process.stdout.read(MAX_LINE):
            found += block
            if len(found) > MAX_STDOUT:
                self.messages.append("error: the answer is too long")
                self.kill()
                return b""
        return bytes(found)

    async def _follow(self, on_change: Callable[[], None]) -> None:
        while True:
            try:
                line = await self._process.stderr.readline()
            except ValueError:  # a line longer than the limit
                continue
            if not line:
                return
            if self.takes(line):
                continue
            self._take(line)
            with contextlib.suppress(Exception):  # a fault of who watches does not end the command
                on_change()

    def _take(self, line: bytes) -> None:
        """Take a line of stderr: a step or a message as a JSON object, or other bytes as a message."""
        text = line.decode("utf-8", "replace").rstrip()
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            values = None
        if isinstance(values, dict) and isinstance(values.get("words"), str):
            left = values.get("seconds_left")
            left = float(left) if isinstance(left, (int, float)) else None
            if not self.is_stopping:
                self.step = ProgressText(values["words"], str(values.get("step") or ""), left)
            return
        if isinstance(values, dict) and isinstance(values.get("message"), str):
            text = values["message"]
        self.messages += [text] if text else []

    def takes(self, line: bytes) -> bool:
        """Whether a line on stderr is for this kind of job alone: it is neither a step nor a message.

        Parameters
        ----------
        line : bytes
        """
        return False

    def stop(self) -> None:
        """End the command as Ctrl-C does; after a minute by force. Further calls change nothing."""
        if self.is_stopping or self.exit_code is not None:
            return
        self.is_stopping, self.step = True, "stopping"
        self._signal(signal.SIGINT)
        self._force = asyncio.get_running_loop().call_later(STOP_S, self.kill)

    def kill(self) -> None:
        """End the command and all its processes by force."""
        self._signal(signal.SIGKILL)

    def _signal(self, number: int) -> None:
        if self._process is not None and self.exit_code is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
