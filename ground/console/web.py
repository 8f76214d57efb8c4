"""The console in a browser on this machine: `textual-serve` runs one for each session, all on one feed of flight.

Sessions read; those whose address has the token of the server may order. Nothing is fetched from elsewhere.
"""

from __future__ import annotations

import copy
import hmac
import os
import re
import string
from pathlib import Path
from typing import Any

from aiohttp import web
from textual_serve.server import Server

from ground.errors import OperatorError

HOST = "127.0.0.1"
TITLE = "leonav console"
_TOKEN = re.compile(r"[A-Za-z0-9_-]{20,200}")
_PAGE = Path(__file__).with_name("web_page.html")
_POLICY = "default-src 'self' 'unsafe-inline' data:; connect-src 'self' ws://{host}; frame-ancestors 'none'"


def read_token(path: Path) -> str:
    """The token of a file; OperatorError where it cannot be used."""
    try:
        if os.name == "posix" and path.stat().st_mode & 0o077:
            raise OperatorError(f"--token {path}: others may read or change it; chmod 600 {path}")
        token = path.read_text(encoding="ascii").strip()
    except OSError as error:
        raise OperatorError(f"--token {path}: cannot be read ({error.strerror})") from None
    except ValueError:
        token = ""
    if not _TOKEN.fullmatch(token):
        raise OperatorError(f"--token {path}: give one line of 20 to 200 letters, digits, - and _")
    return token


class ConsoleServer(Server):
    """Serves consoles on one port of this machine.

    reading, ordering: commands of a session that reads, and of one that may order, which takes the token.
    """

    def __init__(self, port: int, reading: str, ordering: str | None = None, token: str | None = None) -> None:
        super().__init__(reading, host=HOST, port=port, title=TITLE)
        self._ordering = ordering
        self._token = token
        self._page = string.Template(_PAGE.read_text(encoding="utf-8"))

    def initialize_logging(self) -> None:
        """None of its own: the command line has said where to look."""

    async def on_startup(self, app: web.Application) -> None:
        """Nothing to print."""

    async def _make_app(self) -> web.Application:
        app: web.Application = await super()._make_app()
        app.middlewares.append(self._guard)
        app.router.add_get("/ws/{token}", self.handle_websocket)
        return app

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Only pages of this server, under a name of this machine, with the right token or none."""
        names = {f"{host}:{self.port}" for host in (HOST, "localhost")}
        if request.host not in names:
            raise web.HTTPForbidden(text=f"this console answers to {HOST}:{self.port} only")
        origin = request.headers.get("Origin")
        if origin is not None and origin.removeprefix("http://") not in names:
            raise web.HTTPForbidden(text="asked by a page of another server")
        given = _given(request)
        if given is not None and not self._is_token(given):
            raise web.HTTPForbidden(text="wrong token")
        response: web.StreamResponse = await handler(request)
        if not response.prepared:
            response.headers["Content-Security-Policy"] = _POLICY.format(host=request.host)
            response.headers["Referrer-Policy"] = "no-referrer"
            response.headers["Cache-Control"] = "no-store"
        return response

    def _is_token(self, given: str) -> bool:
        return self._token is not None and hmac.compare_digest(given.encode(), self._token.encode())

    async def handle_index(self, request: web.Request) -> web.Response:
        """The page; what it connects to carries the token on."""
        given = _given(request)
        websocket = f"ws://{request.host}/ws" + (f"/{given}" if given is not None else "")
        return web.Response(
            text=self._page.substitute(title=TITLE, websocket=websocket), content_type="text/html", charset="utf-8"
        )

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        """A session; one that may order where its address has the token."""
        session = copy.copy(self)
        if _given(request) is not None and self._ordering is not None:
            session.command = self._ordering
        response: web.WebSocketResponse = await Server.handle_websocket(session, request)
        return response


def _given(request: web.Request) -> str | None:
    """The token in an address, right or wrong: it has passed `_guard` where it is right."""
    return request.query.get("token") or request.match_info.get("token")
