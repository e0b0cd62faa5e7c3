"""Messages and calls of services on their way from the threads of rospy to the thread of the node."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import Any, Final

from navstack.core.errors import NavError

SERVICE_TIMEOUT_S: Final = 60.0
"""A service call that the node does not answer within this time (s, wall) fails."""
MOST_MESSAGES: Final = 20_000
"""Messages that wait; beyond, the oldest are dropped: the node is blocked."""

Action = Callable[[], Any]


def _nothing() -> None:
    pass


class _Call:
    """A call of a service."""

    def __init__(self, action: Action) -> None:
        self.action = action
        self.done = threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None


class Inbox:
    """A queue: rospy's callbacks put, the node takes. Only the node's thread runs anything."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Action | _Call] = queue.SimpleQueue()
        self.dropped = 0
        """Number of messages that were dropped."""

    def post(self, action: Action) -> None:
        """Add something to do; returns at once."""
        if self._queue.qsize() > MOST_MESSAGES:
            self.dropped += 1
            return
        self._queue.put(action)

    def poster(self, receive: Callable[..., Any], *arguments: Any, **named: Any) -> Callable[[Any], None]:
        """Return a callback for a subscriber: it posts `receive(message, *arguments, **named)`."""

        def callback(message: Any) -> None:
            self.post(lambda: receive(message, *arguments, **named))

        return callback

    def caller(self, handle: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Return a handler for a service: it calls `handle(request)` in the node."""

        def handler(request: Any) -> Any:
            return self.call(lambda: handle(request))

        return handler

    def call(self, action: Action) -> Any:
        """Have the node run `action`, and return its result. Raises what it raises, TimeoutError after a minute."""
        call = _Call(action)
        self._queue.put(call)
        if not call.done.wait(SERVICE_TIMEOUT_S):
            raise TimeoutError(f"the node did not answer within {SERVICE_TIMEOUT_S:g} s")
        if call.error is not None:
            raise call.error
        return call.result

    def wake(self) -> None:
        """End the wait of `run`."""
        self.post(_nothing)

    def run(self, timeout_s: float, report: Callable[[NavError], None]) -> float:
        """Wait up to `timeout_s` (s, wall) for something to do, and do everything that waits.

        A NavError of a message goes to `report`. Returns the time (s) for which there was nothing to do.
        """
        begin = time.perf_counter()
        try:
            item = self._queue.get(timeout=timeout_s) if timeout_s > 0.0 else self._queue.get_nowait()
        except queue.Empty:
            return max(timeout_s, 0.0)
        idle = min(time.perf_counter() - begin, max(timeout_s, 0.0))
        # what arrives meanwhile waits for the next call: a flood of messages must not keep the cycle waiting
        for _ in range(self._queue.qsize()):
            self._do(item, report)
            try:
                item = self._queue.get_nowait()
            except queue.Empty:
                return idle
        self._do(item, report)
        return idle

    def _do(self, item: Action | _Call, report: Callable[[NavError], None]) -> None:
        if isinstance(item, _Call):
            try:
                item.result = item.action()
            except BaseException as exc:  # the caller's thread raises it again
                item.error = exc
            item.done.set()
            return
        try:
            item()
        except NavError as exc:
            report(exc)
