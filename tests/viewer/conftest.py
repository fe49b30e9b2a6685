"""Sessions, a served one, and a real browser."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from flag_env.viewer import Session
from flag_env.viewer.host import Background
from tests.viewer import chromium
from tests.viewer.chromium import PATIENCE, Tab


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
    """Headless Chromium; without it tests are skipped, but fail where CI is set, as in the gate."""
    if chromium.EXECUTABLE is None:
        missing = "no chromium is installed: apt-get install chromium"
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    with chromium.browser() as started:
        yield started


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
