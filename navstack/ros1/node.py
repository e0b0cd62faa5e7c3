"""What every node has: its inbox, its clock, its watch of the ROS master and its log.

Messages and calls of services come in the threads of rospy and are processed in the thread of the node.
"""

from __future__ import annotations

import bisect
import math
import re
import threading
import time
import xmlrpc.client
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from navstack.core import Event, NavError
from navstack.ros1 import ros
from navstack.ros_messages import seconds

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
    """A queue: rospy's callbacks put, the node takes. Only the node's thread runs anything.

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


# --- seconds of a node: since its start, never backwards, for any jump of ROS's clock ---------------------------------


JUMP_NS: Final = 1_000_000
"""A clock that goes back by more (ns) has jumped."""
STILL_S: Final = 1.0
"""A simulated clock that does not change for this time (s, wall) stands still."""


class NodeClock:
    """Converts ROS's times. When the clock jumps back (a bag restarts), the node's time goes on from where it was."""

    def __init__(self, rospy: Any) -> None:
        self._rospy = rospy
        self._start_ns = int(rospy.Time.now().to_nsec())
        self._last_ns = self._start_ns
        self._parts: list[tuple[float, int]] = [(-math.inf, self._start_ns)]
        """Times (s) of the jumps, and ROS's time (ns) of the node's time 0 from then on."""

    @property
    def jumps(self) -> int:
        """Number of jumps backwards."""
        return len(self._parts) - 1

    def now(self) -> float:
        """Return the current time (s)."""
        now_ns = int(self._rospy.Time.now().to_nsec())
        if now_ns < self._last_ns - JUMP_NS:
            jumped_at = seconds(self._last_ns, self._start_ns)
            self._start_ns += now_ns - self._last_ns
            self._parts.append((jumped_at, self._start_ns))
        self._last_ns = max(now_ns, self._last_ns) if self.jumps == 0 else now_ns
        return seconds(now_ns, self._start_ns)

    def of(self, stamp: Any) -> float:
        """Return the time (s) of a stamp of a message."""
        return seconds(int(stamp.to_nsec()), self._start_ns)

    def ns(self, time: float) -> int:
        """Return ROS's time (ns) of a time (s) of the node; what was stamped before a jump keeps its stamp."""
        part = bisect.bisect_right(self._parts, time, key=lambda part: part[0]) - 1
        return max(0, self._parts[max(part, 0)][1] + round(time * 1e9))


class StillClock:
    """Notices that simulated time has stopped: a simulator that is paused, or that has ended."""

    def __init__(self, rospy: Any) -> None:
        self._rospy = rospy
        self._last = -1.0
        self._changed = time.monotonic()
        self.is_still = False
        """True while the clock stands still."""

    def is_new(self, now: float) -> bool:
        """Return True once when the clock has stood still at `now` (s) for `STILL_S`; both ends are logged."""
        wall = time.monotonic()
        if now != self._last:
            self._last, self._changed = now, wall
            if self.is_still:
                self.is_still = False
                self._rospy.logwarn("/clock goes on at %.3f s", now)
            return False
        if self.is_still or wall - self._changed < STILL_S:
            return False
        self.is_still = True
        self._rospy.logwarn(
            "/clock has stood still at %.3f s for %g s: the robot is stopped; goals wait until it goes on", now, STILL_S
        )
        return True


def wait_for_clock() -> bool:
    """Wait for the first message on `/clock` if time is simulated, with a warning every 5 s; return whether it is."""
    rospy = ros.rospy()
    if not rospy.get_param("/use_sim_time", False):
        return False
    warned = time.monotonic() - 4.0
    while rospy.Time.now().is_zero() and not ros.is_stopping():
        if time.monotonic() - warned > 5.0:
            warned = time.monotonic()
            rospy.logwarn("/use_sim_time is set: waiting for /clock")
        rospy.rostime.wallsleep(0.02)
    return True


# --- watches the ROS master: a node that outlives its master registers again at the next one --------------------------
# rospy registers once. After a restart of roscore the connections between nodes still work, but no other node finds it any more.


CHECK_S: Final = 1.0
"""Time between two checks (s, wall)."""


class MasterWatch:
    """A thread that asks the master for this node; it logs the loss and the return of the master once each."""

    def __init__(self, on_return: Callable[[], None] | None = None) -> None:
        """`on_return` is called in the thread after a registration at a new master, whose parameter server is empty."""
        self._rospy = ros.rospy()
        self._on_return = on_return
        self._name = str(self._rospy.get_name())
        self._uri = str(self._rospy.get_node_uri())
        self._master = xmlrpc.client.ServerProxy(ros.load("rosgraph").get_master_uri())
        self._is_lost = False
        self.registrations = 0
        """Number of registrations at a new master."""
        threading.Thread(target=self._run, name="master", daemon=True).start()

    def _run(self) -> None:
        while not ros.is_stopping():
            try:
                self.check()
            except (OSError, xmlrpc.client.Error) as exc:
                self._lose(exc)
            time.sleep(CHECK_S)

    def check(self) -> None:
        """Ask the master for this node, and register where it is unknown. Raises OSError without a master."""
        code, text, found = _answer(self._master.lookupNode(self._name, self._name))
        if code == 1 and found:
            # another node of this name: its registration has already asked this one to end
            self._is_lost = False
            return
        del text
        self._register()
        self.registrations += 1
        self._is_lost = False
        self._rospy.logwarn("the ROS master is a new one; this node is registered there now")
        if self._on_return is not None:
            self._on_return()

    def _lose(self, error: Exception) -> None:
        if not self._is_lost and not ros.is_stopping():
            self._is_lost = True
            self._rospy.logerr(
                "the ROS master does not answer (%s): connections that exist go on, new ones wait for it", error
            )

    def _register(self) -> None:
        """Register publishers, subscribers and services, and connect the subscribers to the publishers that are known."""
        own: Any = xmlrpc.client.ServerProxy(self._uri)
        master = self._master
        for topic, kind in _answer(own.getPublications(self._name))[2]:
            master.registerPublisher(self._name, topic, kind, self._uri)
        for topic, kind in _answer(own.getSubscriptions(self._name))[2]:
            publishers = _answer(master.registerSubscriber(self._name, topic, kind, self._uri))[2]
            own.publisherUpdate("/master", topic, publishers)
        for service, uri in ros.load("rospy.impl.registration").get_service_manager().get_services():
            master.registerService(self._name, service, uri, self._uri)


def _answer(value: Any) -> tuple[int, str, Any]:
    code, text, data = value
    return int(code), str(text), data


# --- what the node writes to its log: one line per problem, not one per cycle -----------------------------------------


REPEAT_S: Final = 60.0
"""A problem that goes on is logged again after this time (s, wall)."""
FORGET_S: Final = 2.0
"""A problem that was absent for this time (s, wall) is a new one."""
HOLD_S: Final = 0.6
"""Time (s, wall) for which a problem waits for a stop that follows from it."""
MOST: Final = 200
"""Problems that are remembered."""
_NUMBERS: Final = re.compile(r"-?\b(\d+\.?\d*(e[+-]?\d+)?|nan|inf)\b")
STOPPED: Final = ("[", "the robot is stopped")
"""Beginnings of the texts that report a stop: move_base's "[local_costmap]:Sensor data is out of date", and navstack's."""

_ENDS: Final = ("finished.", " ends")


class _Problem(NamedTuple):
    cause: str
    line: str
    time: float
    """Time at which it was logged (s, wall)."""
    is_message: bool
    """True for a message that cannot be used."""


class NodeLog:
    """Collects the problems of the cycles; `flush` writes those that are new.

    A stop is logged with its cause: problems wait for `HOLD_S`, so that a stop that follows from them takes their place. What
    else fails is left out while the robot stands.
    """

    def __init__(self, rospy: Any, newest_data: Callable[[], str]) -> None:
        """`newest_data` describes the ages of the sensor data, for a stop because of one that is missing."""
        self._rospy = rospy
        self._newest_data = newest_data
        self._waiting: list[_Problem] = []
        self._seen: dict[str, tuple[float, float]] = {}
        """Time of the last line and of the last occurrence by cause (s, wall)."""
        self._is_stopped = False

    def event(self, event: Event) -> None:
        """Log an event of the goal manager that is a warning or a failure."""
        cause, text = str(event.data.get("message", "")), event.text
        if event.kind == "recovery" and not cause:
            # as in C++: the beginning is a warning
            log = self._rospy.loginfo if text.endswith(_ENDS) else self._rospy.logwarn
            log("%s", ros.line_of(text))
        elif text.startswith("Aborting"):
            self._rospy.logerr("%s", ros.line_of(text))
        elif text.startswith(STOPPED):
            self._stop(text, cause)
        elif not cause:
            self._rospy.logwarn("%s", ros.line_of(text))
        else:
            line = text if cause in text else f"{text}: {cause}"
            self._add(cause, f"no command: {line}" if event.kind == "control_failed" else line)

    def problem(self, text: str) -> None:
        """Log a problem with a message; it is logged as the cause of a stop that follows."""
        self._add(text, text, is_message=True)

    def flush(self, *, drives: bool) -> None:
        """Write the problems that have waited. `drives`: the local planner has found a command since the last call."""
        if drives:
            self._is_stopped = False
        now = time.monotonic()
        while self._waiting and now - self._waiting[0].time >= HOLD_S:
            self._rospy.logwarn("%s", ros.line_of(self._waiting.pop(0).line))

    def finish(self) -> None:
        """Write everything that waits."""
        for problem in self._waiting:
            self._rospy.logwarn("%s", ros.line_of(problem.line))
        self._waiting.clear()

    def _add(self, cause: str, line: str, *, is_message: bool = False) -> None:
        if self._is_new(cause) and not self._is_stopped:
            self._waiting.append(_Problem(cause, line, time.monotonic(), is_message))

    def _stop(self, text: str, cause: str) -> None:
        causes = [problem.cause for problem in self._waiting if problem.is_message or not cause]
        reason = causes[0] if causes else cause or self._newest_data()
        is_new = bool(self._waiting) or self._is_new(cause or text)
        self._waiting.clear()
        if not self._is_stopped and is_new:
            self._rospy.logwarn("%s", ros.line_of(text if reason in text else f"{text}: {reason}"))
        self._is_stopped = True

    def _is_new(self, cause: str) -> bool:
        """Return True for a problem that is not known, or has gone on for `REPEAT_S`."""
        now, key = time.monotonic(), _NUMBERS.sub("#", cause)
        said, seen = self._seen.get(key, (-math.inf, -math.inf))
        new = now - seen > FORGET_S or now - said > REPEAT_S
        if len(self._seen) > MOST:
            self._seen.clear()
        self._seen[key] = (now if new else said), now
        return new
