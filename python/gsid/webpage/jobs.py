"""Commands of gsid that run beside the page, one at a time, each in a process group of its own."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

# -P: the study, which is the working folder, is not searched for modules; a record may be named click.py
COMMAND = (sys.executable, "-P", "-m", "gsid.cli.main")
PROGRESS = "-- "  # begins a line on stderr that names the present step
OUTPUT_MOST = 64 << 20  # bytes of one command's answer
LINE_MOST = 1 << 16
PATIENCE_S = 5.0  # between Ctrl-C and the end by force


@dataclass
class Job:
    """A command that runs.

    Attributes
    ----------
    arguments : tuple of str
        Words after `gsid`.
    step : str
        What it does now.
    messages : list of str
        Notes, warnings and errors so far.
    answer : bytes
        Its standard output, once it has ended.
    exit_code : int or None
        None while it runs.
    """

    arguments: tuple[str, ...]
    step: str = "starting"
    messages: list[str] = field(default_factory=list)
    answer: bytes = b""
    exit_code: int | None = None
    _process: asyncio.subprocess.Process | None = None
    _is_cancelled: bool = False

    async def run(self, folder: Path, on_change: Callable[[], Awaitable[None]]) -> None:
        """Run the command in this folder until it ends.

        Parameters
        ----------
        folder : Path
        on_change : coroutine function
            Called after each line of progress.
        """
        self._process = await asyncio.create_subprocess_exec(
            *COMMAND, *self.arguments,
            cwd=folder,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
            limit=LINE_MOST,
            env=os.environ | {"NO_COLOR": "1", "COLUMNS": "120"},
        )  # fmt: skip
        if self._is_cancelled:
            self._signal(signal.SIGINT)
        try:
            self.answer, _ = await asyncio.gather(self._read_answer(), self._follow(on_change))
            self.exit_code = await self._process.wait()
        finally:
            self._signal(signal.SIGKILL)

    async def _read_answer(self) -> bytes:
        answer = b""
        while block := await self._process.stdout.read(LINE_MOST):
            answer += block
            if len(answer) > OUTPUT_MOST:
                self.messages.append("error: the answer is too long")
                self._signal(signal.SIGKILL)
                return b""
        return answer

    async def _follow(self, on_change: Callable[[], Awaitable[None]]) -> None:
        while True:
            try:
                line = await self._process.stderr.readline()
            except ValueError:  # a line longer than the limit
                continue
            if not line:
                return
            text = line.decode("utf-8", "replace").rstrip()
            if text.startswith(PROGRESS):
                self.step = text.removeprefix(PROGRESS)
            elif text:
                self.messages.append(text)
            await on_change()

    async def cancel(self) -> None:
        """End the command as Ctrl-C does; after five seconds by force."""
        self._is_cancelled = True
        self._signal(signal.SIGINT)
        await asyncio.sleep(PATIENCE_S)
        if self.exit_code is None:
            self._signal(signal.SIGKILL)

    def _signal(self, number: int) -> None:
        if self._process is not None and self.exit_code is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
