"""Experiments of the page while they run: who holds control, what is drawn, and what ends them.

The command `gsid run --attended` ends the run, with STOP and its record, when no sign of life has arrived
for 3 s. The server passes on the signs of life of the page that holds control, and gives none of its
own: the page, the browser or the server may hang or end, and the run stops.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from gsid.base.errors import InputError
from gsid.webpage.body import object_of
from gsid.webpage.experiment import (
    EFFECTS,
    EXCITATION,
    LENGTH,
    LIMITS,
    LINES,
    SIMULATED,
    Experiment,
    experiment_of,
    ports,
)
from gsid.webpage.interrupted import adopt_run, forget_run, note_run
from gsid.webpage.jobs import Job
from gsid.webpage.page import Page
from gsid.webpage.safety import new_token

FIGURES = b'{"live": '  # begins a line of figures on stderr
HISTORY = 200  # sets of figures that a page which joins gets: 10 s
SIGN_S = 0.25  # shortest time between two signs of life that are passed on
BEAT_S = 0.5  # longest time between two messages to a page while an experiment runs
MAX_REQUEST = 1 << 14
RECORD_LINE = re.compile(r"wrote (\S+): (\d+) samples, (\d+) good periods, (\d+) lost")
KILLED = (
    "The axis was not stopped by STOP. Firmware that follows rule 7 of docs/reference/protocol.md sets the"
    " command to zero 0.25 s after the last frame: check that the axis stands still before you go near it."
)


@dataclass
class LiveJob(Job):
    """`gsid run` as a job: its figures are kept apart from its messages, and it gets signs of life.

    Attributes
    ----------
    number : int
        Of the experiment, since the server began.
    figures : deque of (int, str)
        The newest sets of figures as JSON, numbered from 1 on.
    response : (int, str)
        The newest response alone, and the number of its set.
    """

    stdin = asyncio.subprocess.PIPE

    number: int = 0
    figures: deque[tuple[int, str]] = field(default_factory=lambda: deque(maxlen=HISTORY))
    response: tuple[int, str] = (0, "")
    on_figures: Any = None
    _n_figures: int = 0
    _sign_s: float = 0.0

    async def run(self, folder: Path, on_change: Callable[[], None]) -> None:
        """Run the command, then put its messages into plain sentences."""
        await super().run(folder, on_change)
        self.messages = [sentence(line) for line in self.messages]
        if self.exit_code is not None and self.exit_code < 0:
            self.messages.append(KILLED)

    def takes(self, line: bytes) -> bool:
        """Keep a set of figures."""
        if not line.startswith(FIGURES):
            return False
        self._n_figures += 1
        one = self._n_figures, line[len(FIGURES) :].rstrip()[:-1].decode()
        self.figures.append(one)
        start = one[1].find('"response"')  # the last key
        if start >= 0:
            self.response = self._n_figures, "{" + one[1][start:]
        self.on_figures()
        return True

    def after(self, last: int) -> list[tuple[int, str]]:
        """Sets of figures after this number; before them the newest response if it is in none."""
        found = [one for one in self.figures if one[0] > last]
        is_missing = found and last < self.response[0] < found[0][0]
        return [self.response, *found] if is_missing else found

    def sign_of_life(self) -> None:
        """Pass on that the page which holds control is there."""
        now_s = time.monotonic()
        if self._process is None or now_s < self._sign_s + SIGN_S:
            return
        self._sign_s = now_s
        with contextlib.suppress(OSError, RuntimeError):
            self._process.stdin.write(b".")


def sentence(line: str) -> str:
    """A message of `gsid run` in the words of the page.

    Parameters
    ----------
    line : str
    """
    found = RECORD_LINE.match(line)
    if not found:
        return line
    path, n, good, lost = found.groups()
    return f"{path} keeps {n} samples: {good} good periods, {lost} spoiled."


class Seat:
    """A page that watches.

    Attributes
    ----------
    token : str
        Secret of the page: a reload of it keeps its control.
    changed : asyncio.Event
        Whether there is something to send.
    read : asyncio.Event
        Whether the page has read the last message.
    """

    def __init__(self, token: str) -> None:
        self.token = token
        self.changed, self.read = asyncio.Event(), asyncio.Event()
        self.read.set()


class Live:
    """The experiments of a page.

    Parameters
    ----------
    page : Page
    """

    def __init__(self, page: Page) -> None:
        self.page = page
        self.control = ""  # token of the page that holds it
        self.seats: set[Seat] = set()
        self.job: LiveJob | None = None  # the last one; it may have ended
        self._stage: Job | None = None  # the present step of an experiment: its design, or its run
        self._form: dict[str, Any] = {}
        self._n_jobs = 0
        if adopt_run(page.study):
            page.read_study()

    # ---- control ---------------------------------------------------------------------------------------

    def sit(self, token: str) -> Seat:
        """A page begins to watch. After a reload it gives the token of its control; a copy of it gets none.

        Parameters
        ----------
        token : str
        """
        is_back = token and token == self.control and not self._is_there(token)
        seat = Seat(token if is_back else new_token())
        self.seats.add(seat)
        self.changed()
        return seat

    def leave(self, seat: Seat) -> None:
        """A page has gone."""
        self.seats.discard(seat)
        self.changed()

    def take_control(self, seat: Seat) -> None:
        """Give the control to this page."""
        self.control = seat.token
        self.sign(seat)
        self.changed()

    def sign(self, seat: Seat) -> None:
        """A page has read a message: a sign of life, if it holds control."""
        if seat.token == self.control and self.job is not None and self.page.job is self.job:
            self.job.sign_of_life()

    def _is_there(self, token: str) -> bool:
        return any(seat.token == token for seat in self.seats)

    @property
    def is_running(self) -> bool:
        """Whether an experiment is prepared or runs."""
        return self._stage is not None and self.page.job is self._stage

    def changed(self) -> None:
        """Have something sent to every page."""
        for seat in self.seats:
            seat.changed.set()

    # ---- an experiment ---------------------------------------------------------------------------------

    def start(self, form: Mapping[str, Any]) -> None:
        """Begin an experiment: its excitation, then the run, then a look at the record.

        Parameters
        ----------
        form : mapping
            As for `experiment_of`, and the token of the page, which gets the control.

        Raises
        ------
        InputError
            A field is not valid, another step runs, or the page has no connection.
        """
        token = form.get("token")
        if not isinstance(token, str) or not self._is_there(token):
            raise InputError("the page has no connection for live figures", "", None, "reload the page")
        self.page.check_idle()
        wanted = experiment_of(self.page.study, form)
        self.control = token
        self._form = {name: value for name, value in form.items() if name != "token"}
        if wanted.design:
            number = self.page.study.begin_step()
            words, path = wanted.design_step(number)
            self._stage = Job(tuple(words))
            self.page.begin(self._stage, [path], number, lambda job: self._designed(job, wanted, path))
        else:
            self._run(wanted, wanted.file)
        self.changed()

    def _designed(self, job: Job, wanted: Experiment, excitation: str) -> None:
        self.changed()
        if job.exit_code == 0 and not self.page.is_stopped:
            if not self._is_there(self.control):
                raise InputError("the page that started the experiment has gone: it was not begun")
            self._run(wanted, excitation)

    def _run(self, wanted: Experiment, excitation: str) -> None:
        number = self.page.study.begin_step()
        words, record = wanted.run_step(number, excitation)
        job = LiveJob(tuple(words), added=("--attended",))
        job.number, job.on_figures = self._n_jobs + 1, self.changed
        note_run(self.page.study, number, words, record)
        self.page.begin(job, [record], number, lambda ended: self._ended(record))
        self.job, self._stage, self._n_jobs = job, job, job.number

    def _ended(self, record: str) -> None:
        """Look at the record; make it of the journal if the run was ended by force."""
        self.changed()
        forget_run(self.page.study)
        journal = f"{record}.journal"
        if (self.page.study.folder / record).is_file():
            self.page.request_step({"verb": "look", "records": [record]})
        elif (self.page.study.folder / journal).is_file():
            words = ("run", f"--recover={journal}", "-o", record, "--json")
            number = self.page.study.begin_step()
            self.page.begin(Job(words), [record], number, lambda job: self._recovered(job, record))

    def _recovered(self, job: Job, record: str) -> None:
        if job.exit_code == 0:
            self.page.request_step({"verb": "look", "records": [record]})

    # ---- what is sent ----------------------------------------------------------------------------------

    def message(self, seat: Seat, last: tuple[int, int]) -> tuple[str, tuple[int, int]]:
        """What a page has to know, as JSON, and the experiment and set of figures that it then knows.

        Parameters
        ----------
        seat : Seat
        last : (int, int)
            What it knows.
        """
        job = self.job
        found: list[tuple[int, str]] = []
        if job is not None:
            found = job.after(last[1] if last[0] == job.number else 0)
            last = job.number, found[-1][0] if found else (last[1] if last[0] == job.number else 0)
        control = "own" if seat.token == self.control else "other" if self._is_there(self.control) else "none"
        state = {
            "token": seat.token,
            "control": control,
            "n_pages": len(self.seats),
            "run": None if job is None else job.number,
            "command": "" if job is None else job.command,
            "running": self.is_running,
            "stopping": self.is_running and self.page.is_stopped,
        }
        figures = ",".join(text for _, text in found)
        return f'{json.dumps(state)[:-1]}, "figures": [{figures}]}}', last

    def form(self) -> dict[str, Any]:
        """The form of an experiment, with what was filled in last."""
        groups = {"excitation": EXCITATION, "length": LENGTH, "limits": LIMITS}
        return {
            "fields": {name: [vars(one) for one in fields] for name, fields in groups.items()},
            "ports": ports(),
            "effects": EFFECTS,
            "lines": LINES,
            "simulated": SIMULATED,
            "files": [name for name in self.page.study.files if name.startswith("excitation/")],
            "last": self._form,
        }

    # ---- routes ----------------------------------------------------------------------------------------

    def routes(self) -> list[Route | WebSocketRoute]:
        """Routes of the server."""
        return [
            Route("/live/form", self._send_form),
            Route("/live/run", self._start, methods=["POST"]),
            WebSocketRoute("/live", self._watch),
        ]

    async def _send_form(self, _: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self.form))

    async def _start(self, request: Request) -> Response:
        self.start(await object_of(request, MAX_REQUEST))
        return JSONResponse({"begun": True})

    async def _watch(self, watcher: WebSocket) -> None:
        await watcher.accept()
        seat = None
        sender = None
        try:
            seat = self.sit(await watcher.receive_text())
            sender = asyncio.create_task(self._send(seat, watcher))
            while True:
                if await watcher.receive_text() == "take":
                    self.take_control(seat)
                else:
                    seat.read.set()
                    self.sign(seat)
        except WebSocketDisconnect:
            pass
        finally:
            if seat is not None:
                self.leave(seat)
            if sender is not None:
                sender.cancel()
                await asyncio.gather(sender, return_exceptions=True)

    async def _send(self, seat: Seat, watcher: WebSocket) -> None:
        """Send what is new when the page has read what was sent before; also at each beat of a run."""
        last = 0, 0
        while True:
            await seat.read.wait()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(seat.changed.wait(), BEAT_S)
            if not seat.changed.is_set() and not self.is_running:
                continue
            seat.changed.clear()
            seat.read.clear()
            text, last = self.message(seat, last)
            await watcher.send_text(text)
