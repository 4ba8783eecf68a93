"""The server of the page: files in, commands run, pictures out, and a websocket that sends every change."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import tempfile
from collections.abc import AsyncIterator, Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from gsid.base.errors import InputError
from gsid.base.tables import templates
from gsid.study.folder import Step, Study
from gsid.webpage.actions import ACTIONS, command_of
from gsid.webpage.jobs import Job
from gsid.webpage.safety import Guard, new_token
from gsid.webpage.words import outcome_of

WISH_MOST = 1 << 16  # bytes of a posted wish
MAX_UPLOAD = 200 << 20


class Page:
    """The state of one page: its study, and the command that runs.

    Parameters
    ----------
    study : Study
    max_upload : int
        Largest file that is accepted [bytes].
    """

    def __init__(self, study: Study, max_upload: int = MAX_UPLOAD) -> None:
        self.study, self.max_upload = study, max_upload
        self.job: Job | None = None
        self.outputs: list[str] = []
        self.followups: dict[int, dict] = {}
        self.watchers: set[WebSocket] = set()
        self._running: asyncio.Task | None = None

    # ---- what is shown -------------------------------------------------------------------------------

    def state(self) -> dict:
        """Everything that the page shows, but the pictures."""
        steps = self.study.steps
        return {
            "folder": self.study.folder.name,
            "records": sorted(name for name in self.study.files if name.startswith("records/")),
            "models": [name for one in steps for name in one.outputs if name.startswith("models/")],
            "steps": [self._shown(one) for one in steps],
            "job": None if self.job is None else self._job(),
            "actions": {verb: vars(action) for verb, action in ACTIONS.items()},
        }

    def _shown(self, step: Step) -> dict:
        pictures = [name for name in step.outputs if name.startswith("verdicts/")]
        own = {"number": step.number, "verb": step.verb, "command": step.command, "words": step.words}
        more = self.followups.get(step.number, {"effects": [], "next": []})
        return own | more | {"failed": step.exit_code != 0, "picture": pictures[0] if pictures else None}

    def _job(self) -> dict:
        return {
            "command": " ".join(["gsid", *self.job.arguments]),
            "step": self.job.step,
            "verb": self.job.arguments[0],
        }

    async def send_state(self) -> None:
        """Send the state to every page that watches."""
        text = json.dumps(self.state())
        for watcher in list(self.watchers):
            with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
                await watcher.send_text(text)

    # ---- what is done --------------------------------------------------------------------------------

    async def wish(self, wanted: dict) -> None:
        """Begin the step that the page asks for.

        Raises
        ------
        InputError
            Another one runs, or the wish is not understood.
        """
        if self.job is not None:
            raise InputError("another step is running", "", self.job.arguments[0], "wait, or stop it")
        arguments, self.outputs = command_of(self.study, wanted)
        self.job = Job(tuple(arguments))
        self._running = asyncio.create_task(self._run(self.job))
        await self.send_state()

    async def _run(self, job: Job) -> None:
        try:
            await job.run(self.study.folder, self.send_state)
            found = outcome_of(job.arguments[0], job.exit_code, job.answer, job.messages)
            step = self.study.add_step(
                job.arguments, job.exit_code, words=found.sentences, outputs=self.outputs
            )
            self.followups[step.number] = {"effects": found.effects, "next": found.next}
        finally:
            self.job = None
            await self.send_state()

    async def cancel(self) -> None:
        """Stop the step that runs; it keeps what it has found."""
        if self.job is not None:
            await self.job.cancel()

    async def close(self) -> None:
        """End what runs, when the server ends."""
        if self._running is not None and not self._running.done():
            self._running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._running


# ---- routes ----------------------------------------------------------------------------------------------


def _page_of(request: Request | WebSocket) -> Page:
    return request.app.state.page


async def _index(request: Request) -> Response:
    page = _page_of(request)
    text = templates().get_template("studio.html").render(folder=page.study.folder.name)
    return Response(text, media_type="text/html")


async def _state(request: Request) -> Response:
    return JSONResponse(_page_of(request).state())


async def _wish(request: Request) -> Response:
    try:
        wanted = json.loads(await _body(request, WISH_MOST))
    except ValueError as error:
        raise InputError("the wish is not JSON", "", error) from error
    if not isinstance(wanted, dict):
        raise InputError("the wish is not an object", "", type(wanted).__name__)
    await _page_of(request).wish(wanted)
    return JSONResponse({"begun": True})


async def _cancel(request: Request) -> Response:
    await _page_of(request).cancel()
    return JSONResponse({"stopped": True})


async def _upload(request: Request) -> Response:
    """A file as the body, its name in the query: it is read in blocks and never wholly in memory."""
    page = _page_of(request)
    name = Path(request.query_params.get("name", "")).name
    if not name or name.startswith(".") or not name.isprintable():
        raise InputError("the file has no usable name", "", name, "rename the file")
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "upload"
        size = 0
        with open(place, "wb") as file:
            async for block in request.stream():
                size += len(block)
                if size > page.max_upload:
                    raise InputError(
                        f"the file is larger than {page.max_upload >> 20} MB",
                        name,
                        None,
                        "give --max-upload MB",
                    )
                file.write(block)
        kept = await asyncio.to_thread(page.study.add_file, place, name)
    await page.send_state()
    return JSONResponse({"record": kept})


async def _body(request: Request, most: int) -> bytes:
    body = b""
    async for block in request.stream():
        body += block
        if len(body) > most:
            raise InputError("the request is too long", "", f"more than {most} bytes")
    return body


async def _file(request: Request) -> Response:
    """A file of the study, always to save: never shown as a page of this server."""
    place = _page_of(request).study.path(request.path_params["name"])
    headers = {"Content-Disposition": "attachment"}
    kind = "application/json" if place.suffix == ".json" else "application/octet-stream"
    return FileResponse(place, media_type=kind, headers=headers)


async def _changes(watcher: WebSocket) -> None:
    page = _page_of(watcher)
    await watcher.accept()
    page.watchers.add(watcher)
    try:
        await watcher.send_text(json.dumps(page.state()))
        while True:
            await watcher.receive_text()
    except WebSocketDisconnect:
        pass
    finally:
        page.watchers.discard(watcher)


async def _left(_: Request, error: Exception) -> Response:
    """The browser went away in the middle of an upload."""
    return Response(status_code=400)


async def _refused(_: Request, error: Any) -> Response:
    """Bad input as JSON: what, where, the value and what to do."""
    place = ": ".join(str(part) for part in (error.where, error.value) if part not in (None, ""))
    return JSONResponse({"error": error.what, "where": place, "hint": error.hint or ""}, 400)


def application(page: Page, port: int, token: str) -> Guard:
    """The server of a page, guarded.

    Parameters
    ----------
    page : Page
    port : int
    token : str
    """
    import plotly

    static = files("gsid.webpage") / "static"
    plotly_js = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"

    async def _plotly(_: Request) -> Response:
        return FileResponse(plotly_js, media_type="text/javascript")

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        await page.close()

    app = Starlette(
        routes=[
            Route("/", _index),
            Route("/state", _state),
            Route("/steps", _wish, methods=["POST"]),
            Route("/stop", _cancel, methods=["POST"]),
            Route("/records", _upload, methods=["POST"]),
            Route("/files/{name:path}", _file),
            Route("/plotly.min.js", _plotly),
            WebSocketRoute("/changes", _changes),
            Mount("/static", StaticFiles(directory=str(static))),
        ],
        exception_handlers={InputError: _refused, ClientDisconnect: _left},
        lifespan=lifespan,
    )
    app.state.page = page
    return Guard(app, port, token)


def serve(page: Page, port: int, on_address: Callable[[str], None]) -> None:
    """Serve the page on 127.0.0.1 until the process is interrupted.

    Parameters
    ----------
    page : Page
    port : int
        0: any free port.
    on_address : callable
        Called with the address, its token included, when the server accepts connections.

    Raises
    ------
    OSError
        The port is in use.
    """
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind(("127.0.0.1", port))
    listener.listen()
    own = listener.getsockname()[1]
    token = new_token()
    config = uvicorn.Config(
        application(page, own, token), log_level="warning", ws_max_size=WISH_MOST, lifespan="on"
    )
    on_address(f"http://127.0.0.1:{own}/?token={token}")
    with listener:
        uvicorn.Server(config).run(sockets=[listener])
