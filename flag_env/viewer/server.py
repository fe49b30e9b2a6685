"""Serves a show to browsers on this machine: the page's few files over HTTP, and frames over a WebSocket on the same port.

Nobody else gets in: it listens on the loopback address; a request must name it as its host, so that no other name can be made to
point here; and a WebSocket must come from its own page. A page gets the newest frame alone, and none while two are on their way
to it: whoever reads slowly sees fewer frames, and nothing piles up.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from importlib.resources import files
from typing import Any, Protocol, TypeVar

from websockets.asyncio.server import Server as SocketServer
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from flag_env.viewer.wire import ACK, LARGEST_MESSAGE

HOST = "127.0.0.1"
PORT = 8400

RATE = 30.0
"""Frames a second."""

STATUS_EVERY = 5
"""Frames from one status message to the next."""

ON_THEIR_WAY = 2
"""Frames sent to a page and not yet acknowledged, at most."""

SCRIPTS = ("view", "shaders", "surface", "graphics", "draw", "plot", "panel", "live")

PAGES = {
    "/": ("page.html", "text/html; charset=utf-8"),
    "/style.css": ("style.css", "text/css; charset=utf-8"),
    **{f"/{name}.js": (f"{name}.js", "text/javascript; charset=utf-8") for name in SCRIPTS},
}

_OWN_NAME = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")

_T = TypeVar("_T")


class Show(Protocol):
    """What can be served; every call comes from one and the same thread."""

    @property
    def version(self) -> int:
        """Of the description."""

    def handle(self, text: str | bytes) -> str:
        """Take a message; return why it is refused, or ""."""

    def advance(self, seconds: float) -> bytes:
        """Let time pass, and return the frame."""

    def describe(self) -> dict[str, Any]:
        """What the frames of this version need."""

    def status(self) -> dict[str, Any]:
        """Readouts."""


class Page:
    """One open page: what it has been sent."""

    def __init__(self) -> None:
        self.on_their_way, self.version, self.status = 0, -1, ""


class Server:
    """Serves one show to any number of pages.

    Parameters
    ----------
    show
        What is seen.
    port
        0: any free one. None: `PORT`, or any free one if that is taken.

    Attributes
    ----------
    address
        Of the page, once `start` is done.
    pages
        How many are open.
    """

    def __init__(self, show: Show, port: int | None = None) -> None:
        self._show, self._port = show, port
        self._one = ThreadPoolExecutor(1, "show")
        self._frame, self._number, self._version = b"", 0, -1
        self._description, self._status = "", ""
        self._news = asyncio.Condition()
        self.address, self.pages = "", 0

    async def start(self) -> None:
        """Open the port.

        Raises
        ------
        OSError
            If the port that was asked for is taken.
        """
        try:
            self._socket = await self._open(PORT if self._port is None else self._port)
        except OSError as error:
            if self._port is not None:
                raise OSError(f"port {self._port} cannot be opened ({error.strerror}); take another, or 0 for any") from error
            self._socket = await self._open(0)
        self.address = f"http://{HOST}:{self._socket.sockets[0].getsockname()[1]}/"

    async def run(self) -> None:
        """Serve until cancelled. While no page is open, time stands still."""
        last = time.perf_counter()
        try:
            while True:
                await asyncio.sleep(max(0.0, last + 1.0 / RATE - time.perf_counter()))
                now = time.perf_counter()
                seconds, last = min(now - last, 0.1), now
                if self.pages:
                    await self._tick(seconds)
        finally:
            self._socket.close()
            await self._socket.wait_closed()
            self._one.shutdown(wait=False, cancel_futures=True)

    async def _tick(self, seconds: float) -> None:
        self._frame = await self._call(self._show.advance, seconds)
        version = self._show.version
        if version != self._version:
            self._version, self._description = version, json.dumps(await self._call(self._show.describe))
        if self._number % STATUS_EVERY == 0:
            self._status = json.dumps(await self._call(self._show.status))
        self._number += 1
        async with self._news:
            self._news.notify_all()

    async def _call(self, function: Callable[..., _T], *arguments: Any) -> _T:
        return await asyncio.get_running_loop().run_in_executor(self._one, function, *arguments)

    # -- sockets ----------------------------------------------------------------------------------------------------------------

    async def _open(self, port: int) -> SocketServer:
        return await serve(
            self._converse, HOST, port, process_request=self._answer, max_size=LARGEST_MESSAGE, max_queue=8, compression=None,
            write_limit=2**16, close_timeout=1.0,
        )  # fmt: skip

    async def _converse(self, socket: ServerConnection) -> None:
        page = Page()
        self.pages += 1
        sending = asyncio.create_task(self._send(socket, page))
        try:
            async for text in socket:
                if text == ACK:
                    page.on_their_way = max(0, page.on_their_way - 1)
                elif refusal := await self._call(self._show.handle, text):
                    await socket.send(json.dumps({"type": "refused", "message": refusal}))
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()
            self.pages -= 1

    async def _send(self, socket: ServerConnection, page: Page) -> None:
        """Send the newest frame whenever there is one and the page keeps up."""
        with contextlib.suppress(ConnectionClosed):
            while True:
                async with self._news:
                    await self._news.wait()
                if page.on_their_way >= ON_THEIR_WAY:
                    continue
                page.on_their_way += 1
                frame, version, status = self._frame, self._version, self._status
                if version != page.version:
                    page.version = version
                    await socket.send(self._description)
                if status != page.status:
                    page.status = status
                    await socket.send(status)
                await socket.send(frame)

    def _answer(self, socket: ServerConnection, request: Request) -> Response | None:
        """Refuse strangers; hand out a file; None: go on with a WebSocket."""
        host = request.headers.get("Host", "")
        if not _OWN_NAME.fullmatch(host):
            return socket.respond(HTTPStatus.FORBIDDEN, f"host must be {HOST} or localhost\n")
        if request.path == "/socket":
            if request.headers.get("Origin") != f"http://{host}":
                return socket.respond(HTTPStatus.FORBIDDEN, "origin must be this server's own page\n")
            return None
        if request.path not in PAGES:
            return socket.respond(HTTPStatus.NOT_FOUND, "no such page\n")
        name, kind = PAGES[request.path]
        body = static(name).encode()
        policy = f"default-src 'none'; script-src 'self'; style-src 'self'; connect-src ws://{host}; img-src data:"
        headers = Headers(
            {
                "Content-Type": kind,
                "Content-Length": str(len(body)),
                "Content-Security-Policy": policy + "; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
                "X-Content-Type-Options": "nosniff",
                "Referrer-Policy": "no-referrer",
                "Cache-Control": "no-store",
                "Connection": "close",
            }
        )
        return Response(HTTPStatus.OK, "OK", headers, body)


def static(name: str) -> str:
    """One of the page's files."""
    return (files("flag_env.viewer") / "static" / name).read_text(encoding="utf-8")
