"""The websocket of the workbench: values of the chosen model in, its simulated output beside the record out.

Each open page has a connection of its own. A request that arrives while another is simulated replaces those
that wait: the page follows the newest position of a slider, and none is queued.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from gsid.base.errors import GsidError, InputError
from gsid.models.load import load_plant
from gsid.records.files import read_record
from gsid.study.folder import Study
from gsid.webpage.actions import inside, reading_of
from gsid.webpage.bench import Bench, numbers_of, picture_of, sheet_of
from gsid.webpage.edits import Edit, edit_of
from gsid.webpage.words import words_of


class Workbench:
    """The model and the record that one page moves, prepared for the next request.

    Parameters
    ----------
    study : Study
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        self._of: tuple | None = None
        self._bench: Bench | None = None

    def answer(self, wanted: Mapping[str, Any]) -> dict[str, Any]:
        """The simulated output for a request, and the effects if the model or the record is another one.

        Parameters
        ----------
        wanted : mapping
            model, record: names in the study; options: as of a step. values, out, added: as of `edit_of`.
            points, window: of the picture; moved: without the measured output, which is there.
            sheet: whether the effects are sent again.

        Raises
        ------
        InputError
            The request, the files or the values are not valid.
        """
        edit = edit_of(wanted)
        sheet = self._prepare(wanted, edit)
        try:
            one = self._bench.simulated(edit.values, edit.out)
        except InputError as error:
            return sheet | words_of(error)  # the sliders are there to move the value back
        points, window = _points(wanted.get("points")), _window(wanted.get("window"))
        is_moved = wanted.get("moved") is True and not sheet
        picture = picture_of(one, points, window, with_measured=not is_moved)
        return sheet | {"picture": picture} | numbers_of(one)

    def _prepare(self, wanted: Mapping[str, Any], edit: Edit) -> dict[str, Any]:
        names = wanted.get("model"), wanted.get("record")
        paths = inside(self._study, names[0], "models/"), inside(self._study, names[1], "records/")
        options = wanted.get("options") or {}
        more = json.dumps([options, wanted.get("added")], sort_keys=True)
        now = (*names, *(path.stat().st_mtime_ns for path in paths), more)
        if self._bench is not None and self._of == now and not wanted.get("sheet"):
            return {}
        if self._bench is None or self._of != now:
            self._bench = None
            self._bench, self._of = _bench(*paths, options, edit), now
        fitted = self._bench.fitted
        return {
            "sheet": sheet_of(self._bench.model, len(edit.added)),
            "fitted": numbers_of(fitted) | {"n": fitted.y.shape[1], "name": fitted.name},
        }


def _bench(model_path: Path, record_path: Path, options: Mapping[str, Any], edit: Edit) -> Bench:
    how = reading_of(options)
    reference = how.pop("r", None)
    model, measured = load_plant(model_path), read_record(record_path, **how)
    if reference is not None:
        from gsid.diagnosis.closed_loop import in_closed_loop

        model, (measured,) = in_closed_loop(model, [measured], reference)
    return Bench(model, measured, edit)


def _points(given: object) -> int:
    return given if isinstance(given, int) else 1000


def _window(given: object) -> tuple[float, float] | None:
    if not isinstance(given, list) or len(given) != 2:
        return None
    is_valid = all(isinstance(one, int | float) and math.isfinite(one) for one in given)
    return (float(given[0]), float(given[1])) if is_valid and given[0] < given[1] else None


# ---- connection ----------------------------------------------------------------------------------------


async def follow_workbench(watcher: WebSocket, study: Study) -> None:
    """Answer the requests of one page until it goes away.

    Parameters
    ----------
    watcher : WebSocket
    study : Study
    """
    await watcher.accept()
    newest, arrived = _Newest(), asyncio.Event()
    sender = asyncio.create_task(_answer(watcher, Workbench(study), newest, arrived))
    try:
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                newest.request = await watcher.receive_text()
                arrived.set()
    finally:
        sender.cancel()
        await asyncio.gather(sender, return_exceptions=True)


class _Newest:
    """The request that waits; a newer one replaces it."""

    request = ""


async def _answer(watcher: WebSocket, bench: Workbench, newest: _Newest, arrived: asyncio.Event) -> None:
    while True:
        await arrived.wait()
        arrived.clear()
        text = await asyncio.to_thread(_answered, bench, newest.request)
        await watcher.send_text(text)


def _answered(bench: Workbench, request: str) -> str:
    """The answer as JSON; an error in words where there is none."""
    serial = None
    try:
        wanted = json.loads(request)
        if not isinstance(wanted, dict):
            raise InputError("the request is not an object", "", type(wanted).__name__)
        serial = wanted.get("serial")
        found = bench.answer(wanted)
    except InputError as error:
        found = words_of(error)
    except GsidError as error:
        found = {"error": error.message, "where": "", "hint": error.hint}
    except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        found = {"error": "the request is not valid", "where": f"{type(error).__name__}: {error}", "hint": ""}
    except Exception as error:  # the sliders wait for an answer
        found = {
            "error": "the simulation has failed",
            "where": f"{type(error).__name__}: {error}",
            "hint": "",
        }
    return json.dumps(found | {"serial": serial})
