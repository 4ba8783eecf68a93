"""The body of a request, up to a limit, and what it holds."""

from __future__ import annotations

import json
import math
from typing import Any

from starlette.requests import Request

from gsid.base.errors import InputError


async def body_of(request: Request, most: int) -> bytes:
    """Read the body of a request.

    Parameters
    ----------
    request : Request
    most : int
        Largest number of bytes.

    Raises
    ------
    InputError
        It is longer.
    """
    body = bytearray()
    async for block in request.stream():
        body += block
        if len(body) > most:
            raise InputError("the request is too long", "", f"more than {most} bytes")
    return bytes(body)


async def object_of(request: Request, most: int) -> dict[str, Any]:
    """Read a body that is a JSON object.

    Parameters
    ----------
    request : Request
    most : int
        Largest number of bytes.

    Raises
    ------
    InputError
        It is longer, or something else.
    """
    try:
        found = json.loads(await body_of(request, most))
    except ValueError as error:
        raise InputError("the request is not JSON", "", error) from error
    if not isinstance(found, dict):
        raise InputError("the request is not an object", "", type(found).__name__)
    return found


def number_of(value: object) -> float:
    """A number of a request, or its text; not a number (nan) for anything else.

    Parameters
    ----------
    value : object
    """
    try:
        is_number = isinstance(value, (str, int, float)) and not isinstance(value, bool)
        return float(value) if is_number else math.nan  # type: ignore[arg-type]
    except (ValueError, OverflowError):
        return math.nan
