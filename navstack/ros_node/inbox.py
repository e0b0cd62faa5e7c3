"""A queue between the threads of a ROS client library and the thread of a node."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final

from navstack.core import NavError

SERVICE_TIMEOUT_S: Final = 60.0
"""A service call that the node does not answer within this time (s, wall) fails."""
MOST_MESSAGES: Final = 20_000
"""Messages that wait; beyond, the oldest are dropped: the node is blocked."""
LONGEST_RUN_S: Final = 0.05
"""Messages that still wait after this time (s, wall) wait for the next call: a cycle may be due."""

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


class _Post:
    """A message."""

    __slots__ = ("action", "topic")

    def __init__(self, action: Action, topic: OrderedDict[_Post, None]) -> None:
        self.action = action
        self.topic = topic
        """The messages of its topic that wait, in order."""


class Inbox:
    """A queue: the callbacks of subscribers put, the node takes. Only the node's thread runs anything.

    Each topic has a bound of its own, as a subscriber in roscpp: the oldest messages of a topic that floods the node are
    dropped, and no others. Calls of services are not dropped.
    """

    def __init__(self) -> None:
        self._arrival = threading.Condition()
        self._waiting: OrderedDict[_Post | _Call, None] = OrderedDict()
        self._others: OrderedDict[_Post, None] = OrderedDict()
        """Messages without a topic."""
        self._posts = 0
        self.dropped = 0
        """Number of messages that were dropped."""

    def post(self, action: Action) -> None:
        """Add something to do; returns at once. Beyond `MOST_MESSAGES` the oldest message is dropped."""
        self._post(_Post(action, self._others), MOST_MESSAGES)

    def _post(self, item: _Post, most: int) -> None:
        with self._arrival:
            if len(item.topic) >= most:
                self._drop(next(iter(item.topic)))
            elif self._posts >= MOST_MESSAGES:
                self._drop(next(each for each in self._waiting if isinstance(each, _Post)))
            item.topic[item] = None
            self._waiting[item] = None
            self._posts += 1
            self._arrival.notify()

    def _drop(self, item: _Post) -> None:
        del item.topic[item], self._waiting[item]
        self._posts -= 1
        self.dropped += 1

    def poster(
        self, receive: Callable[..., Any], *arguments: Any, most: int = MOST_MESSAGES, **named: Any
    ) -> Callable[[Any], None]:
        """Return a callback for a subscriber: it posts `receive(message, *arguments, **named)`.

        Of the messages of this callback at most `most` wait; beyond, its oldest are dropped.
        """
        topic: OrderedDict[_Post, None] = OrderedDict()

        def callback(message: Any) -> None:
            self._post(_Post(lambda: receive(message, *arguments, **named), topic), most)

        return callback

    def caller(self, handle: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Return a handler for a service: it calls `handle(request)` in the node."""

        def handler(request: Any) -> Any:
            return self.call(lambda: handle(request))

        return handler

    def call(self, action: Action) -> Any:
        """Have the node run `action`, and return its result. Raises what it raises, TimeoutError after a minute."""
        call = _Call(action)
        with self._arrival:
            self._waiting[call] = None
            self._arrival.notify()
        if not call.done.wait(SERVICE_TIMEOUT_S):
            raise TimeoutError(f"the node did not answer within {SERVICE_TIMEOUT_S:g} s")
        if call.error is not None:
            raise call.error
        return call.result

    def wake(self) -> None:
        """End the wait of `run`."""
        self.post(_nothing)

    def run(self, timeout_s: float, report: Callable[[NavError], None], *, longest_s: float = LONGEST_RUN_S) -> float:
        """Wait up to `timeout_s` (s, wall) for something to do, and do what waits then, for about `longest_s` at most.

        A NavError of a message goes to `report`. Returns the time (s) for which there was nothing to do.
        """
        begin = time.perf_counter()
        with self._arrival:
            if not self._waiting and (timeout_s <= 0.0 or not self._arrival.wait(timeout_s)):
                return max(timeout_s, 0.0)
            count = len(self._waiting)
        woken = time.perf_counter()
        # what arrives meanwhile waits for the next call: a flood of messages must not keep the cycle waiting
        for _ in range(count):
            with self._arrival:
                if not self._waiting:
                    break
                item, _ = self._waiting.popitem(last=False)
                if isinstance(item, _Post):
                    del item.topic[item]
                    self._posts -= 1
            self._do(item, report)
            if time.perf_counter() - woken > longest_s:
                break
        return min(woken - begin, max(timeout_s, 0.0))

    def _do(self, item: _Post | _Call, report: Callable[[NavError], None]) -> None:
        if isinstance(item, _Call):
            try:
                item.result = item.action()
            except BaseException as exc:  # the caller's thread raises it again
                item.error = exc
            item.done.set()
            return
        try:
            item.action()
        except NavError as exc:
            report(exc)
