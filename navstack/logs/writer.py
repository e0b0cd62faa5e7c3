"""Writes logs: ROS 1 bags with rosbags, MCAP files with messages of ROS 2 with mcap."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal, Protocol

from navstack.core import InputError, OutputError, require

Format = Literal["bag", "mcap"]

_MORE_TYPES: Final[dict[str, str]] = {
    "map_msgs/msg/OccupancyGridUpdate": (
        "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data\n"
    ),
}
"""Types that rosbags does not have."""
_MORE_ROS1_TYPES: Final[dict[str, str]] = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "move_base_msgs/msg/MoveBaseGoal": "geometry_msgs/PoseStamped target_pose\n",
    "move_base_msgs/msg/MoveBaseResult": "",
    "move_base_msgs/msg/MoveBaseActionGoal": (
        "std_msgs/Header header\nactionlib_msgs/GoalID goal_id\nmove_base_msgs/MoveBaseGoal goal\n"
    ),
    "move_base_msgs/msg/MoveBaseActionResult": (
        "std_msgs/Header header\nactionlib_msgs/GoalStatus status\nmove_base_msgs/MoveBaseResult result\n"
    ),
}


def typestore(*, ros1: bool) -> Any:
    """Return the types of ROS noetic or humble, with those of move_base and map_msgs."""
    typesys = require("rosbags.typesys", "writing a log")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
    for name, definition in {**_MORE_TYPES, **(_MORE_ROS1_TYPES if ros1 else {})}.items():
        store.register(typesys.get_types_from_msg(definition, name))
    return store


class LogWriter(Protocol):
    """An open log to write to."""

    def write(self, topic: str, kind: str, time_ns: int, message: Any, *, latched: bool = False) -> None:
        """Write a message of the type `kind`; the first one of a topic decides whether the topic is latched."""
        ...

    def close(self) -> None:
        """Complete the file."""
        ...


def log_format(path: Path) -> Format:
    """Return the format of a file by its suffix. Raises InputError."""
    suffix = path.suffix.lower()
    if suffix == ".bag":
        return "bag"
    if suffix == ".mcap":
        return "mcap"
    raise InputError(
        f"{path} has the suffix {suffix or 'of no format'!r}; end the name with .bag (ROS 1) or .mcap (ROS 2)",
        path=str(path),
    )


class BagWriter:
    """Writes a ROS 1 bag, compressed with LZ4 if `compress`. `path` must not exist."""

    def __init__(self, path: Path, store: Any, *, compress: bool = False) -> None:
        writer = require("rosbags.rosbag1", "writing a bag").Writer
        self._store = store
        self._writer: Any = writer(path)
        if compress:
            self._writer.set_compression(writer.CompressionFormat.LZ4)
        self._writer.open()
        self._connections: dict[str, Any] = {}

    def write(self, topic: str, kind: str, time_ns: int, message: Any, *, latched: bool = False) -> None:
        connection = self._connections.get(topic)
        if connection is None:
            connection = self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._store, callerid="/navstack", latching=1 if latched else 0
            )
        self._writer.write(connection, time_ns, self._store.serialize_ros1(message, kind))

    def close(self) -> None:
        self._writer.close()


class McapWriter:
    """Writes an MCAP file with messages of ROS 2, compressed with zstd."""

    def __init__(self, path: Path, store: Any) -> None:
        writer = require("mcap.writer", "writing an MCAP file").Writer
        self._store = store
        self._file = path.open("wb")
        self._writer: Any = writer(self._file)
        self._writer.start("ros2", "navstack")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._sequence = 0

    def write(self, topic: str, kind: str, time_ns: int, message: Any, *, latched: bool = False) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._add_channel(topic, kind, latched=latched)
        self._sequence += 1
        data = bytes(self._store.serialize_cdr(message, kind))
        self._writer.add_message(channel, time_ns, data, time_ns, self._sequence)

    def _add_channel(self, topic: str, kind: str, *, latched: bool) -> int:
        schema = self._schemas.get(kind)
        if schema is None:
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            schema = self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition.encode())
        profile = f"- {{history: keep_last, depth: 1, reliability: reliable, durability: {_durability(latched)}}}\n"
        return self._writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": profile})

    def close(self) -> None:
        self._writer.finish()
        self._file.close()


def _durability(latched: bool) -> str:
    return "transient_local" if latched else "volatile"


class open_writer:
    """Context of a writer for a temporary file, which is renamed to `path` at the end and removed after an error.

    Raises OutputError, and InputError for a suffix without a format or a missing extra.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._format = log_format(path)
        self.store = typestore(ros1=self._format == "bag")
        self._beside = path.with_name(f".{path.stem}.part{path.suffix}")
        self._writer: BagWriter | McapWriter | None = None

    @property
    def is_ros1(self) -> bool:
        """True for a ROS 1 bag."""
        return self._format == "bag"

    def __enter__(self) -> LogWriter:
        try:
            self._beside.unlink(missing_ok=True)
            if self._format == "bag":
                self._writer = BagWriter(self._beside, self.store)
            else:
                self._writer = McapWriter(self._beside, self.store)
        except OSError as exc:
            raise OutputError(f"cannot write {self._path}: {exc.strerror or exc}", path=str(self._path)) from exc
        return self._writer

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._writer is not None
        try:
            self._writer.close()
            if kind is None:
                self._beside.replace(self._path)
        except OSError as exc:
            if kind is None:
                raise OutputError(f"cannot write {self._path}: {exc.strerror or exc}", path=str(self._path)) from exc
        finally:
            self._beside.unlink(missing_ok=True)
