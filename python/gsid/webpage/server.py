"""The server of the page: files in, steps requested, pictures out; a websocket sends every change."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import uvicorn
from filelock import FileLock, Timeout
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from gsid.base.errors import InputError
from gsid.base.tables import templates
from gsid.effects.types import catalogue
from gsid.study.folder import usable_name
from gsid.webpage.beside import Beside
from gsid.webpage.body import object_of
from gsid.webpage.edits import law_of
from gsid.webpage.jobs import COMMAND
from gsid.webpage.kept import Kept
from gsid.webpage.live import Live
from gsid.webpage.page import Page
from gsid.webpage.safety import Guard, new_token
from gsid.webpage.words import words_of
from gsid.webpage.workbench import follow_workbench

MAX_REQUEST = 1 << 16  # bytes of a requested step
LOCK = ".server.lock"
UPLOAD = ".upload-"  # begins the name of the folder of a file that arrives
INVALID = (OSError, ValueError, TypeError, OverflowError, RecursionError)  # by a value of a request


# ---- routes ----------------------------------------------------------------------------------------------


def _page_of(request: Request | WebSocket) -> Page:
    return request.app.state.page


async def _index(request: Request) -> Response:
    page = _page_of(request)
    effects = [one for one in catalogue().values() if one.null_kind != "never"]
    text = templates().get_template("studio.html").render(folder=page.study.folder.name, effects=effects)
    return Response(text, media_type="text/html")


async def _state(request: Request) -> Response:
    return JSONResponse(_page_of(request).state())


async def _request_step(request: Request) -> Response:
    await _page_of(request).request_step(await _wanted(request))
    return JSONResponse({"begun": True})


async def _check_law(request: Request) -> Response:
    return JSONResponse(law_of(await _wanted(request)))


async def _wanted(request: Request) -> dict[str, Any]:
    return await object_of(request, MAX_REQUEST)


async def _stop(request: Request) -> Response:
    _page_of(request).stop()
    return JSONResponse({"stopped": True})


async def _upload(request: Request) -> Response:
    """A file as the body, its name in the query: it is read in blocks and never wholly in memory."""
    page = _page_of(request)
    name = usable_name(request.query_params.get("name", ""))
    with tempfile.TemporaryDirectory(dir=page.study.folder, prefix=UPLOAD) as folder:
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
        kept = await page.add_file(place, name, request.query_params.get("with") == "last")
    return JSONResponse({"record": kept, "columns": page.state()["columns"].get(kept, [])})


async def _file(request: Request) -> Response:
    """A file of the study, always to save: never shown as a page of this server."""
    place = _page_of(request).study.path(request.path_params["name"])
    headers = {"Content-Disposition": "attachment"}
    kind = "application/json" if place.suffix == ".json" else "application/octet-stream"
    return FileResponse(place, media_type=kind, headers=headers)


async def _script(request: Request) -> Response:
    """The Python script that repeats the study, as the command writes it."""
    words = (*COMMAND, "-C", str(_page_of(request).study.folder), "script")
    writes = await asyncio.create_subprocess_exec(
        *words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    text, messages = await writes.communicate()
    if writes.returncode != 0:
        place = messages.decode("utf-8", "replace")
        return JSONResponse({"error": "the script cannot be written", "where": place, "hint": ""}, 500)
    headers = {"Content-Disposition": "attachment; filename=study.py"}
    return Response(text, media_type="application/octet-stream", headers=headers)


async def _changes(watcher: WebSocket) -> None:
    page = _page_of(watcher)
    await watcher.accept()
    changed = asyncio.Event()
    changed.set()
    page.watchers.add(changed)
    sender = asyncio.create_task(_send_changes(page, watcher, changed))
    try:
        while (await watcher.receive())["type"] != "websocket.disconnect":
            pass
    finally:
        page.watchers.discard(changed)
        sender.cancel()
        await asyncio.gather(sender, return_exceptions=True)


async def _send_changes(page: Page, watcher: WebSocket, changed: asyncio.Event) -> None:
    """Send the newest state; a watcher that does not read misses those between and delays no other."""
    while True:
        await changed.wait()
        changed.clear()
        await watcher.send_text(json.dumps(page.state()))


async def _workbench(watcher: WebSocket) -> None:
    await follow_workbench(watcher, _page_of(watcher).study)


async def _disconnected(_: Request, error: Exception) -> Response:
    """The browser went away in the middle of an upload."""
    return Response(status_code=400)


async def _refused(_: Request, error: Any) -> Response:
    """Bad input as JSON: what, where, the value and what to do."""
    return JSONResponse(words_of(error), 400)


async def _invalid(_: Request, error: Exception) -> Response:
    """A request with a value of the wrong type, a name that no file can have, or too deep a nesting."""
    place = f"{type(error).__name__}: {error}"
    if isinstance(error, OSError) and error.errno not in (errno.ENAMETOOLONG, errno.EINVAL, errno.EILSEQ):
        hint = "check the free space and the permissions of the study"
        return JSONResponse(
            {"error": "the study cannot be read or written", "where": place, "hint": hint}, 500
        )
    return JSONResponse({"error": "the request is not valid", "where": place, "hint": ""}, 400)


def application(page: Page, port: int, token: str, beside: Sequence[str] = ()) -> Guard:
    """The server of a page, guarded.

    Parameters
    ----------
    page : Page
    port : int
    token : str
    beside : sequence of str
        Folders of other studies, to compare with.
    """
    import plotly

    static = files("gsid.webpage") / "static"
    plotly_js = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"

    async def _plotly(_: Request) -> Response:
        return FileResponse(plotly_js, media_type="text/javascript")

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        following = asyncio.create_task(page.follow())
        yield
        following.cancel()
        await page.close()

    app = Starlette(
        routes=[
            Route("/", _index),
            Route("/state", _state),
            Route("/study.py", _script),
            Route("/steps", _request_step, methods=["POST"]),
            Route("/law", _check_law, methods=["POST"]),
            Route("/stop", _stop, methods=["POST"]),
            Route("/records", _upload, methods=["POST"]),
            Route("/files/{name:path}", _file),
            Route("/plotly.min.js", _plotly),
            WebSocketRoute("/changes", _changes),
            WebSocketRoute("/workbench", _workbench),
            *Live(page).routes(),
            *Beside(page, beside).routes(),
            *Kept(page.study).routes(),
            Mount("/static", StaticFiles(directory=str(static))),
        ],
        exception_handlers={InputError: _refused, ClientDisconnect: _disconnected}
        | dict.fromkeys(INVALID, _invalid),
        lifespan=lifespan,
    )
    app.state.page = page
    return Guard(app, port, token)


class _Server(uvicorn.Server):
    """A server that stops what runs before it waits for its connections: an axis must not run on."""

    def __init__(self, config: uvicorn.Config, page: Page) -> None:
        super().__init__(config)
        self._page = page

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._page.stop()
        await super().shutdown(sockets)


def serve(page: Page, port: int, on_address: Callable[[str], None], beside: Sequence[str] = ()) -> None:
    """Serve the page on 127.0.0.1 until the process is interrupted.

    Parameters
    ----------
    page : Page
    port : int
        0: any free port.
    on_address : callable
        Called with the address, its token included, when the server accepts connections.
    beside : sequence of str
        As of `application`.

    Raises
    ------
    InputError
        The port cannot be opened, or another server has the study.
    """
    with _locked(page.study.folder), _listener(port) as listener:
        own = listener.getsockname()[1]
        token = new_token()
        config = uvicorn.Config(
            application(page, own, token, beside),
            log_level="warning",
            ws_max_size=MAX_REQUEST,
            lifespan="on",
            timeout_graceful_shutdown=2,
        )
        server = _Server(config, page)
        for number in (signal.SIGTERM, signal.SIGHUP):  # the second: the terminal was closed
            if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
                signal.signal(number, server.handle_exit)
        on_address(f"http://127.0.0.1:{own}/?token={token}")
        server.run(sockets=[listener])


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """One server for a study: two would run commands that write the same files."""
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        hint = "use its page, or name another --folder"
        raise InputError("the study is open in another gsid studio", str(folder), None, hint) from error
    try:
        for unfinished in folder.glob(f"{UPLOAD}*"):  # of a server that was killed
            shutil.rmtree(unfinished, ignore_errors=True)
        yield
    finally:
        lock.release()


def _listener(port: int) -> socket.socket:
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise InputError(
            "the port cannot be opened", f"127.0.0.1:{port}", error.strerror, "choose another --port"
        ) from error
    return listener
