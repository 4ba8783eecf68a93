"""Access control of the server: this computer's own page, with the token of its address.

A server on 127.0.0.1 can be reached by every page that the browser has open. A foreign page is refused by the
Host header (DNS rebinding), by the Origin header (forged posts and websockets), and by a cookie that is not
sent across sites. The token is in the address that `gsid studio` prints, and is exchanged for the cookie,
which is another secret. The browser gets the address in a file that only its user can read: the words of a
command can be read by all users of the computer.
"""

from __future__ import annotations

import secrets
from html import escape
from pathlib import Path
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SAFE_METHODS = ("GET", "HEAD")
# plotly.js writes style attributes and data: images; scripts come from this server only.
POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """ASGI middleware that refuses requests from elsewhere.

    Parameters
    ----------
    app : ASGI application
    port : int
        Of the server: part of the hosts and origins that are accepted.
    token : str
    """

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self.app, self.token, self.secret = app, token, new_token()
        self.cookie = f"gsid_studio_{port}"  # cookies of a host are shared by its ports
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        refusal = self._refusal(scope, headers)
        if refusal is None:
            await self.app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
        else:
            await refusal(scope, receive, self._with_headers(send))

    def _refusal(self, scope: Scope, headers: Headers) -> Response | None:
        """An answer instead of the page; None if the request may pass."""
        host = headers.get("host", "")
        if host not in self.hosts:
            return PlainTextResponse("The address of this server is 127.0.0.1.", 403)
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if changes and headers.get("origin") != f"http://{host}":
            return PlainTextResponse("The request comes from another page.", 403)
        if _equal(cookie_parser(headers.get("cookie", "")).get(self.cookie, ""), self.secret):
            return None
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        if scope["type"] == "http" and scope["path"] == "/" and _equal(given, self.token):
            # not a redirect: a browser that came from a file would not send a strict cookie along with it
            answer = HTMLResponse(forward("/"))
            answer.set_cookie(self.cookie, self.secret, httponly=True, samesite="strict")
            return answer
        return PlainTextResponse("Open the address that gsid studio printed: it has the token.", 403)

    @staticmethod
    def _with_headers(send: Send) -> Send:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        return with_headers


def new_token() -> str:
    """A token that cannot be guessed."""
    return secrets.token_urlsafe(24)


def _equal(one: str, other: str) -> bool:
    return secrets.compare_digest(one.encode(), other.encode())


def forward(address: str) -> str:
    """A page that opens another address.

    Parameters
    ----------
    address : str
    """
    target = escape(address, quote=True)
    return (
        f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url={target}">'
        '<link rel="icon" href="data:,">'  # else a browser asks for one that is not there
        f'<title>gsid studio</title><a href="{target}">gsid studio</a>\n'
    )


def file_that_opens(address: str, folder: Path) -> Path:
    """Write a page that opens an address with its token; only its owner can read it.

    Parameters
    ----------
    address : str
    folder : Path

    Returns
    -------
    Path
    """
    place = folder / "open.html"
    place.touch(mode=0o600, exist_ok=False)
    place.write_text(forward(address), encoding="utf-8")
    return place
