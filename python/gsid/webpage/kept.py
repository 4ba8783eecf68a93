"""What a page keeps in the study for its next reload: sliders, how records are read, the chosen model."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.base.json_files import read_json
from gsid.study.folder import Study
from gsid.webpage.body import object_of

NAME = "page.json"
MOST = 1 << 16  # bytes


class Kept:
    """The file of the study; the newest page that writes it wins.

    Parameters
    ----------
    study : Study
    """

    def __init__(self, study: Study) -> None:
        self._place = study.folder / NAME

    def routes(self) -> list[Route]:
        """Routes of the server."""
        return [Route("/kept", self._send), Route("/kept", self._receive, methods=["POST"])]

    async def _send(self, _: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self._read))

    async def _receive(self, request: Request) -> Response:
        wanted = await object_of(request, MOST)
        await asyncio.to_thread(self._write, wanted)
        return JSONResponse({"kept": True})

    def _read(self) -> dict[str, Any]:
        """What was kept; nothing if the file is not there or not valid: a page opens without."""
        try:
            if self._place.is_symlink() or self._place.stat().st_size > MOST:
                return {}
            found = read_json(self._place)
        except (InputError, OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _write(self, wanted: dict[str, Any]) -> None:
        if self._place.is_symlink():
            hint = "replace the link by what it leads to"
            raise InputError("a study has no symbolic links", str(self._place), None, hint)
        write_atomically(self._place, lambda part: part.write_text(json.dumps(wanted), encoding="utf-8"))
