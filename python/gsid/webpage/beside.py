"""Routes of the page for other studies, which are only read, and for several responses in one picture."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from gsid.base.errors import InputError
from gsid.study.folder import Study
from gsid.webpage.actions import inside
from gsid.webpage.body import object_of
from gsid.webpage.page import Page, title_of
from gsid.webpage.studies import MOST, comparison_of, responses_of, studies_beside, summary_of

MAX_REQUEST = 1 << 14  # bytes
SHOWN = 100  # characters of a wrong name in a message


class Beside:
    """What the page shows of other studies.

    Parameters
    ----------
    page : Page
    named : sequence of path_like
        Their folders on the command line; those beside the study are found.
    """

    def __init__(self, page: Page, named: Sequence[str | Path] = ()) -> None:
        self._page, self._named = page, named

    def routes(self) -> list[Route]:
        """Routes of the server."""
        return [
            Route("/studies", self._list),
            Route("/studies/compare", self._compare, methods=["POST"]),
            Route("/studies/steps", self._steps),
            Route("/studies/file", self._file),
            Route("/responses", self._responses, methods=["POST"]),
        ]

    def _folders(self) -> dict[str, Path]:
        return studies_beside(self._page.study, self._named)

    def _study(self, name: object) -> Study:
        """One of the listed studies: the page names no paths."""
        folder = self._folders().get(name) if isinstance(name, str) else None
        if folder is None:
            raise InputError("no such study", "", str(name)[:SHOWN], "choose one of the list")
        return Study(folder, create=False)

    async def _list(self, _: Request) -> Response:
        named = {str(Path(one).resolve()) for one in self._named}
        folders = await asyncio.to_thread(self._folders)
        shown = [{"name": name, "named": str(folder) in named} for name, folder in folders.items()]
        return JSONResponse({"studies": shown})

    async def _compare(self, request: Request) -> Response:
        names = _names(await object_of(request, MAX_REQUEST), "names")
        return JSONResponse(await asyncio.to_thread(self._comparison, names))

    def _comparison(self, names: list[str]) -> dict[str, Any]:
        own = self._page.study
        studies = {own.folder.name: own} | {name: self._study(name) for name in names}
        if len(studies) > MOST:
            raise InputError("too many studies for one table", "", len(studies), f"tick up to {MOST - 1}")
        return comparison_of([summary_of(study, name) for name, study in studies.items()])

    async def _steps(self, request: Request) -> Response:
        study = await asyncio.to_thread(self._study, request.query_params.get("name"))
        steps = [
            {"title": title_of(one), "words": one.words, "picture": one.picture, "command": one.command}
            for one in study.steps
        ]
        return JSONResponse({"steps": steps})

    async def _file(self, request: Request) -> Response:
        study = await asyncio.to_thread(self._study, request.query_params.get("name"))
        name = request.query_params.get("path")
        if name not in {one.picture for one in study.steps if one.picture}:
            raise InputError("no such picture in the study", "", str(name)[:SHOWN])
        place = study.path(name)
        headers = {"Content-Disposition": "attachment"}
        return FileResponse(place, media_type="application/json", headers=headers)

    async def _responses(self, request: Request) -> Response:
        names = _names(await object_of(request, MAX_REQUEST), "records")
        study = self._page.study
        for name in names:
            inside(study, name, "records/")
        return JSONResponse(await asyncio.to_thread(responses_of, study, names))


def _names(request: dict[str, Any], key: str) -> list[str]:
    names = request.get(key)
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names) or not names:
        raise InputError("nothing is chosen to compare with", "", None, "tick at least one")
    return names
