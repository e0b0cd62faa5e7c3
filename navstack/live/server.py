"""The web server of `navstack live`: a page, its schema, and a socket per page. Everything else is in the stage.

The stage is touched by one thread only, that of the simulation. So the server answers, and pages hear why they wait, while
kernels are compiled or a step takes long.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hmac
import ipaddress
import json
import logging
import re
import secrets
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from typing import Any, Final, TypeVar

from aiohttp import WSMsgType, web
from aiohttp.http import HttpProcessingError
from aiohttp.typedefs import Handler

from navstack.core import InputError, InternalError, NavError, compilation_reported
from navstack.live import messages
from navstack.live.foxglove import FoxgloveServer
from navstack.live.messages import Frame
from navstack.live.stage import COMPILING, Report, Stage, world_frame
from navstack.live.view import SessionView

# ----------------------------------------------------------------------------------------------------------------------
# Who may talk to the server: checks of the Host and Origin headers and of the token, and limits of rates.


CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy: nothing from elsewhere, no inline script."""
HEADERS = {
    "Content-Security-Policy": CSP,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
COOKIE = "navstack-live"


def is_loopback(host: str) -> bool:
    """True for an address that only this machine can reach."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Decides who may enter. Beyond loopback a token is required."""

    def __init__(self, host: str, token: str | None = None) -> None:
        self._host = host
        self._loopback = is_loopback(host)
        self.token = token if token is not None else None if self._loopback else secrets.token_urlsafe(18)
        """None: no token is required."""

    def host_is_right(self, header: str | None) -> bool:
        """Checks the Host header: a name that DNS could point here (rebinding) is refused."""
        if not header:
            return False
        name = _without_port(header)
        if self._loopback:
            return name in ("localhost", "127.0.0.1", "::1", self._host)
        return name in (self._host, socket.gethostname()) or _is_address(name)

    def origin_is_right(self, origin: str | None, host: str | None) -> bool:
        """Checks the Origin header of a page: only pages of this server may connect."""
        return origin is not None and host is not None and origin == f"http://{host}"

    def token_is_right(self, *given: str | None) -> bool:
        """Checks the token of the address or of the cookie."""
        if self.token is None:
            return True
        return any(text is not None and hmac.compare_digest(text.encode(), self.token.encode()) for text in given)


_HOST: Final = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([\w.-]+)|([0-9A-Fa-f:.]+))(?(3)|(?::\d{1,5})?)", re.ASCII)
"""An address of IPv6 in brackets, or a name, with or without a port; or an address of IPv6 without brackets."""


def _without_port(header: str) -> str:
    """Return the host of a Host header; empty for anything else, such as the name of a user before it."""
    found = _HOST.fullmatch(header)
    return "" if found is None else next(filter(None, found.groups()), "")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class RateLimit:
    """Allows `rate` messages per second on average, and `burst` at once."""

    def __init__(self, rate: float, burst: float, timer: Callable[[], float]) -> None:
        self._rate, self._burst, self._timer = rate, burst, timer
        self._left, self._at = burst, timer()

    def allows(self) -> bool:
        """Counts a message; False if it is one too many."""
        now = self._timer()
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


# ----------------------------------------------------------------------------------------------------------------------
# One connected page: its requests, and its frames, of which a slow page gets fewer.


UNACKNOWLEDGED: Final = 2
"""Frames under way; the next one waits until the page has drawn one."""
REQUESTS_PER_S: Final = 120.0
BURST: Final = 240.0
TOO_MANY: Final = 2000
"""Refused messages after which the connection is closed."""


class Client:
    """A page."""

    def __init__(self, socket: web.WebSocketResponse, server: LiveServer) -> None:
        self.wake = asyncio.Event()
        """Set when there may be something new to show."""
        self._socket = socket
        self._server = server
        self._views: list[SessionView] = []
        self._world = 0
        self._layers: frozenset[str] = frozenset()
        self._rate = 30.0
        self._sent = self._acknowledged = 0
        self._greeted = self._shown = False
        self._refused = 0

    async def run(self) -> None:
        """Serves the page until it leaves."""
        sender = asyncio.create_task(self._send_frames())
        limit = RateLimit(REQUESTS_PER_S, BURST, time.monotonic)
        slow: set[asyncio.Task[None]] = set()
        try:
            async for message in self._socket:
                if message.type not in (WSMsgType.TEXT, WSMsgType.BINARY):
                    break
                if not limit.allows():
                    await self._refuse(InputError("too many messages; send fewer"))
                elif message.type is WSMsgType.BINARY:
                    await self._refuse(InputError("a binary message; send JSON text"))
                else:
                    await self._handle(message.data, slow)
                if self._refused > TOO_MANY:
                    await self._socket.close(code=1008, message=b"too many refused messages")
        finally:
            sender.cancel()
            for task in slow:
                task.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await sender

    async def notify(self, message: messages.Notice | messages.Progress) -> None:
        """Show a notice or the progress on the page."""
        if self._greeted:
            await self._send(message)

    async def show(self, stage: Stage) -> None:
        """Send the world of a stage that is prepared; frames follow."""
        if self._greeted and not self._views:
            await self._send_world(stage)

    async def _send_world(self, stage: Stage) -> None:
        self._views = [SessionView(session) for session in stage.sessions]
        for view in self._views:
            view.set_layers(self._layers)
        server = self._server

        def encoded() -> bytes:
            self._world = stage.main.worlds
            return world_frame(stage, server=server.number, read_only=server.read_only).encode()

        frame = await server.in_simulation(encoded)
        with contextlib.suppress(ConnectionError):
            await self._socket.send_bytes(frame)
        self._shown = True
        self.wake.set()

    async def _handle(self, text: str, slow: set[asyncio.Task[None]]) -> None:
        try:
            request = messages.read_request(text)
        except NavError as error:
            await self._refuse(error, messages.id_of(text))
            return
        match request:
            case messages.Hello():
                await self._greet(request)
            case messages.Acknowledge():
                self._acknowledged = max(self._acknowledged, min(request.frame, self._sent))
                self.wake.set()
            case _ if not self._greeted:
                await self._refuse(InputError("the first message must be hello"), request.id)
            case messages.Layers():
                self._rate, self._layers = request.rate, frozenset(request.layers)
                for view in self._views:
                    view.set_layers(self._layers)
                self.wake.set()
                await self._send(messages.Answer(id=request.id, ok=True))
            case _ if not self._shown:
                await self._refuse(InputError("the robot is not ready yet; wait until the page shows it"), request.id)
            case _ if self._server.read_only and request.type not in messages.READ_ONLY:
                await self._refuse(InputError("this page is read-only: it can look, but not take part"), request.id)
            case _ if Stage.is_slow(request):
                if len(slow) >= 8:
                    await self._refuse(InputError("eight questions are still being answered; wait"), request.id)
                    return
                task = asyncio.create_task(self._answer(request))
                slow.add(task)
                task.add_done_callback(slow.discard)
            case _:
                await self._answer(request)

    async def _answer(self, request: Any) -> None:
        try:
            answer = await self._server.carry_out(request)
        except NavError as error:
            await self._refuse(error, request.id)
            return
        await self._send(answer)

    async def _greet(self, request: messages.Hello) -> None:
        if request.protocol != messages.PROTOCOL:
            await self._refuse(
                InputError(
                    f"this page speaks version {request.protocol} of the protocol, the server version {messages.PROTOCOL}; "
                    "reload the page"
                ),
                request.id,
            )
            return
        self._greeted = True
        await self._server.greet(self)
        await self._send(messages.Answer(id=request.id, ok=True))

    async def _refuse(self, error: NavError, number: int = 0) -> None:
        self._refused += 1
        await self._send(messages.Answer(id=number, ok=False, text=error.message, code=error.code))

    async def _send(self, message: messages.Message) -> None:
        with contextlib.suppress(ConnectionError):
            await self._socket.send_str(message.model_dump_json())

    async def _send_frames(self) -> None:
        while True:
            await self.wake.wait()
            self.wake.clear()
            if not self._shown or self._sent - self._acknowledged >= UNACKNOWLEDGED:
                continue
            if all(view.is_current for view in self._views):
                continue
            started = time.monotonic()
            stage = self._server.stage
            try:
                if stage is not None and stage.main.worlds != self._world:
                    await self._send_world(stage)
                encoded = await self._server.in_simulation(self._next_frame)
            except Exception as error:  # frames are differences: without this one, the page needs all of it again
                text = f"the page could not be sent ({type(error).__name__}: {error}); please report it"
                await self.notify(messages.Notice(text=text[:500], severity="error"))
                await self._socket.close(code=1011, message=b"a frame failed")
                return
            try:
                await self._socket.send_bytes(encoded)
            except ConnectionError:
                return
            await asyncio.sleep(max(0.0, 1.0 / self._rate - (time.monotonic() - started)))
            self.wake.set()

    def _next_frame(self) -> bytes:
        frame = Frame({"type": "frame", "frame": self._sent + 1})
        stage = self._server.stage
        frame.header["graph"] = 0 if stage is None else stage.graph.draft.version
        frame.header["sides"] = [view.frame(frame) for view in self._views]
        self._sent += 1
        return frame.encode()


MAX_CLIENTS: Final = 32
MAX_MESSAGE: Final = 64 * 1024
"""Largest message of a page (bytes)."""
SLICE_S: Final = 1.0 / 60.0
"""Time between two advances of the session (s)."""
BUDGET_S: Final = 0.020
"""Time that the session may simulate before messages are handled (s)."""
PATIENCE_S: Final = 0.5
"""Pages are told what the simulation does if it takes longer (s)."""
TOLD_EVERY_S: Final = 0.25
TYPES: Final = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


T = TypeVar("T")


class _EndedError(Exception):
    """The server ends: what the simulation's thread does is of no use any more."""


class LiveServer:
    """Serves one stage to any number of pages. Time begins when the first page, or client of Foxglove, is there."""

    def __init__(
        self,
        stage: Stage | Callable[[Report], Stage],
        gate: Gate,
        *,
        read_only: bool = False,
        foxglove: FoxgloveServer | None = None,
    ) -> None:
        """`stage` may be a function that prepares it: it is called when the server runs, and pages show its progress.

        `foxglove` shows the stage as well, and is stopped with this server.
        """
        self.stage = stage if isinstance(stage, Stage) else None
        """None while it is prepared."""
        self._prepare = stage
        self.failed: asyncio.Event = asyncio.Event()
        """Set when the stage could not be prepared."""
        self.failure: BaseException | None = None
        self._watched = asyncio.Event()
        self._simulation = ThreadPoolExecutor(1, thread_name_prefix="simulation")
        self._since: float | None = None
        self._doing = ("", 0, 0)
        self._ending = False
        self.gate = gate
        self.read_only = read_only
        self._foxglove = foxglove
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
        stage = self.stage
        assert stage is not None  # a client asks after it has been shown
        try:
            if stage.is_slow(request):
                prepared = await self.in_simulation(lambda: stage.prepare_slow(request))
                async with self._slow:
                    return await asyncio.to_thread(prepared)
            answer = await self.in_simulation(lambda: stage.request(request))
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

    async def greet(self, client: Client) -> None:
        """Shows a new page what there is to see: the world, or how far its preparation is."""
        if self.stage is None:
            await client.notify(self._progress())
        else:
            await client.show(self.stage)
        self._watched.set()

    async def in_simulation(self, action: Callable[[], T]) -> T:
        """Calls a function in the simulation's thread, between two steps, and returns its result."""
        return await asyncio.get_running_loop().run_in_executor(self._simulation, self._noted, action)

    def _noted(self, action: Callable[[], T]) -> T:
        """Notes when an action began and whether it compiles, for `_tell`."""
        self._since = time.monotonic()
        try:
            with compilation_reported(lambda: self._report(COMPILING, 0, 0), each=True):
                return action()
        finally:
            self._since, self._doing = None, ("", 0, 0)

    def _report(self, text: str, done: int, total: int) -> None:
        if self._ending:
            raise _EndedError
        if total or text != COMPILING or not self._doing[2]:  # a bar stays a bar
            self._doing = text, done, total

    async def _driving(self, app: web.Application) -> AsyncIterator[None]:
        del app
        tasks = [asyncio.create_task(self._drive()), asyncio.create_task(self._tell())]
        yield
        self._ending = True
        for task in tasks:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        self._simulation.shutdown(wait=False, cancel_futures=True)
        if self._foxglove is not None:
            await asyncio.to_thread(self._foxglove.stop)

    async def _tell(self) -> None:
        """Tells all pages what the simulation does when it takes long, and when that is over."""
        told = False
        while True:
            await asyncio.sleep(TOLD_EVERY_S)
            since = self._since
            late = self.stage is None or (since is not None and time.monotonic() - since > PATIENCE_S)
            if late or told:
                told = late
                progress = self._progress() if late else messages.Progress()
                for client in list(self._clients):
                    await client.notify(progress)

    def _progress(self) -> messages.Progress:
        since, (text, done, total) = self._since, self._doing
        seconds = 0.0 if since is None else time.monotonic() - since
        stands = self.stage is not None and all(session.paused for session in self.stage.sessions)
        text = text or ("working" if stands else "simulating")
        return messages.Progress(text=text, done=done, total=total, seconds=round(seconds, 1))

    async def _prepared(self) -> Stage | None:
        """Returns the stage, prepared; None if that failed."""
        prepare = self._prepare
        if isinstance(prepare, Stage):
            return prepare
        try:
            self.stage = await self.in_simulation(lambda: prepare(self._report))
        except Exception as error:
            self.failure = error
            text = error.message if isinstance(error, NavError) else f"{type(error).__name__}: {_first_line(error)}"
            for client in list(self._clients):
                await client.notify(messages.Notice(text=f"the session cannot begin: {text}", severity="error"))
            self.failed.set()
            return None
        for client in list(self._clients):
            await client.show(self.stage)
        return self.stage

    async def _drive(self) -> None:
        stage = await self._prepared()
        if stage is None:
            return
        stage.report = self._report
        if self._foxglove is not None:
            watched = partial(asyncio.get_running_loop().call_soon_threadsafe, self._watched.set)
            await self.in_simulation(partial(self._foxglove.show, stage, watched))
        await self._watched.wait()
        last = time.monotonic()
        while True:
            now = time.monotonic()
            elapsed, last = now - last, now
            try:
                moved = await self._advance(stage, elapsed)
            except NavError as error:
                await self._stop(stage, error)
                moved = True
            if moved:
                self._wake()
            spent = time.monotonic() - now
            busy = moved and spent >= SLICE_S
            await asyncio.sleep(0.001 if busy else SLICE_S - spent if spent < SLICE_S else 0.0)

    async def _advance(self, stage: Stage, elapsed_s: float) -> bool:
        def advance() -> bool:
            moved = stage.advance(elapsed_s, budget_s=BUDGET_S, timer=time.monotonic)
            return (self._foxglove is not None and self._foxglove.update()) or moved

        return await self.in_simulation(advance)

    async def _stop(self, stage: Stage, error: NavError) -> None:
        """Pauses after an error of the simulation and shows it."""
        for session in stage.sessions:
            await self.in_simulation(partial(session.pause, True))
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
        client = Client(socket, self)
        self._clients.add(client)
        try:
            await client.run()
        finally:
            self._clients.discard(client)
        return socket


async def serve(server: LiveServer, host: str, port: int, *, ready: Callable[[str], None], stop: asyncio.Event) -> None:
    """Serves until `stop` is set; `ready` gets the address.

    Raises InputError if the port cannot be used, and the error of a stage that cannot be prepared.
    """
    runner = web.AppRunner(
        server.application(), access_log=None, handle_signals=False, shutdown_timeout=1.0, logger=_LOG
    )
    await runner.setup()
    try:
        try:
            await web.TCPSite(runner, host, port).start()
        except OSError as exc:
            raise _port_error(exc, host, port) from None
        ready(_address(runner.addresses[0][1], host, server.gate.token))
        ends = [asyncio.create_task(event.wait()) for event in (stop, server.failed)]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        for end in ends:
            end.cancel()
    finally:
        await runner.cleanup()
    if server.failure is not None:
        raise server.failure


def _is_server_error(record: logging.LogRecord) -> bool:
    """Return False for a malformed HTTP request, which is answered with status 400 and not logged."""
    return record.exc_info is None or not isinstance(record.exc_info[1], HttpProcessingError)


_LOG: Final = logging.getLogger("navstack.live")
_LOG.addFilter(_is_server_error)


class ServerThread:
    """A server in a thread of its own, for programs that do something else meanwhile."""

    def __init__(self, server: LiveServer, host: str = "127.0.0.1", port: int = 0) -> None:
        """Start it; port 0 is any free one. Raises InputError if the port cannot be used."""
        self._server = server
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._ready: Future[str] = Future()
        self._thread = threading.Thread(target=self._run, args=(host, port), name="navstack-live", daemon=True)
        self._thread.start()
        self.address = self._ready.result()
        """Of the page."""

    @property
    def is_alive(self) -> bool:
        """Whether the server still runs."""
        return self._thread.is_alive()

    def call(self, action: Callable[[], T]) -> T:
        """Call a function in the thread of the simulation, between two steps of the session, and return its result."""
        return asyncio.run_coroutine_threadsafe(self._server.in_simulation(action), self._loop).result(30.0)

    def stop(self) -> None:
        """End the server; a second time does nothing."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(30.0)

    def _run(self, host: str, port: int) -> None:
        try:
            self._loop.run_until_complete(
                serve(self._server, host, port, ready=self._ready.set_result, stop=self._stop)
            )
        except BaseException as error:
            if self._ready.done():
                raise
            self._ready.set_exception(error)
        finally:
            self._loop.run_until_complete(self._loop.shutdown_default_executor())
            self._loop.close()


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
