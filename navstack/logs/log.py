"""What a log of any format offers: its channels and its messages, ordered by time."""

from __future__ import annotations

import heapq
import weakref
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, TypeVar

from navstack.core import LogError, require, shortened, size_text
from navstack.ros_messages import NS_PER_S, seconds, topic_name


def damaged(
    path: Path, message: str, offset: int, channels: Sequence[Channel], span_ns: tuple[int, int] | None
) -> LogError:
    """Return the error of a file of which only a part can be read: `message` says what is wrong at byte `offset`."""
    count = sum(channel.count for channel in channels)
    if span_ns is None or not count:
        readable = "no message can be read"
    else:
        noun = "message" if count == 1 else "messages"
        readable = f"{count:,} {noun} of the first {seconds(span_ns[1], span_ns[0]):.1f} s can be read: use --partial"
    return LogError(f"{path} {message} (offset {offset:,}); {readable}", path=str(path), offset=offset, messages=count)


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic with one type of message."""

    topic: str
    type: str
    """Type in the notation of ROS 2, in both versions: `sensor_msgs/msg/LaserScan`."""
    count: int = 0
    """Number of messages; 0 if the file does not say."""
    definition: str = field(default="", repr=False)
    """Definition of the type in the notation of .msg files; empty if the file has none."""
    latched: bool = False
    """The last message was sent to every new subscriber (ROS 1), or kept for it (ROS 2: transient local)."""


class LogMessage:
    """A message as it was recorded; it is decoded when `data` is first read."""

    __slots__ = ("_decode", "channel", "raw", "time_ns")

    def __init__(self, channel: Channel, time_ns: int, raw: bytes, decode: Callable[[Channel, bytes], Any]) -> None:
        """`time_ns`: time of the recording (ns since the epoch of the log's clock)."""
        self.channel = channel
        self.time_ns = time_ns
        self.raw = raw
        self._decode = decode

    @property
    def topic(self) -> str:
        """The topic, with a leading slash."""
        return self.channel.topic

    @property
    def type(self) -> str:
        """The type, as `sensor_msgs/msg/LaserScan`."""
        return self.channel.type

    @property
    def time(self) -> float:
        """Time of the recording (s since the epoch of the log's clock); `time_ns` is exact."""
        return seconds(self.time_ns)

    @property
    def data(self) -> Any:
        """The message, of the type that rosbags makes of its definition. Raises LogError if it cannot be decoded."""
        return self._decode(self.channel, self.raw)


class Source(Protocol):
    """A file format: finds the channels, and yields raw messages ordered by time."""

    @property
    def channels(self) -> Sequence[Channel]:
        """The channels of the file."""
        ...

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Times of the first and the last message (ns); None without messages."""
        ...

    @property
    def problem(self) -> LogError | None:
        """What is damaged; None if the file is complete. The messages are those that can be read."""
        ...

    def raw_messages(
        self, channels: Collection[Channel], start_ns: int | None, end_ns: int | None
    ) -> Iterator[tuple[Channel, int, bytes]]:
        """Yield channel, time (ns) and bytes of the messages with `start_ns` <= time <= `end_ns`, ordered by time."""
        ...

    def decode(self, channel: Channel, raw: bytes) -> Any:
        """Decode a message. Raises LogError."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


class Log:
    """An open log. Close it, or use it in a `with` statement.

    `is_ros1` is True for bags of ROS 1. `problem` says what is damaged in a file that was opened with `partial=True`.
    """

    def __init__(self, path: Path, source: Source, *, format: str, is_ros1: bool) -> None:
        self.path = path
        self.format = format
        """`ROS 1 bag`, `ROS 2 bag (sqlite3)`, `ROS 2 bag (mcap)` or `MCAP`."""
        self.is_ros1 = is_ros1
        self.notes: list[str] = []
        """What was chosen without being named."""
        self._source = source
        # a replay that is explained keeps its log open; the replay does not close it
        self._finalizer = weakref.finalize(self, source.close)

    def __enter__(self) -> Log:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._finalizer()

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The channels, ordered by topic and type."""
        return tuple(sorted(self._source.channels, key=lambda channel: (channel.topic, channel.type)))

    @property
    def problem(self) -> LogError | None:
        """What is damaged; None if the file is complete."""
        return self._source.problem

    @cached_property
    def _span_ns(self) -> tuple[int, int]:
        return self._source.span_ns or (0, 0)

    @property
    def start_ns(self) -> int:
        """Time of the first message (ns); 0 without messages."""
        return self._span_ns[0]

    @property
    def end_ns(self) -> int:
        """Time of the last message (ns); 0 without messages."""
        return self._span_ns[1]

    @property
    def duration(self) -> float:
        """Time between the first and the last message (s)."""
        return seconds(self.end_ns, self.start_ns)

    @property
    def types(self) -> dict[str, set[str]]:
        """The types of each topic: more than one if its publishers do not agree."""
        found: dict[str, set[str]] = {}
        for channel in self.channels:
            found.setdefault(channel.topic, set()).add(channel.type)
        return found

    def has(self, topic: str) -> bool:
        """Return True if the log has this topic."""
        return any(channel.topic == topic_name(topic) for channel in self.channels)

    def topics_of(self, *types: str) -> list[str]:
        """Return the topics with one of these types, ordered."""
        return sorted({channel.topic for channel in self.channels if channel.type in types})

    def messages(
        self, topics: Collection[str] | None = None, *, start: float | None = None, end: float | None = None
    ) -> Iterator[LogMessage]:
        """Yield the messages of these topics (None: of all), ordered by the time of their recording.

        `start` and `end` are in seconds since the first message of the log; both limits belong to the range. Raises LogError
        for a topic that the log does not have, and at a part of the file that cannot be read.
        """
        channels = self.channels
        if topics is not None:
            wanted = {topic_name(topic) for topic in topics}
            missing = sorted(wanted - {channel.topic for channel in channels})
            if missing:
                known = ", ".join(sorted({channel.topic for channel in channels})) or "none"
                raise LogError(f"{self.path} has no topic {', '.join(missing)}; its topics are {known}", topics=missing)
            channels = tuple(channel for channel in channels if channel.topic in wanted)
        first = None if start is None else self.start_ns + round(start * NS_PER_S)
        last = None if end is None else self.start_ns + round(end * NS_PER_S)
        decode = self._source.decode
        for channel, time_ns, raw in self._source.raw_messages(channels, first, last):
            yield LogMessage(channel, time_ns, raw, decode)


# --- decodes messages with rosbags: the types come from the definitions in the file -----------------------------------


MOST_TYPES: Final = 500
"""Largest number of definitions whose decoders are kept."""

Decode = Callable[[bytes, str], Any]


class Decoder:
    """Decodes the messages of one log. Types with the same name and another definition do not disturb each other."""

    def __init__(self, *, ros1: bool) -> None:
        """`ros1`: messages are serialized as in ROS 1, else as CDR. Raises InputError if rosbags is not installed."""
        require("rosbags.typesys", "reading a log")
        self._ros1 = ros1
        self._decoders: dict[tuple[str, str], Decode] = {}

    def decode(self, channel: Channel, raw: bytes) -> Any:
        """Return a message. Raises LogError."""
        key = channel.type, channel.definition
        decode = self._decoders.get(key)
        if decode is None:
            decode = self._decoders[key] = self._decoder(channel)
        try:
            return decode(raw, channel.type)
        except Exception as exc:
            # any error of generated code on damaged bytes
            raise LogError(
                f"a message of {channel.topic} cannot be decoded as {channel.type}: {_reason(exc)}",
                topic=channel.topic,
                type=channel.type,
            ) from exc

    def _decoder(self, channel: Channel) -> Decode:
        """Return the function that decodes a channel's messages. Raises LogError for a definition that is not valid."""
        try:
            return _decode_of(channel.type, channel.definition, self._ros1)
        except Exception as exc:
            # any error of the parser of definitions
            raise LogError(
                f"the definition of {channel.type}, the type of {channel.topic}, is not valid: {_reason(exc)}",
                topic=channel.topic,
                type=channel.type,
            ) from exc


@lru_cache(MOST_TYPES)
def _decode_of(kind: str, definition: str, ros1: bool) -> Decode:
    """Return the function of a type; code is generated for it, which takes some milliseconds."""
    typesys = require("rosbags.typesys", "reading a log")
    if definition:
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        store.register(typesys.get_types_from_msg(definition, kind))
    else:
        store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
    store.get_msgdef(kind)
    return store.deserialize_ros1 if ros1 else store.deserialize_cdr


def _reason(exc: Exception) -> str:
    return shortened(" ".join(str(exc).split()) or type(exc).__name__, 120)


# --- messages of many chunks, ordered by time; only the chunks that overlap in time are in memory at once -------------


MAX_WAITING: Final = 300_000_000
"""Largest number of bytes that wait because chunks overlap in time."""


class Chunk(Protocol):
    """A part of a file whose messages are read together."""

    @property
    def offset(self) -> int:
        """Position in the file."""
        ...

    @property
    def start_ns(self) -> int:
        """Time of the first message (ns)."""
        ...

    @property
    def end_ns(self) -> int:
        """Time of the last message (ns)."""
        ...

    @property
    def counts(self) -> Mapping[int, int]:
        """Number of messages by channel number; without some of the channels, the chunk is not read for them."""
        ...


C = TypeVar("C", bound=Chunk)


def ordered_messages(
    path: Path,
    chunks: Sequence[C],
    messages_of: Callable[[C], Iterator[tuple[int, int, int, bytes]]],
    wanted: Mapping[int, Channel],
    start_ns: int | None,
    end_ns: int | None,
) -> Iterator[tuple[Channel, int, bytes]]:
    """Yield the messages of the `wanted` channels (by number) in a range of time (ns), ordered by time, then by position.

    `messages_of` yields position, channel number, time (ns) and data of each message of a chunk. Raises LogError if chunks
    overlap so much that `MAX_WAITING` bytes would wait.
    """
    first = -1 if start_ns is None else start_ns
    last = 1 << 64 if end_ns is None else end_ns
    chosen = [
        chunk
        for chunk in chunks
        if chunk.end_ns >= first and chunk.start_ns <= last and not wanted.keys().isdisjoint(chunk.counts)
    ]
    chosen.sort(key=lambda chunk: (chunk.start_ns, chunk.offset))
    waiting: list[tuple[int, int, int, int, bytes]] = []
    size = 0
    for i, chunk in enumerate(chosen):
        for at, number, time_ns, raw in messages_of(chunk):
            if number in wanted and first <= time_ns <= last:
                heapq.heappush(waiting, (time_ns, chunk.offset, at, number, raw))
                size += len(raw)
        if size > MAX_WAITING:
            raise LogError(
                f"{path}: its messages are so far out of order that more than {size_text(MAX_WAITING)} would wait in memory "
                f"(offset {chunk.offset}); sort the file by time first",
                path=str(path),
                offset=chunk.offset,
            )
        limit = chosen[i + 1].start_ns if i + 1 < len(chosen) else 1 << 65
        while waiting and waiting[0][0] < limit:
            time_ns, _, _, number, raw = heapq.heappop(waiting)
            size -= len(raw)
            yield wanted[number], time_ns, raw
