"""What a node writes to its log: one line per problem, not one per cycle."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from typing import Any, Final, NamedTuple, Protocol

from navstack.core import Event, shortened

LONGEST_LINE: Final = 2_000
"""Longest line of the log (characters)."""


class Log(Protocol):
    """The log of a node; texts and values as for `%`. The module rospy is one."""

    def loginfo(self, text: str, *values: Any) -> None:
        """Log something to know."""
        ...

    def logwarn(self, text: str, *values: Any) -> None:
        """Log a warning."""
        ...

    def logerr(self, text: str, *values: Any) -> None:
        """Log an error."""
        ...


def line_of(text: str) -> str:
    """Return a text for the log, as one line: names in messages are those of other programs, and may hold anything.

    A control character, such as the end of a line, is written as in a literal of Python.
    """
    if not text.isprintable():
        text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return shortened(text, LONGEST_LINE)


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

    def __init__(self, log: Log, newest_data: Callable[[], str]) -> None:
        """`newest_data` describes the ages of the sensor data, for a stop because of one that is missing."""
        self._log = log
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
            log = self._log.loginfo if text.endswith(_ENDS) else self._log.logwarn
            log("%s", line_of(text))
        elif text.startswith("Aborting"):
            self._log.logerr("%s", line_of(text))
        elif text.startswith(STOPPED):
            self._stop(text, cause)
        elif not cause:
            self._log.logwarn("%s", line_of(text))
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
            self._log.logwarn("%s", line_of(self._waiting.pop(0).line))

    def finish(self) -> None:
        """Write everything that waits."""
        for problem in self._waiting:
            self._log.logwarn("%s", line_of(problem.line))
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
            self._log.logwarn("%s", line_of(text if reason in text else f"{text}: {reason}"))
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
