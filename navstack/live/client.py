"""One connected page: its requests, and its frames, of which a slow page gets fewer."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable
from typing import Any, Final

from aiohttp import WSMsgType, web

from navstack.core.errors import InputError, NavError
from navstack.live import messages
from navstack.live.frame import Frame
from navstack.live.security import RateLimit
from navstack.live.stage import Stage
from navstack.live.view import SessionView
from navstack.live.world import world_frame

UNACKNOWLEDGED: Final = 2
"""Frames under way; the next one waits until the page has drawn one."""
REQUESTS_PER_S: Final = 120.0
BURST: Final = 240.0
TOO_MANY: Final = 2000
"""Refused messages after which the connection is closed."""


class Client:
    """A page."""

    def __init__(
        self,
        socket: web.WebSocketResponse,
        stage: Stage,
        *,
        server: str,
        read_only: bool,
        carry_out: Callable[[Any], Awaitable[messages.Answer]],
    ) -> None:
        self.wake = asyncio.Event()
        """Set when there may be something new to show."""
        self._socket = socket
        self._stage = stage
        self._server, self._read_only = server, read_only
        self._carry_out = carry_out
        self._views = [SessionView(session) for session in stage.sessions]
        self._rate = 30.0
        self._sent = self._acknowledged = 0
        self._greeted = False
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

    async def notify(self, notice: messages.Notice) -> None:
        """Show a notice on the page."""
        await self._send(notice)

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
                self._rate = request.rate
                for view in self._views:
                    view.set_layers(frozenset(request.layers))
                self.wake.set()
                await self._send(messages.Answer(id=request.id, ok=True))
            case _ if self._read_only and request.type not in messages.READ_ONLY:
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
            answer = await self._carry_out(request)
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
        frame = world_frame(self._stage, server=self._server, read_only=self._read_only)
        await self._socket.send_bytes(frame.encode())
        self._greeted = True
        self.wake.set()
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
            if not self._greeted or self._sent - self._acknowledged >= UNACKNOWLEDGED:
                continue
            if all(view.is_current for view in self._views):
                continue
            started = time.monotonic()
            try:
                encoded = self._next_frame()
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
        frame.header["sides"] = [view.frame(frame) for view in self._views]
        self._sent += 1
        return frame.encode()
