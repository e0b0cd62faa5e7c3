"""The server: who may connect, what a message may contain, and that nothing a stranger sends disturbs the session."""

from __future__ import annotations

import asyncio
import json
import random
import re
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from navstack.core import InputError
from navstack.live import messages
from navstack.live.messages import decode
from navstack.live.server import Gate, LiveServer, serve
from navstack.live.session import Session
from navstack.live.stage import Options, Report, Stage

LIMIT_S = 240.0
"""A test that waits longer (s) for the server fails."""
Body = Callable[[aiohttp.ClientSession, str, LiveServer], Awaitable[None]]


def served(
    session: Session,
    body: Body,
    *,
    host: str = "127.0.0.1",
    save_to: Path | None = None,
    stage: Callable[[Report], Stage] | None = None,
    **options: Any,
) -> None:
    """Runs `body` against a server of the session."""

    async def main() -> None:
        made = stage or Stage([session], Options(save_to=save_to, fixed=options.pop("fixed", False)))
        server = LiveServer(made, Gate(host, options.pop("token", None)), **options)
        stop, address = asyncio.Event(), asyncio.get_running_loop().create_future()
        task = asyncio.create_task(serve(server, "127.0.0.1", 0, ready=address.set_result, stop=stop))
        try:
            # the server's pings keep a `receive` with a timeout of its own waiting
            async with asyncio.timeout(LIMIT_S), aiohttp.ClientSession() as client:
                await body(client, str(await address).split("?")[0], server)
        finally:
            stop.set()
            await task

    with ThreadPoolExecutor(1) as thread:  # the browser of other tests keeps an event loop in the main thread
        thread.submit(asyncio.run, main()).result()


async def connect(client: aiohttp.ClientSession, address: str, **headers: str) -> aiohttp.ClientWebSocketResponse:
    origin = address.rstrip("/")
    socket = await client.ws_connect(address + "socket", headers={"Origin": origin, **headers})
    await socket.send_json({"type": "hello", "protocol": messages.PROTOCOL, "id": 1})
    return socket


async def answer(socket: aiohttp.ClientWebSocketResponse, number: int) -> dict[str, Any]:
    """Waits for the answer of that number."""
    while True:
        message = await socket.receive(timeout=60.0)
        assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
        if message.type is aiohttp.WSMsgType.TEXT:
            data = json.loads(message.data)
            if data.get("id") == number:
                return data


async def ask(socket: aiohttp.ClientWebSocketResponse, number: int, **request: Any) -> dict[str, Any]:
    await socket.send_json({"id": number, **request})
    return await answer(socket, number)


def test_the_page_and_its_headers(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        async with client.get(address) as page:
            assert page.status == 200
            policy = page.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy and "unsafe" not in policy
            text = await page.text()
            assert "http://" not in text and "https://" not in text and "style=" not in text
        async with client.get(address + "schema.json") as schema:
            assert (await schema.json())["protocol"] == messages.PROTOCOL
        for path in ("nothing.js", "%2e%2e%2fserver.py", "..%5cserver.py", "page/app.js", "app.py"):
            async with client.get(address + path) as missing:
                assert missing.status == 404
                assert "Traceback" not in await missing.text()
        async with client.post(address, data=b"x" * 100_000) as post:
            assert post.status in (405, 413)

    served(session, body)


def test_the_page_is_small_and_needs_nothing_else() -> None:
    page = Path(messages.__file__).with_name("page")
    files = [file for file in page.iterdir() if file.is_file()]
    assert sum(file.stat().st_size for file in files) < 250_000
    for file in files:
        text = file.read_text(encoding="utf-8").replace("http://www.w3.org/", "")
        assert "http://" not in text and "https://" not in text, file


@pytest.mark.parametrize("file", sorted(Path(messages.__file__).with_name("page").glob("*.js")), ids=lambda f: f.name)
def test_no_class_of_the_page_has_two_methods_of_one_name(file: Path) -> None:
    """In JavaScript the last one silently replaces the others."""
    for code in re.split(r"^(?:export )?class ", file.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        names = re.findall(r"^  ((?:get |set )?)(?:async )?(\w+)\(.*\) \{", code, flags=re.MULTILINE)
        assert len(names) == len(set(names)), names


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "localhost.evil.example", "", "192.168.0.7"])
def test_another_host_is_refused(session: Session, host: str) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        async with client.get(address, headers={"Host": host}) as page:
            assert page.status in (400, 403)
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await client.ws_connect(address + "socket", headers={"Host": host, "Origin": f"http://{host}"})
        assert refused.value.status in (400, 403)

    served(session, body)


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "https://127.0.0.1", "http://127.0.0.1:1"])
def test_another_origin_is_refused(session: Session, origin: str | None) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            await client.ws_connect(address + "socket", headers={"Origin": origin} if origin else {})
        assert refused.value.status == 403

    served(session, body)


def test_beyond_loopback_a_token_is_needed(session: Session) -> None:
    assert Gate("127.0.0.1").token is None and Gate("localhost").token is None
    assert Gate("0.0.0.0").token is not None and Gate("192.168.1.5").token is not None

    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        for wrong in ("", "?token=", "?token=wrong", "?token=sesam0"):
            async with client.get(address + wrong) as page:
                assert page.status == 403
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await client.ws_connect(address + "socket" + wrong, headers={"Origin": address.rstrip("/")})
        async with client.get(address + "app.js") as script:
            assert script.status == 403
        async with client.get(address + "?token=sesame") as page:
            assert page.status == 200
            assert "HttpOnly" in page.headers["Set-Cookie"] and "SameSite=Strict" in page.headers["Set-Cookie"]
        async with client.get(address + "app.js", cookies={"navstack-live": "sesame"}) as script:
            assert script.status == 200
        socket = await client.ws_connect(address + "socket?token=sesame", headers={"Origin": address.rstrip("/")})
        await socket.close()

    served(session, body, host="0.0.0.0", token="sesame")


def test_names_that_dns_could_point_here_are_refused_beyond_loopback() -> None:
    gate = Gate("0.0.0.0")
    assert gate.host_is_right("192.168.0.7:8765") and gate.host_is_right("[fe80::1]:8765")
    assert not gate.host_is_right("evil.example:8765") and not gate.host_is_right(None)


@pytest.mark.parametrize(
    "header",
    ["[::1]@evil.example", "127.0.0.1:8765@evil.example", "127.0.0.1:x", "me@127.0.0.1", "[::1", "localhost:", "::1:x"],
)
def test_a_host_header_is_a_host_and_a_port_only(header: str) -> None:
    gate = Gate("127.0.0.1")
    for right in ("127.0.0.1:8765", "localhost", "[::1]:8765", "::1"):
        assert gate.host_is_right(right)
    assert not gate.host_is_right(header)


@pytest.mark.parametrize(
    "request_text",
    ["GET / HTTP/1.1\r\n\r\n", "GET /" + "a" * 9000 + " HTTP/1.1\r\nHost: localhost\r\n\r\n", "\x16\x03\x01\r\n\r\n"],
)
def test_a_request_that_is_no_http_leaves_no_traceback(
    session: Session, request_text: str, caplog: pytest.LogCaptureFixture
) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", int(address.rstrip("/").rpartition(":")[2]))
        writer.write(request_text.encode("latin-1"))
        assert (await reader.read()).split(b" ")[1] == b"400"
        writer.close()
        async with client.get(address) as page:
            assert page.status == 200

    served(session, body)
    assert not caplog.records


@pytest.mark.slow
def test_frames_are_differences(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        await socket.send_json({"type": "layers", "layers": ["global", "local", "scan", "trajectories"], "id": 2})
        headers: list[dict[str, Any]] = []
        while len(headers) < 6:
            message = await socket.receive(timeout=30.0)
            if message.type is aiohttp.WSMsgType.BINARY:
                header, blobs = decode(message.data)
                assert [len(blob) for blob in blobs] == header["blobs"]
                headers.append(header)
                if header["type"] == "frame":
                    await socket.send_json({"type": "ack", "frame": header["frame"]})
        assert headers[0]["type"] == "world" and headers[0]["protocol"] == messages.PROTOCOL
        sides = [header["sides"][0] for header in headers[1:]]
        assert "goals" in sides[0] and all(side["t"] >= sides[0]["t"] for side in sides)
        assert sum("shapes" in side for side in sides) == 1
        await socket.close()

    session.set_speed(2.0)  # the run lasts for more than six frames, also on a slow machine
    served(session, body)


@pytest.mark.slow
def test_a_slow_page_gets_fewer_frames(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        await answer(socket, 1)
        frames = 0
        for number in range(2, 40):  # never acknowledges
            await socket.send_json({"type": "explain_cell", "x": 1.0, "y": 7.4, "id": number})
        while True:
            message = await socket.receive(timeout=30.0)
            if message.type is aiohttp.WSMsgType.BINARY:
                frames += 1
            elif json.loads(message.data)["id"] == 39:
                break
        assert frames <= 2
        await socket.close()

    session.set_speed(None)
    served(session, body)


def test_another_version_gets_one_sentence(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await client.ws_connect(address + "socket", headers={"Origin": address.rstrip("/")})
        refused = await ask(socket, 5, type="hello", protocol=999)
        assert not refused["ok"] and refused["text"].endswith("reload the page")
        first = await ask(socket, 6, type="pause", paused=True)
        assert not first["ok"] and "hello" in first["text"]
        await socket.close()

    served(session, body)


def test_viewers_and_recorded_runs_change_nothing(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        for number, request in enumerate(({"type": "goal", "pose": [1.0, 1.0]}, {"type": "cancel"}), 2):
            refused = await ask(socket, number, **request)
            assert (not refused["ok"] and "read-only" in refused["text"]) or "recorded run" in refused["text"]
        assert (await ask(socket, 9, type="parameters"))["ok"]
        await socket.close()
        assert session.interactions == []

    served(session, body, read_only=True)
    served(session, body, fixed=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["../evil", "a/b", "..", ".hidden", "", "x" * 200, "a\\b", "/etc/passwd"])
def test_files_are_saved_into_the_named_folder_only(session: Session, tmp_path: Path, name: str) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        refused = await ask(socket, 2, type="save", what="scenario", name=name)
        assert not refused["ok"]
        saved = await ask(socket, 3, type="save", what="scenario", name="mine")
        assert saved["ok"], saved
        await socket.close()

    served(session, body, save_to=tmp_path / "saved")
    assert [file.name for file in (tmp_path / "saved").iterdir()] == ["mine.yaml"]
    assert [file.name for file in tmp_path.iterdir()] == ["saved"]


def test_without_a_folder_nothing_is_saved(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        refused = await ask(socket, 2, type="save", what="scenario", name="mine")
        assert not refused["ok"] and "--save-to" in refused["text"]
        await socket.close()

    served(session, body)


def test_fuzzed_messages_and_broken_connections_disturb_nothing(session: Session) -> None:
    from tools.fuzz_live import Fuzzer

    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        fuzzer = Fuzzer(address, random.Random(7))
        await fuzzer.messages(client, 300)
        await fuzzer.connections(60)
        socket = await connect(client, address)
        assert (await ask(socket, 2, type="parameters"))["ok"]
        await socket.close()

    session.pause(True)
    served(session, body)


def test_a_used_port_gets_one_sentence(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        port = int(address.split(":")[2].rstrip("/"))
        with pytest.raises(InputError, match=f"port {port} is in use.*--port {port + 1}"):
            await serve(server, "127.0.0.1", port, ready=lambda _: None, stop=asyncio.Event())

    served(session, body)


def test_a_bug_in_a_request_is_one_sentence_and_the_session_goes_on(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        failed = await ask(socket, 2, type="restart")
        assert not failed["ok"] and "please report" in failed["text"] and "Traceback" not in failed["text"]
        assert (await ask(socket, 3, type="pause", paused=True))["ok"]
        await socket.close()

    def fail() -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(session, "restart", fail)
    served(session, body)


def test_time_begins_when_the_first_page_is_there(session: Session) -> None:
    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        for _ in range(30):
            async with client.get(address + "app.js") as script:
                await script.read()
        assert session.time == 0.0
        socket = await connect(client, address)
        frames = 0
        while session.time == 0.0:
            message = await socket.receive(timeout=60.0)
            if message.type is aiohttp.WSMsgType.BINARY:
                frames += 1
                await socket.send_json({"type": "ack", "frame": frames - 1})  # the first one is the world
        await socket.close()

    session.set_speed(None)
    served(session, body)


def test_pages_see_how_far_the_preparation_is(session: Session) -> None:
    go_on = threading.Event()

    def prepare(report: Report) -> Stage:
        report("compiling kernels", 3, 10)
        go_on.wait(LIMIT_S)
        return Stage([session], Options())

    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        progress = await heard(socket, "progress", lambda p: p["total"])
        assert (progress["text"], progress["done"], progress["total"]) == ("compiling kernels", 3, 10)
        refused = await ask(socket, 2, type="parameters")
        assert not refused["ok"] and "not ready yet" in refused["text"]
        assert (await ask(socket, 3, type="layers", layers=["local"]))["ok"]
        go_on.set()
        while (await socket.receive(timeout=60.0)).type is not aiohttp.WSMsgType.BINARY:
            pass
        assert (await ask(socket, 4, type="parameters"))["data"]
        await socket.close()

    served(session, body, stage=prepare)


def test_a_session_that_cannot_begin_ends_the_server_with_its_reason(session: Session) -> None:
    def prepare(report: Report) -> Stage:
        raise InputError("the log is not there")

    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        await server.failed.wait()

    with pytest.raises(InputError, match="the log is not there"):
        served(session, body, stage=prepare)


def test_while_the_simulation_takes_long_the_server_says_so(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    go_on, advance = threading.Event(), session.advance

    def wait(*args: Any, **options: Any) -> bool:
        go_on.wait(LIMIT_S)
        return advance(*args, **options)

    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        assert (await heard(socket, "progress", lambda p: p["seconds"] > 0.5))["text"] == "simulating"
        async with client.get(address) as page:
            assert page.status == 200
        go_on.set()
        assert (await heard(socket, "progress", lambda p: not p["text"]))["seconds"] == 0.0
        await socket.close()

    monkeypatch.setattr(session, "advance", wait)
    served(session, body)


def test_what_takes_long_while_the_time_stands_is_not_called_simulating(session: Session) -> None:
    go_on = threading.Event()

    async def body(client: aiohttp.ClientSession, address: str, server: LiveServer) -> None:
        socket = await connect(client, address)
        asked = asyncio.ensure_future(server.in_simulation(lambda: go_on.wait(LIMIT_S)))
        assert (await heard(socket, "progress", lambda p: p["seconds"] > 0.5))["text"] == "working"
        go_on.set()
        assert await asked
        await socket.close()

    session.pause(True)
    served(session, body)


async def heard(
    socket: aiohttp.ClientWebSocketResponse, kind: str, wanted: Callable[[dict[str, Any]], Any]
) -> dict[str, Any]:
    """Waits for a message of that type."""
    while True:
        message = await socket.receive(timeout=60.0)
        assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
        if message.type is aiohttp.WSMsgType.TEXT:
            data = json.loads(message.data)
            if data["type"] == kind and wanted(data):
                return data
