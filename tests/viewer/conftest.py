"""Sessions, a served one, and a real browser."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from flag_env.viewer import Session
from flag_env.viewer.host import Background

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

FLAGS = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
]

PATIENCE = 120.0
"""Longest that a test waits for what it waits for: compiling, on a busy machine [s]."""


@pytest.fixture
def session() -> Iterator[Session]:
    """A session whose flag is in flight."""
    session = Session("flag")
    session.settle()
    yield session
    session.close()


@pytest.fixture
def order() -> Callable[..., str]:
    """Function that sends a session a message, waits until it is carried out, and returns why it was refused."""

    def order(session: Session, do: str, **fields: Any) -> str:
        refusal = session.handle(json.dumps({"do": do, **fields}))
        session.settle()
        return refusal

    return order


@pytest.fixture
def served() -> Iterator[tuple[Session, str]]:
    """A session and the address that it is served at."""
    session = Session("flag")
    session.settle()
    server = Background(session, 0)
    yield session, server.address
    server.close()
    session.close()


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Headless Chromium with software WebGL."""
    if CHROMIUM is None:
        pytest.skip("no chromium is installed: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


class Tab:
    """A page with a record of its errors and of what it asked the network for."""

    def __init__(self, browser: Any, address: str, **options: Any) -> None:
        self.context = browser.new_context(viewport={"width": 800, "height": 500}, **options)
        self.page = self.context.new_page()
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(address)

    def wait(self, condition: str) -> None:
        """Until a JavaScript expression is true."""
        end = time.monotonic() + PATIENCE
        while not self.page.evaluate(f"Boolean({condition})"):
            assert time.monotonic() < end, (condition, self.errors)
            time.sleep(0.05)

    def value(self, expression: str) -> Any:
        """Of a JavaScript expression."""
        return self.page.evaluate(expression)


@pytest.fixture
def tab(browser: Any) -> Iterator[Callable[..., Tab]]:
    """Function that opens an address in a page of its own; no page may have met an error by the end."""
    tabs: list[Tab] = []

    def open_tab(address: str, **options: Any) -> Tab:
        tabs.append(Tab(browser, address, **options))
        return tabs[-1]

    yield open_tab
    errors = [error for tab in tabs for error in tab.errors]
    for one in tabs:
        one.context.close()
    assert errors == []


@pytest.fixture
def wait_for() -> Callable[[Callable[[], Any]], None]:
    """Function that waits until another returns something true."""

    def wait_for(condition: Callable[[], Any]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end
            time.sleep(0.02)

    return wait_for
