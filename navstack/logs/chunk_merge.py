"""Messages of many chunks, ordered by time; only the chunks that overlap in time are in memory at once."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol, TypeVar

from navstack.core.bounded_reading import size_text
from navstack.core.errors import LogError
from navstack.logs.log import Channel

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
