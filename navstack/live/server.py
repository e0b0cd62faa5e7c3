"""The web server of `navstack live`: a page, its schema, and a socket per page. Everything else is in the stage."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import secrets
import time
from collections.abc import AsyncIterator, Callable
from importlib.resources import files
from typing import Any, Final

from aiohttp import web
from aiohttp.typedefs import Handler

from navstack.core.errors import InputError, InternalError, NavError
from navstack.live import messages
from navstack.live.client import Client
from navstack.live.security import COOKIE, HEADERS, Gate
from navstack.live.stage import Stage

MAX_CLIENTS: Final = 32
MAX_MESSAGE: Final = 64 * 1024
"""Largest message of a page (bytes)."""
SLICE_S: Final = 1.0 / 60.0
"""Time between two advances of the session (s)."""
BUDGET_S: Final = 0.020
"""Time that the session may simulate before messages are handled (s)."""
TYPES: Final = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


class LiveServer:
    """Serves one stage to any number of pages."""

    def __init__(self, stage: Stage, gate: Gate, *, read_only: bool = False) -> None:
        self.stage = stage
        self.gate = gate
        self.read_only = read_only
        self.number = secrets.token_hex(8)
        """Identifies this start of the server: a page that reconnects to another one starts over."""
        self._clients: set[Client] = set()
        self._files = _page_files()
        self._slow = asyncio.Semaphore(1)

    def application(self) -> web.Application:
        """Returns the web application; it drives the session while it runs."""
        app = web.Application(middlewares=[self._guard], client_max_size=1024)
        app.router.add_get("/", self._index)
        app.router.add_get("/schema.json", self._schema)
        app.router.add_get("/socket", self._socket)
        app.router.add_get("/{name}", self._file)
        app.cleanup_ctx.append(self._driving)
        return app

    async def carry_out(self, request: Any) -> messages.Answer:
        """Carries out a request. Raises NavError."""
        try:
            if self.stage.is_slow(request):
                prepared = self.stage.prepare_slow(request)
                async with self._slow:
                    return await asyncio.to_thread(prepared)
            answer = self.stage.request(request)
        except NavError:
            raise
        except ValueError as error:
            raise InputError(_first_line(error)) from None
        except Exception as error:  # a bug must not end the session
            raise InternalError(
                f"{request.type} failed ({type(error).__name__}: {_first_line(error)}); please report it"
            ) from None
        self._wake()
        return answer

    def _wake(self) -> None:
        for client in self._clients:
            client.wake.set()

    async def _driving(self, app: web.Application) -> AsyncIterator[None]:
        del app
        task = asyncio.create_task(self._drive())
        yield
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    async def _drive(self) -> None:
        last = time.monotonic()
        while True:
            now = time.monotonic()
            elapsed, last = now - last, now
            try:
                moved = self.stage.advance(elapsed, budget_s=BUDGET_S, timer=time.monotonic)
            except NavError as error:
                await self._stop(error)
                moved = True
            if moved:
                self._wake()
            spent = time.monotonic() - now
            busy = moved and spent >= SLICE_S
            await asyncio.sleep(0.001 if busy else SLICE_S - spent if spent < SLICE_S else 0.0)

    async def _stop(self, error: NavError) -> None:
        """Pauses after an error of the simulation and shows it."""
        for session in self.stage.sessions:
            session.pause(True)
        notice = messages.Notice(text=f"the simulation stopped: {error.message}", severity="error")
        for client in list(self._clients):
            await client.notify(notice)

    # --- requests of browsers ---------------------------------------------------------------------------------------

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuses strangers; no error shows a traceback."""
        try:
            refused = self._refusal(request)
            response = await handler(request) if refused is None else _text(403, refused)
        except web.HTTPException as exc:
            response = _text(exc.status, f"{exc.status}: {exc.reason}")
        except (ConnectionError, asyncio.CancelledError):
            raise
        except Exception as error:
            response = _text(500, f"the server failed ({type(error).__name__}); please report it")
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _refusal(self, request: web.Request) -> str | None:
        host = request.headers.get("Host")
        if not self.gate.host_is_right(host):
            return "refused: the address names another host; use the address that navstack live printed"
        if not self.gate.token_is_right(request.query.get("token"), request.cookies.get(COOKIE)):
            return "refused: the token is missing or wrong; use the address that navstack live printed"
        if request.path == "/socket" and not self.gate.origin_is_right(request.headers.get("Origin"), host):
            return "refused: only the page of this server may connect"
        return None

    async def _index(self, request: web.Request) -> web.Response:
        response = self._page("index.html")
        token = request.query.get("token")
        if self.gate.token is not None and token is not None:
            response.set_cookie(COOKIE, token, httponly=True, samesite="Strict")
        return response

    async def _file(self, request: web.Request) -> web.Response:
        return self._page(request.match_info["name"])

    def _page(self, name: str) -> web.Response:
        if name not in self._files:
            raise web.HTTPNotFound
        body, kind = self._files[name]
        return web.Response(body=body, content_type=kind, charset="utf-8")

    async def _schema(self, request: web.Request) -> web.Response:
        del request
        return web.Response(text=json.dumps(messages.schema()), content_type="application/json")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if len(self._clients) >= MAX_CLIENTS:
            return _text(503, f"{MAX_CLIENTS} pages are connected already; close one")
        socket = web.WebSocketResponse(max_msg_size=MAX_MESSAGE, heartbeat=20.0, compress=False)
        await socket.prepare(request)
        client = Client(socket, self.stage, server=self.number, read_only=self.read_only, carry_out=self.carry_out)
        self._clients.add(client)
        try:
            await client.run()
        finally:
            self._clients.discard(client)
        return socket


async def serve(server: LiveServer, host: str, port: int, *, ready: Callable[[str], None], stop: asyncio.Event) -> None:
    """Serves until `stop` is set; `ready` gets the address. Raises InputError if the port cannot be used."""
    runner = web.AppRunner(server.application(), access_log=None, handle_signals=False, shutdown_timeout=1.0)
    await runner.setup()
    try:
        try:
            await web.TCPSite(runner, host, port).start()
        except OSError as exc:
            raise _port_error(exc, host, port) from None
        ready(_address(runner.addresses[0][1], host, server.gate.token))
        await stop.wait()
    finally:
        await runner.cleanup()


def _address(port: int, host: str, token: str | None) -> str:
    shown = f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}/" + (f"?token={token}" if token is not None else "")


def _port_error(exc: OSError, host: str, port: int) -> InputError:
    if exc.errno == errno.EADDRINUSE:
        return InputError(
            f"port {port} is in use, perhaps by another navstack live; give --port {port + 1}, or --port 0 for any free port",
            port=port,
        )
    if exc.errno in (errno.EACCES, errno.EPERM):
        return InputError(f"port {port} may not be used: {exc.strerror}; give a port above 1023", port=port)
    return InputError(
        f"cannot listen on {host}:{port}: {exc.strerror or exc}; give another --host or --port", host=host
    )


def _text(status: int, text: str) -> web.Response:
    return web.Response(status=status, text=f"{text}\n", content_type="text/plain")


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return (lines[0] if lines else type(error).__name__)[:300]


def _page_files() -> dict[str, tuple[bytes, str]]:
    """Returns the files of the page: name -> content and type."""
    found: dict[str, tuple[bytes, str]] = {}
    for file in files("navstack.live").joinpath("page").iterdir():
        suffix = "." + file.name.rpartition(".")[2]
        if suffix in TYPES:
            found[file.name] = file.read_bytes(), TYPES[suffix]
    return found
