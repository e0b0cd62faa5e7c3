"""Access to Debian's rospy and message packages."""

from __future__ import annotations

import importlib
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from navstack.core.errors import NotSupportedError

DEBIAN: Final = Path("/usr/lib/python3/dist-packages")
"""Debian's Python packages; appended to the search path, so that those of the virtual environment win."""
INSTALL: Final = (
    "sudo apt-get install python3-rospy python3-actionlib python3-move-base-msgs python3-map-msgs python3-dynamic-reconfigure "
    "python3-diagnostic-msgs python3-tf2-msgs python3-std-srvs python3-trajectory-msgs"
)


STOP: Final = threading.Event()
"""Set when the process was asked to end: the node sends its last messages, then the connections are closed."""
FLUSH_S: Final = 0.2
"""Time for the last messages to leave (s, wall)."""
LONGEST_FLUSH_S: Final = 2.0
"""Longest wait for the last messages (s, wall)."""
_flushed: Final = threading.Event()
"""Set when the last messages have left."""


def is_stopping() -> bool:
    """Return True if the node must end."""
    return STOP.is_set() or bool(rospy().is_shutdown())


def flush_at_shutdown() -> None:
    """Let the node send its last messages before rospy closes: `rosnode kill`, or another node of the same name."""
    rospy().on_shutdown(_wait_for_last_messages)


def _wait_for_last_messages() -> None:
    STOP.set()
    _flushed.wait(LONGEST_FLUSH_S)


def shut_down(last: Callable[[], None]) -> None:
    """Call `last`, which publishes the last messages, give them time to leave, and end the node.

    Without connections (rospy was shut down before) nothing can be published.
    """
    node = rospy()
    if not node.is_shutdown():
        try:
            last()
            node.rostime.wallsleep(FLUSH_S)
        except node.ROSException as exc:
            node.logdebug("the last messages could not be sent: %s", exc)
    _flushed.set()
    node.signal_shutdown("end of the node")
    # a shutdown from outside runs in another thread: it must have unregistered before this process ends
    end = time.monotonic() + LONGEST_FLUSH_S
    while not node.is_shutdown() and time.monotonic() < end:
        node.rostime.wallsleep(0.01)


def load(module: str) -> Any:
    """Import a module of ROS 1. Raises NotSupportedError with the command that installs it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        if DEBIAN.is_dir() and str(DEBIAN) not in sys.path:
            sys.path.append(str(DEBIAN))
            importlib.invalidate_caches()
    try:
        return importlib.import_module(module)
    except ImportError as exc:
        raise NotSupportedError(
            f"ROS 1 is not installed ({module} is missing); on Debian 12: {INSTALL}", module=module
        ) from exc


def rospy() -> Any:
    """Return the module rospy. Raises NotSupportedError."""
    return load("rospy")


def message(name: str) -> Any:
    """Return the class of a message or service: `nav_msgs/Path`, `nav_msgs/srv/GetPlan`. Raises NotSupportedError."""
    parts = name.split("/")
    kind = parts[1] if len(parts) == 3 else "msg"
    return getattr(load(f"{parts[0]}.{kind}"), parts[-1])


class MessageTypes:
    """The classes of messages by the names of ROS 2 (`nav_msgs/msg/Path`), as `MessageBuilder` asks for them."""

    def __init__(self) -> None:
        self.types = self
        self._known: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        found = self._known.get(name)
        if found is None:
            found = self._known[name] = self._find(name)
        return found

    def _find(self, name: str) -> Any:
        if name == "builtin_interfaces/msg/Time":
            return _time_of(load("genpy").Time)
        if name == "builtin_interfaces/msg/Duration":
            return _time_of(load("genpy").Duration)
        cls = message(name.replace("/msg/", "/"))

        def build(**fields: Any) -> Any:
            return cls(**{key: _plain(value) for key, value in fields.items()})

        return build


def _time_of(cls: Any) -> Any:
    def build(sec: int, nanosec: int) -> Any:
        return cls(sec, nanosec)

    return build


def _plain(value: Any) -> Any:
    """Return an array as rospy serializes it fast: bytes for uint8, otherwise a list."""
    if hasattr(value, "tolist"):
        return value.tobytes() if str(value.dtype) == "uint8" else value.tolist()
    return value
