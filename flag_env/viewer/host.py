"""`flag-env play` and `render_mode="human"`: a server, and a browser pointed at it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import webbrowser
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flag_env.viewer.server import Server, Show

MISSING = 'the live page needs the extra "play": pip install -e ".[play]"'


def play(show: Show, port: int | None = None, browser: bool = True) -> None:
    """Serve a show until interrupted; prints the page's address.

    Parameters
    ----------
    show
        A `Session`, say.
    port
        See `Server`.
    browser
        Whether to open it in a browser.

    Raises
    ------
    ImportError
        If the extra "play" is not installed.
    OSError
        If the port that was asked for is taken.
    """
    server = make_server(show, port)

    async def serve() -> None:
        await server.start()
        print(f"{server.address}  (Ctrl+C ends it)", flush=True)  # noqa: T201
        if browser:
            open_browser(server.address)
        await server.run()

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve())


def make_server(show: Show, port: int | None) -> Server:
    """A server, not yet started; ImportError if the extra "play" is not installed."""
    try:
        from threadpoolctl import threadpool_limits

        from flag_env.viewer.server import Server
    except ImportError as error:
        raise ImportError(f"{MISSING} ({error})") from error
    threadpool_limits(1, user_api="blas")  # a step limit is found ten times sooner than on many threads
    return Server(show, port)


def open_browser(address: str) -> bool:
    """Open the page; False where there is no browser or no display."""
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False


class Background:
    """A server in a thread of its own, for a program that goes on meanwhile.

    Parameters
    ----------
    show, port
        As for `play`.

    Attributes
    ----------
    address
        Of the page.
    """

    def __init__(self, show: Show, port: int | None = None) -> None:
        self._server = make_server(show, port)
        self._ready = threading.Event()
        self._failed: list[OSError] = []
        self._task: asyncio.Task[None] | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._work, name="viewer", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._failed:
            raise self._failed[0]
        self.address = self._server.address

    def close(self) -> None:
        """Stop serving; further calls do nothing."""
        if self._thread.is_alive() and self._task is not None:
            self._loop.call_soon_threadsafe(self._task.cancel)
            self._thread.join(5.0)

    def _work(self) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        try:
            await self._server.start()
        except OSError as error:
            self._failed.append(error)
            return
        finally:
            self._task = asyncio.current_task()
            self._ready.set()
        await self._server.run()
