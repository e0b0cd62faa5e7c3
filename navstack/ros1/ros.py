"""Access to Debian's rospy and message packages."""

from __future__ import annotations

import importlib
import logging
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from navstack.core import NotSupportedError
from navstack.ros_node import line_of

DEBIAN: Final = Path("/usr/lib/python3/dist-packages")
"""Debian's Python packages; appended to the search path, so that those of the virtual environment win."""
INSTALL: Final = (
    "sudo apt-get install python3-rospy python3-actionlib python3-move-base-msgs python3-map-msgs python3-dynamic-reconfigure "
    "python3-diagnostic-msgs python3-tf2-msgs python3-std-srvs python3-trajectory-msgs"
)
VOXEL_GRID: Final = "costmap_2d/VoxelGrid"
DEFINITIONS: Final = {
    VOXEL_GRID: (
        "Header header\nuint32[] data\ngeometry_msgs/Point32 origin\ngeometry_msgs/Vector3 resolutions\n"
        "uint32 size_x\nuint32 size_y\nuint32 size_z\n"
    ),
    "handsfree_msgs/srv/SpecialMove": "float32 target_distance_move\n---\nbool success\n",
    "handsfree_msgs/srv/SpecialTurn": "float32 target_radian_turn\n---\nbool success\n",
}
"""Text of each .msg or .srv file that Debian does not package, by the name that `message` takes."""
_MEMBERS: Final = ("std_msgs/Header", "geometry_msgs/Point32", "geometry_msgs/Vector3")
"""Messages of Debian that the definitions contain."""
_generated: Final[dict[str, Any]] = {}

STOP: Final = threading.Event()
"""Set when the process was asked to end: the node sends its last messages, then the connections are closed."""
FLUSH_S: Final = 0.2
"""Time for the last messages to leave (s, wall)."""
LONGEST_FLUSH_S: Final = 2.0
"""Longest wait for the last messages (s, wall)."""
_flushed: Final = threading.Event()
"""Set when the last messages have left."""


LOGGER: Final = "rosout"
"""The logger of rospy."""


def escape_log() -> None:
    """Write what this node logs, on the terminal and on /rosout, by `line_of`."""
    logging.getLogger(LOGGER).addFilter(_escape)


def _escape(record: logging.LogRecord) -> bool:
    record.msg, record.args = line_of(record.getMessage()), ()
    return True


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


def now_ns() -> int:
    """Return ROS's time (ns)."""
    return int(rospy().Time.now().to_nsec())


def message(name: str) -> Any:
    """Return the class of a message or service: `nav_msgs/Path`, `nav_msgs/srv/GetPlan`.

    Those of `DEFINITIONS` are generated if no package has them. Raises NotSupportedError.
    """
    parts = name.split("/")
    package, kind, short = parts[0], parts[1] if len(parts) == 3 else "msg", parts[-1]
    try:
        return getattr(load(f"{package}.{kind}"), short)
    except (NotSupportedError, AttributeError):
        if name not in DEFINITIONS:
            raise
    rospy()
    if name not in _generated:
        scope: dict[str, Any] = {"__name__": f"{package}.{kind}._{short}"}
        exec(generated_code(name), scope)
        _generated[name] = scope[short]
    return _generated[name]


def array_message(name: str) -> Any:
    """Return the class of a message whose arrays of numbers arrive as arrays of numpy, not as tuples of Python's numbers."""
    return load("rospy.numpy_msg").numpy_msg(message(name))


def generated_code(name: str) -> str:
    """Return the Python code of a message or service of `DEFINITIONS`, as Debian's genpy generates it.

    To other nodes there is no difference: the checksum follows from the definition. Raises NotSupportedError without ROS.
    """
    loader, generator = load("genmsg.msg_loader"), load("genpy.generator")
    context = load("genmsg").MsgContext.create_default()
    for member in _MEMBERS:
        text = str(message(member)._full_text).split("=" * 80)[0]
        loader.load_msg_from_string(context, text, member)
    is_service = "/srv/" in name
    load_text = loader.load_srv_from_string if is_service else loader.load_msg_from_string
    spec = load_text(context, DEFINITIONS[name], name.replace("/srv/", "/"))
    generate = generator.srv_generator if is_service else generator.msg_generator
    no_search: dict[str, list[str]] = {}
    return "\n".join(generate(context, spec, no_search)) + "\n"


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
