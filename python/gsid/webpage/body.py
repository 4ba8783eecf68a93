"""The body of a request, up to a limit."""

from __future__ import annotations

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
