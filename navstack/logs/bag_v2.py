"""ROS 1 bags, read chunk by chunk: the memory depends on the chunks that overlap in time, not on the size of the bag.

rosbags keeps an index entry of every message in memory, a gigabyte for a bag of 10 GB, and refuses bags without an index.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

from navstack.core.bounded_reading import open_regular
from navstack.core.errors import LogError
from navstack.logs.bag_chunks import BagLayout, ChunkEntry, chunk_messages, read_layout
from navstack.logs.bag_records import BagFormatError
from navstack.logs.chunk_merge import ordered_messages
from navstack.logs.decoding import Decoder
from navstack.logs.log import Channel, Log, damaged, seconds


def open_bag(path: Path) -> Log:
    """Open a ROS 1 bag. Raises LogError."""
    decoder = Decoder(ros1=True)
    return Log(path, _BagV2(path, decoder), format="ROS 1 bag", is_ros1=True)


class _BagV2:
    """A ROS 1 bag, version 2.0."""

    def __init__(self, path: Path, decoder: Decoder) -> None:
        self._path = path
        self._decoder = decoder
        self._file: BinaryIO = open_regular(path)
        try:
            self._layout = _layout(path, self._file)
        except BaseException:
            self._file.close()
            raise
        counts: dict[int, int] = {}
        for chunk in self._layout.chunks:
            for number, count in chunk.counts.items():
                counts[number] = counts.get(number, 0) + count
        merged: dict[tuple[str, str, str], Channel] = {}
        self._channel_of: dict[int, Channel] = {}
        for number, channel in self._layout.connections.items():
            # several publishers of a topic are several connections
            key = channel.topic, channel.type, channel.definition
            known = merged.get(key, replace(channel, count=0))
            merged[key] = replace(
                known, count=known.count + counts.get(number, 0), latched=known.latched or channel.latched
            )
        for number, channel in self._layout.connections.items():
            self._channel_of[number] = merged[channel.topic, channel.type, channel.definition]
        self._channels = tuple(merged.values())

    @property
    def channels(self) -> Sequence[Channel]:
        return self._channels

    @property
    def span_ns(self) -> tuple[int, int] | None:
        chunks = [chunk for chunk in self._layout.chunks if chunk.counts]
        if not chunks:
            return None
        return min(chunk.start_ns for chunk in chunks), max(chunk.end_ns for chunk in chunks)

    @property
    def problem(self) -> LogError | None:
        problem = self._layout.problem
        if problem is None:
            return None
        return damaged(self._path, problem.message, problem.offset, self._channels, self.span_ns)

    def decode(self, channel: Channel, raw: bytes) -> Any:
        return self._decoder.decode(channel, raw)

    def close(self) -> None:
        self._file.close()

    def raw_messages(
        self, channels: Collection[Channel], start_ns: int | None, end_ns: int | None
    ) -> Iterator[tuple[Channel, int, bytes]]:
        chosen = set(channels)
        wanted = {number: channel for number, channel in self._channel_of.items() if channel in chosen}
        return ordered_messages(self._path, self._layout.chunks, self._messages_of, wanted, start_ns, end_ns)

    def _messages_of(self, chunk: ChunkEntry) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield position, connection, time and data of each message of a chunk. Raises LogError."""
        try:
            yield from chunk_messages(self._file, chunk, self._layout)
        except BagFormatError as exc:
            raise LogError(
                f"{self._path}: {exc.message} (offset {chunk.offset}); the messages before "
                f"{seconds(chunk.start_ns):.3f} s can be read: `--to`, or `end=` in Python",
                path=str(self._path),
                offset=chunk.offset,
            ) from exc


def _layout(path: Path, file: BinaryIO) -> BagLayout:
    try:
        return read_layout(file)
    except BagFormatError as exc:
        raise LogError(
            f"{path} is not a ROS 1 bag that can be read: {exc.message} (offset {exc.offset})",
            path=str(path),
            offset=exc.offset,
        ) from exc
