"""ROS 2 bags: a folder with metadata.yaml, or a single sqlite3 file, read with rosbags."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from navstack.core import LogError, require, shortened
from navstack.logs.log import Channel, Decoder, Log
from navstack.ros_messages import topic_name

T = TypeVar("T")


def open_rosbag2(path: Path) -> Log:
    """Open a ROS 2 bag. Raises LogError, and InputError if the extra is not installed."""
    source = _Rosbag2(path)
    return Log(path, source, format="ROS 2 bag", is_ros1=False)


class _Rosbag2:
    """A ROS 2 bag."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._decoder = Decoder(ros1=False)
        reader_of = require("rosbags.rosbag2", "reading a ROS 2 bag").Reader
        self._reader: Any = self._checked(lambda: reader_of(path))
        self._checked(self._reader.open)
        self._connections: dict[Channel, Any] = {}
        for connection in self._reader.connections:
            definition = connection.msgdef
            channel = Channel(
                topic_name(connection.topic),
                connection.msgtype,
                connection.msgcount,
                definition.data if definition.format.name == "MSG" else "",
                any(profile.durability.name == "TRANSIENT_LOCAL" for profile in connection.ext.offered_qos_profiles),
            )
            self._connections[channel] = connection
        self.problem: LogError | None = None

    @property
    def channels(self) -> Sequence[Channel]:
        return tuple(self._connections)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        if not self._reader.message_count:
            return None
        # rosbags counts a nanosecond more, so that the end is not part of the range
        return self._reader.start_time, max(self._reader.end_time - 1, self._reader.start_time)

    def decode(self, channel: Channel, raw: bytes) -> Any:
        return self._decoder.decode(channel, raw)

    def close(self) -> None:
        self._reader.close()

    def raw_messages(
        self, channels: Collection[Channel], start_ns: int | None, end_ns: int | None
    ) -> Iterator[tuple[Channel, int, bytes]]:
        chosen = [self._connections[channel] for channel in channels]
        if not chosen:
            return
        of = {(item.id, item.topic): channel for channel, item in self._connections.items()}
        messages = self._reader.messages(chosen, start_ns, None if end_ns is None else end_ns + 1)
        while True:
            found = self._checked(lambda: next(messages, None))
            if found is None:
                return
            connection, time_ns, raw = found
            yield of[connection.id, connection.topic], time_ns, bytes(raw)

    def _checked(self, call: Callable[[], T]) -> T:
        """Call a function of rosbags. Raises LogError."""
        try:
            return call()
        except Exception as exc:  # any error of rosbags, sqlite3 or a parser on a damaged file
            reason = shortened(" ".join(str(exc).split()) or type(exc).__name__, 120)
            raise LogError(f"{self._path} is truncated or damaged: {reason}", path=str(self._path)) from exc
