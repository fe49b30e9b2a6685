"""The server, spoken to without a browser: who gets in, what strangers get, and who reads slowly."""

from __future__ import annotations

import asyncio
import http.client
import json
import re
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files

import numpy as np
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosedError, InvalidStatus

from flag_env.viewer import Session
from flag_env.viewer.host import Background
from flag_env.viewer.wire import ACK


def alone(coroutine):
    """Run a coroutine in a thread of its own: a browser's tests may have left a loop running in this one."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, coroutine).result()


def get(address: str, path: str = "/", **headers: str):
    host, port = address.split("/")[2].split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=30)
    connection.request("GET", path, headers=headers)
    response = connection.getresponse()
    return response, response.read().decode()


def knock(address: str, headers: dict[str, str]) -> int:
    """Status of the answer to a request for the WebSocket."""
    host, port = address.split("/")[2].split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=30)
    connection.request("GET", "/socket", headers=headers)
    status = connection.getresponse().status
    connection.close()
    return status


def socket(address: str, **changes):
    """A connection as the page makes it."""
    url = address.replace("http", "ws") + "socket"
    return connect(url, **{"origin": address.rstrip("/"), "max_size": None, "compression": None} | changes)


def test_every_file_of_the_page_is_served_under_a_strict_policy(served):
    _, address = served
    response, page = get(address)
    assert response.status == 200
    names = re.findall(r'(?:src|href)="(/[^"]*)"', page)
    static = {path.name for path in (files("flag_env.viewer") / "static").iterdir()}
    assert {name[1:] for name in names} | {"page.html", "replay.js"} == static
    for name in names:
        response, _ = get(address, name)
        assert response.status == 200
        policy = response.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
    assert get(address, "/../server.py")[0].status == 404
    assert get(address, "/replay.js")[0].status == 404


FOREIGN = ("evil.example", "127.0.0.1.evil.example", "localhost:1:2", "evil.example:8400", "127.0.0.1@evil", "")


@pytest.mark.parametrize("host", FOREIGN)
def test_foreign_hosts_are_refused(served, host):
    assert get(served[1], Host=host)[0].status in (400, 403)


def test_a_tunnel_with_another_port_gets_in(served):
    """Its pages name the tunnel's end; the WebSocket's origin is then that name too, and no other."""
    assert get(served[1], Host="localhost:9999")[0].status == 200
    upgrade = {
        "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==", "Host": "localhost:9999",
    }  # fmt: skip
    assert knock(served[1], upgrade | {"Origin": "http://localhost:9999"}) == 101
    assert knock(served[1], upgrade | {"Origin": served[1].rstrip("/")}) == 403
    assert knock(served[1], upgrade | {"Origin": "http://localhost:9999", "Host": "evil.example"}) == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1", "http://localhost:1", None])
def test_foreign_origins_are_refused(served, origin):
    async def run():
        async with socket(served[1], origin=origin):
            pass

    with pytest.raises(InvalidStatus) as refused:
        alone(run())
    assert refused.value.response.status_code == 403


async def hello(page):
    """The first description, status and frame."""
    kinds = {}
    while len(kinds) < 3:
        data = await page.recv()
        kinds[json.loads(data)["type"] if isinstance(data, str) else "frame"] = data
    return kinds


async def drain(page):
    """Take whatever comes."""
    while True:
        await page.recv()


def test_it_listens_on_the_loopback_address_only(served):
    assert served[1].startswith("http://127.0.0.1:")


def test_two_pages_see_the_same_flag(served):
    async def run():
        async with socket(served[1]) as one, socket(served[1]) as other:
            first, second = await hello(one), await hello(other)
            assert json.loads(first["scene"]) == json.loads(second["scene"])
            await one.send('{"do":"pause","on":true}')
            await one.send(ACK)
            while True:
                data = await other.recv()
                if isinstance(data, str):
                    if json.loads(data).get("paused"):
                        return
                else:
                    await other.send(ACK)

    alone(asyncio.wait_for(run(), 60))


def test_a_page_that_stops_reading_gets_two_frames_and_holds_up_nobody(served):
    session, address = served

    async def run():
        async with socket(address) as slow, socket(address) as quick:
            await asyncio.sleep(0)
            frames = 0
            while frames < 25:
                if not isinstance(await quick.recv(), str):
                    frames += 1
                    await quick.send(ACK)
            came = []
            while True:
                try:
                    came.append(await asyncio.wait_for(slow.recv(), 0.5))
                except TimeoutError:
                    break
            unread = [data for data in came if not isinstance(data, str)]
            assert len(unread) == 2
            await slow.send(ACK)
            number = np.frombuffer(await asyncio.wait_for(next_frame(slow), 30), "<u4", 2)[1]
            assert number >= session.number - 30
            assert number > np.frombuffer(unread[-1], "<u4", 2)[1] + 20

    async def next_frame(page):
        while isinstance(data := await page.recv(), str):
            pass
        return data

    alone(asyncio.wait_for(run(), 90))


def test_bad_messages_are_answered_and_change_nothing(served):
    session, address = served

    async def run():
        async with socket(address) as page:
            await hello(page)
            for text in ("{", '{"do":"set","values":{"stiffness":NaN}}', '{"do":"set","values":{"stiffness":99}}', b"\x00"):
                await page.send(text)
                while True:
                    data = await page.recv()
                    if isinstance(data, str) and json.loads(data)["type"] == "refused":
                        break
            await page.send("x" * 10_000)
            with pytest.raises(ConnectionClosedError) as closed:
                await drain(page)
            assert closed.value.rcvd.code == 1009
        async with socket(address) as page:
            await hello(page)

    before = session.flight.settings
    alone(asyncio.wait_for(run(), 60))
    assert session.flight.settings == before


def test_a_taken_port_is_told_and_the_default_gives_way(served):
    port = int(served[1].rstrip("/").rpartition(":")[2])
    session = Session("rope")
    with pytest.raises(OSError, match=f"port {port} cannot be opened"):
        Background(session, port)
    servers = [Background(session), Background(session)]  # the second finds the usual port taken
    assert servers[0].address != servers[1].address
    for server in servers:
        server.close()
        server.close()
    session.close()
