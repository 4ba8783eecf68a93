"""Experiments of the page while they run: who holds control, what is drawn, and what ends them.

The command `gsid run --attended` ends the run, with STOP and its record, when no sign of life has arrived
for 3 s. The server passes on the signs of life of the page that holds control, and gives none of its
own: the page, the browser or the server may hang or end, and the run stops.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
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
from gsid.rig import ABSENT_S
from gsid.study.folder import INTERRUPTED, Step
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
from gsid.webpage.interrupted import SERVER_ENDED, adopt_run, forget_run, has_note, note_run
from gsid.webpage.jobs import STOP_S, Job
from gsid.webpage.page import Page
from gsid.webpage.safety import new_token

FIGURES = b'{"live": '  # begins a line of figures on stderr
RECORD = b'{"record": '  # begins the line of the record that was written
HISTORY = 200  # sets of figures that a page which joins gets: 10 s
SIGN_S = 0.25  # shortest time between two signs of life that are passed on
ADOPT_S = 1.0  # between two attempts to note a step
LOOK_S = 0.05  # between two looks at who holds control
BEAT_S = 0.5  # longest time between two messages to a page while an experiment runs
MAX_REQUEST = 1 << 14
KILLED = (
    "gsid run was ended by force, and may not have sent STOP. Firmware that follows rule 7 of"
    " docs/reference/protocol.md sets the command to zero 0.25 s after the last frame: check that the axis"
    " stands still before you go near it."
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
    close_s = STOP_S  # after STOP a large record is written

    number: int = 0
    figures: deque[tuple[int, str]] = field(default_factory=lambda: deque(maxlen=HISTORY))
    response: tuple[int, str] = (0, "")
    on_figures: Any = None
    _n_figures: int = 0
    _sign_s: float = 0.0

    async def run(self, folder: Path, on_change: Callable[[], None]) -> None:
        """Run the command, then warn if it was ended by force."""
        await super().run(folder, on_change)
        if self.exit_code is not None and self.exit_code < 0:
            self.messages.append(KILLED)

    def takes(self, line: bytes) -> bool:
        """Keep a set of figures, or the record as a sentence."""
        if line.startswith(RECORD):
            found = json.loads(line)["record"]
            counts = f"{found['good']} good periods, {found['spoiled']} spoiled"
            self.messages.append(f"{found['path']} keeps {found['samples']} samples: {counts}.")
            return True
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
        self._is_preparing = False  # from the request on until the run begins
        self._adopting: asyncio.Task | None = None
        with contextlib.suppress(InputError):  # the study is in use: the first page tries again
            self._show_adopted(adopt_run(page.study))

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
        if has_note(self.page.study) and not self.is_running:
            self._adopt_later()
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
        return self._is_preparing or (self._stage is not None and self.page.job is self._stage)

    def changed(self) -> None:
        """Have something sent to every page."""
        for seat in self.seats:
            seat.changed.set()

    # ---- an experiment ---------------------------------------------------------------------------------

    async def start(self, form: Mapping[str, Any]) -> None:
        """Begin an experiment: its excitation, then the run, then a look at the record.

        Parameters
        ----------
        form : mapping
            As for `experiment_of`, and the token of the page, which gets the control.

        Raises
        ------
        InputError
            A field is not valid, another step runs, the last experiment is not noted, or the page has no
            connection.
        """
        token = form.get("token")
        if not isinstance(token, str) or not self._is_there(token):
            raise InputError("the page has no connection for live figures", "", None, "reload the page")
        with self.page.reserved():
            wanted = experiment_of(self.page.study, form)
            self.control = token
            self._form = {name: value for name, value in form.items() if name != "token"}
            self.page.is_stopped, self._is_preparing = False, True
            try:
                await self._prepare(wanted)
            except BaseException:
                self._is_preparing = False
                raise
            finally:
                self.changed()

    async def _prepare(self, wanted: Experiment) -> None:
        """Design the excitation, or run at once if there is one."""
        if has_note(self.page.study):
            self._show_adopted(await asyncio.to_thread(adopt_run, self.page.study))
        if has_note(self.page.study):
            raise InputError("the last run still writes its record", "", None, "wait until it has ended")
        if not wanted.design:
            await self._run(wanted, wanted.file)
            return
        number = await asyncio.to_thread(self.page.study.begin_step)
        if self.page.is_stopped:
            self._is_preparing = False
            return
        words, path = wanted.design_step(number)
        stage = Job(tuple(words))
        self.page.begin(stage, [path], number, lambda job: self._designed(job, wanted, path))
        self._stage = stage

    async def _designed(self, job: Job, wanted: Experiment, excitation: str) -> None:
        self.changed()
        try:
            if job.exit_code != 0 or self.page.is_stopped:
                return
            if not await self._has_control():
                raise InputError("the page that started the experiment has gone: it was not begun")
            await self._run(wanted, excitation)
        finally:
            self._is_preparing = False
            self.changed()

    async def _has_control(self) -> bool:
        """Whether a page holds control; one that is reloaded has the time in which a run goes on too."""
        end_s = time.monotonic() + ABSENT_S
        while not self._is_there(self.control) and time.monotonic() < end_s:
            await asyncio.sleep(LOOK_S)
        return self._is_there(self.control)

    async def _run(self, wanted: Experiment, excitation: str) -> None:
        """Begin the run: first all that can fail, so that no axis moves without signs of life."""
        study = self.page.study
        number = await asyncio.to_thread(study.begin_step)
        self._is_preparing = False
        if self.page.is_stopped:
            return
        self.page.check_idle()
        words, record = wanted.run_step(number, excitation)
        held = note_run(study, number, words, record)
        job = LiveJob(tuple(words), added=("--attended",), kept_open=(held,))
        job.number, job.on_figures = self._n_jobs + 1, self.changed
        self.job, self._stage, self._n_jobs = job, job, job.number
        self.page.begin(job, [record], number, lambda ended: self._ended(ended, number, record, held))

    async def _ended(self, job: Job, number: int, record: str, held: int) -> None:
        """Look at the record; make it of the journal if the run was ended by force."""
        self.changed()
        study = self.page.study
        try:
            step = await asyncio.to_thread(self._step, number)
            if step is not None:
                forget_run(study)
        finally:
            os.close(held)
        if step is None:
            exit_code = -signal.SIGKILL if job.exit_code is None else job.exit_code
            self._adopt_later("The run has ended, and its step could not be noted at once.", exit_code)
            return
        journal = f"{record}.journal"
        if (study.folder / record).is_file():
            await self._look(record)
        elif (study.folder / journal).is_file():
            words = ("run", f"--recover={journal}", "-o", record, "--json")
            recovery = await asyncio.to_thread(study.begin_step)
            self.page.begin(Job(words), [record], recovery, lambda job: self._recovered(job, record))

    async def _recovered(self, job: Job, record: str) -> None:
        if job.exit_code == 0:
            await self._look(record)

    async def _look(self, record: str) -> None:
        await self.page.request_step({"verb": "look", "records": [record]})

    # ---- steps that are noted later --------------------------------------------------------------------

    def _step(self, number: int) -> Step | None:
        """A step of the study; None if it is not noted, or the study cannot be read."""
        with contextlib.suppress(InputError, OSError):
            return next((one for one in self.page.study.steps if one.number == number), None)
        return None

    def _adopt_later(self, why: str = SERVER_ENDED, exit_code: int = INTERRUPTED) -> None:
        if self._adopting is None or self._adopting.done():
            self._adopting = asyncio.create_task(self._adopt(why, exit_code))

    async def _adopt(self, why: str, exit_code: int) -> None:
        """Note the step of a run that is not noted, as soon as it has ended and the study can be written."""
        while has_note(self.page.study):
            with contextlib.suppress(InputError, OSError):
                report = await asyncio.to_thread(adopt_run, self.page.study, why, exit_code)
                self._show_adopted(report)
            await asyncio.sleep(ADOPT_S)

    def _show_adopted(self, report: str | None) -> None:
        if report is not None:
            self.page.error = report or self.page.error
            self.page.read_study()

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
            "absent_s": ABSENT_S,
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
            "models": self.page.study.models,
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
        await self.start(await object_of(request, MAX_REQUEST))
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
