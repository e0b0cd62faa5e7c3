"""ROS 1 bags, read chunk by chunk: the memory depends on the chunks that overlap in time, not on the size of the bag.

rosbags keeps an index entry of every message in memory, a gigabyte for a bag of 10 GB, and refuses bags without an index
(docs/decisions/0003-reading-bags.md). Source of the format: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import os
import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from navstack.core import LogError, open_regular, require, size_text
from navstack.logs.log import Channel, Decoder, Log, damaged, ordered_messages
from navstack.ros_messages import seconds, topic_name

# --- records: <u32 length><header><u32 length><data>; a header is a list of name=value --------------------------------


MESSAGE: Final = 0x02
BAG_HEADER: Final = 0x03
INDEX: Final = 0x04
CHUNK: Final = 0x05
CHUNK_INFO: Final = 0x06
CONNECTION: Final = 0x07

MAX_HEADER: Final = 1_000_000
"""Largest header of a record (bytes)."""
MAX_CHUNK: Final = 500_000_000
"""Largest uncompressed chunk (bytes); `rosbag record` writes 0.8 MB, and one message more."""

U32: Final = struct.Struct("<I")
U64: Final = struct.Struct("<Q")
TIME: Final = struct.Struct("<II")


class BagFormatError(Exception):
    """A record is not valid; `offset` is its position in the file, or in the chunk."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.message = message
        self.offset = offset


class EndOfFile(BagFormatError):
    """The file ends within a record."""


class Record(NamedTuple):
    """A record of a file: its header, and where its data is."""

    offset: int
    fields: dict[bytes, bytes]
    data_at: int
    data_size: int

    @property
    def op(self) -> int:
        """The kind of record."""
        value = self.fields.get(b"op", b"")
        return value[0] if len(value) == 1 else -1

    def u32(self, name: bytes) -> int:
        """Return a field of 4 bytes. Raises BagFormatError."""
        value = self.fields.get(name, b"")
        if len(value) != 4:
            raise BagFormatError(f"a record has no valid field {name.decode()!r}", self.offset)
        return U32.unpack(value)[0]

    def u64(self, name: bytes) -> int:
        """Return a field of 8 bytes. Raises BagFormatError."""
        value = self.fields.get(name, b"")
        if len(value) != 8:
            raise BagFormatError(f"a record has no valid field {name.decode()!r}", self.offset)
        return U64.unpack(value)[0]

    def time_ns(self, name: bytes) -> int:
        """Return a time (ns). Raises BagFormatError."""
        value = self.fields.get(name, b"")
        if len(value) != 8:
            raise BagFormatError(f"a record has no valid field {name.decode()!r}", self.offset)
        sec, nsec = TIME.unpack(value)
        return sec * 1_000_000_000 + nsec

    def text(self, name: bytes) -> str:
        """Return a field that is text; empty if it is missing."""
        return self.fields.get(name, b"").decode("utf-8", "replace")


def parse_fields(header: bytes, offset: int) -> dict[bytes, bytes]:
    """Return the fields of a header. Raises BagFormatError."""
    fields: dict[bytes, bytes] = {}
    at, end = 0, len(header)
    while at < end:
        if at + 4 > end:
            raise BagFormatError("a header is cut off", offset)
        length = U32.unpack_from(header, at)[0]
        at += 4
        if at + length > end:
            raise BagFormatError("a field of a header is longer than the header", offset)
        name, separator, value = header[at : at + length].partition(b"=")
        if not separator:
            raise BagFormatError("a field of a header has no name", offset)
        fields[name] = value
        at += length
    return fields


def read_record(file: BinaryIO, size: int) -> Record:
    """Read the header of the record at the file's position; the position is then that of its data.

    `size` is that of the file. Raises EndOfFile, BagFormatError.
    """
    offset = file.tell()
    length = _length(file, offset)
    if length > MAX_HEADER:
        raise BagFormatError(f"the header of a record has a length of {size_text(length)}", offset)
    header = file.read(length)
    if len(header) < length:
        raise EndOfFile("the file ends within a header", offset)
    data_size = _length(file, offset)
    data_at = file.tell()
    fields = parse_fields(header, offset)
    if data_at + data_size > size:
        raise EndOfFile("the file ends within a record", offset)
    return Record(offset, fields, data_at, data_size)


def _length(file: BinaryIO, offset: int) -> int:
    data = file.read(4)
    if len(data) < 4:
        raise EndOfFile("the file ends within a record", offset)
    return U32.unpack(data)[0]


def decompress(data: bytes, compression: str, size: int, offset: int) -> bytes:
    """Return the content of a chunk, `size` bytes long. Raises BagFormatError, InputError without the library for LZ4."""
    if size > MAX_CHUNK:
        raise BagFormatError(f"a chunk has {size_text(size)}, more than {size_text(MAX_CHUNK)}", offset)
    try:
        if compression == "none":
            content = data
        elif compression == "bz2":
            content = bz2.BZ2Decompressor().decompress(data, max_length=size + 1)
        elif compression == "lz4":
            content = (
                require("lz4.frame", "a bag with LZ4 compression").LZ4FrameDecompressor().decompress(data, size + 1)
            )
        else:
            raise BagFormatError(f"a chunk has the unknown compression {compression[:20]!r}", offset)
    except (OSError, RuntimeError, ValueError, EOFError) as exc:
        raise BagFormatError(f"a chunk cannot be decompressed: {exc}", offset) from exc
    if len(content) != size:
        raise BagFormatError(f"a chunk has {len(content)} bytes instead of {size}", offset)
    return content


# --- where the chunks and the connections are: from the index, or, without one, from the chunks themselves ------------


MAGIC: Final = b"#ROSBAG V2.0\n"
MAX_CONNECTIONS: Final = 100_000
MAX_DEFINITION: Final = 1_000_000
"""Largest definition of a type (bytes)."""


@dataclass(slots=True)
class ChunkEntry:
    """A chunk: where it is, the times of its messages (ns), and how many there are by connection."""

    offset: int
    start_ns: int = 0
    end_ns: int = 0
    counts: dict[int, int] = field(default_factory=dict[int, int])
    size: int = -1
    """Bytes of a chunk that is cut off; -1 if it is complete."""
    limit: int = -1
    """Where the next chunk of the index begins; -1 without an index. Two entries for the same bytes would multiply them."""


@dataclass(slots=True)
class BagLayout:
    """The connections by number and the chunks of a bag, and what is damaged."""

    connections: dict[int, Channel]
    chunks: list[ChunkEntry]
    problem: BagFormatError | None = None


def read_layout(file: BinaryIO) -> BagLayout:
    """Read the index of a bag; if it is missing or damaged, all chunks are visited. Raises BagFormatError."""
    size = os.fstat(file.fileno()).st_size
    file.seek(0)
    magic = file.read(len(MAGIC))
    if magic != MAGIC:
        version = magic[9:12].decode("ascii", "replace")
        raise BagFormatError(f"its version is {version!r}, and only 2.0 is supported", 0)
    header = read_record(file, size)
    if header.op != BAG_HEADER:
        raise BagFormatError("the first record is not the bag's header", header.offset)
    if header.text(b"encryptor"):
        raise BagFormatError(f"it is encrypted ({header.text(b'encryptor')[:60]})", header.offset)
    index_at, first = header.u64(b"index_pos"), header.data_at + header.data_size
    reason = BagFormatError("has no index, because its recording was interrupted", header.offset)
    if index_at:
        try:
            return _indexed(file, size, index_at, header.u32(b"conn_count"), header.u32(b"chunk_count"))
        except BagFormatError as exc:
            what = (
                "is truncated"
                if index_at >= size or isinstance(exc, EndOfFile)
                else f"has a damaged index: {exc.message}"
            )
            reason = BagFormatError(what, min(exc.offset, size))
    return _scanned(file, size, first, reason)


def _indexed(file: BinaryIO, size: int, index_at: int, connections: int, chunks: int) -> BagLayout:
    file.seek(min(index_at, size))
    layout = BagLayout({}, [])
    for _ in range(min(connections, MAX_CONNECTIONS)):
        record = _expect(file, size, CONNECTION)
        layout.connections[record.u32(b"conn")] = _connection(record, file.read(record.data_size))
    for _ in range(chunks):
        record = _expect(file, size, CHUNK_INFO)
        data = file.read(record.data_size)
        count = record.u32(b"count")
        if record.u32(b"ver") != 1 or len(data) != 8 * count:
            raise BagFormatError("the entry of a chunk is not valid", record.offset)
        numbers = [U32.unpack_from(data, 4 * i)[0] for i in range(2 * count)]
        counts = dict(zip(numbers[::2], numbers[1::2], strict=True))
        if not counts.keys() <= layout.connections.keys():
            raise BagFormatError("the entry of a chunk names an unknown connection", record.offset)
        at = record.u64(b"chunk_pos")
        if at >= index_at:
            raise BagFormatError("the entry of a chunk points beyond the chunks", record.offset)
        layout.chunks.append(ChunkEntry(at, record.time_ns(b"start_time"), record.time_ns(b"end_time"), counts))
    in_order = sorted(layout.chunks, key=lambda chunk: chunk.offset)
    for chunk, limit in zip(in_order, [*(after.offset for after in in_order[1:]), index_at], strict=True):
        if chunk.offset == limit:
            raise BagFormatError("two entries of it are for the same chunk", chunk.offset)
        chunk.limit = limit
    return layout


def _expect(file: BinaryIO, size: int, op: int) -> Record:
    record = read_record(file, size)
    if record.op != op:
        raise BagFormatError(f"a record of kind {record.op} instead of {op}", record.offset)
    return record


def _connection(record: Record, data: bytes) -> Channel:
    """Return the channel of a connection record."""
    fields = parse_fields(data, record.offset)
    kind = fields.get(b"type", b"").decode("utf-8", "replace")
    package, _, name = kind.partition("/")
    definition = fields.get(b"message_definition", b"")
    if not package or not name or len(definition) > MAX_DEFINITION:
        raise BagFormatError("a connection has no valid type", record.offset)
    return Channel(
        topic_name(record.text(b"topic")),
        f"{package}/msg/{name.removeprefix('msg/')}",
        definition=definition.decode("utf-8", "replace"),
        latched=fields.get(b"latching") == b"1",
    )


# --- without an index -------------------------------------------------------------------------------------------------


def _scanned(file: BinaryIO, size: int, first: int, reason: BagFormatError) -> BagLayout:
    """Visit all records from offset `first`. The end of the readable part is the offset of the problem."""
    layout = BagLayout({}, [], reason)
    file.seek(first)
    at, reached = first, first
    while at < size:
        try:
            record = read_record(file, size)
            if record.op == CHUNK:
                entry = _scan_chunk(file, record, layout)
                if entry is not None:
                    layout.chunks.append(entry)
            elif record.op not in (INDEX, CONNECTION, CHUNK_INFO):
                raise BagFormatError("a record of unknown kind", record.offset)
            at = reached = record.data_at + record.data_size
            file.seek(at)
        except EndOfFile:
            entry = _cut_off(file, at, size, layout)
            if entry is not None:
                layout.chunks.append(entry)
            break
        except BagFormatError:
            break
    layout.problem = BagFormatError(reason.message, reached)
    return layout


def _scan_chunk(file: BinaryIO, record: Record, layout: BagLayout) -> ChunkEntry | None:
    """Return the entry of a chunk, and add its connections to the layout. Raises BagFormatError."""
    content = decompress(file.read(record.data_size), record.text(b"compression"), record.u32(b"size"), record.offset)
    return _chunk_entry(content, record.offset, layout)


def _cut_off(file: BinaryIO, offset: int, size: int, layout: BagLayout) -> ChunkEntry | None:
    """Return the entry of the last chunk if it is not compressed: the messages before the end of the file can be read."""
    file.seek(offset)
    try:
        header = file.read(U32.unpack(file.read(4))[0])
        fields = parse_fields(header, offset)
        if fields.get(b"op") != bytes([CHUNK]) or fields.get(b"compression") != b"none":
            return None
        at = offset + 4 + len(header) + 4
        if size - at > MAX_CHUNK or size <= at:
            return None
        file.seek(at)
        entry = _chunk_entry(file.read(size - at), offset, layout)
    except (BagFormatError, struct.error):
        return None
    if entry is not None:
        entry.size = size - at
    return entry


def _chunk_entry(content: bytes, offset: int, layout: BagLayout) -> ChunkEntry | None:
    """Return the entry of a chunk with this content; None without messages."""
    entry = ChunkEntry(offset)
    times: list[int] = []
    for _, number, time_ns, _ in parse_chunk(content, layout, add_connections=True):
        entry.counts[number] = entry.counts.get(number, 0) + 1
        times.append(time_ns)
    if not times:
        return None
    entry.start_ns, entry.end_ns = min(times), max(times)
    return entry


# --- messages ---------------------------------------------------------------------------------------------------------


def chunk_messages(file: BinaryIO, chunk: ChunkEntry, layout: BagLayout) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield position, connection, time (ns) and data of each message. Raises BagFormatError."""
    size = os.fstat(file.fileno()).st_size
    file.seek(chunk.offset)
    if chunk.size >= 0:
        header = file.read(U32.unpack(file.read(4))[0])
        file.seek(chunk.offset + 4 + len(header) + 4)
        yield from parse_chunk(file.read(chunk.size), layout)
        return
    record = read_record(file, size)
    if record.op != CHUNK:
        raise BagFormatError("the index points to a record that is not a chunk", record.offset)
    if 0 <= chunk.limit < record.data_at + record.data_size:
        raise BagFormatError("the index points into a chunk", chunk.limit)
    content = decompress(file.read(record.data_size), record.text(b"compression"), record.u32(b"size"), record.offset)
    found = 0
    for message in parse_chunk(content, layout):
        found += 1
        yield message
    if found != sum(chunk.counts.values()):
        raise BagFormatError(f"a chunk has {found} messages instead of {sum(chunk.counts.values())}", record.offset)


def parse_chunk(
    content: bytes, layout: BagLayout, *, add_connections: bool = False
) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield position, connection, time (ns) and data of each message of a chunk; ends at a message that is cut off."""
    unpack, time_of = U32.unpack_from, TIME.unpack
    at, end = 0, len(content)
    while at + 4 <= end:
        start = at
        length = unpack(content, at)[0]
        header_end = at + 4 + length
        if header_end + 4 > end:
            return
        fields = parse_fields(content[at + 4 : header_end], start)
        data_size = unpack(content, header_end)[0]
        at = header_end + 4 + data_size
        if at > end:
            return
        op = fields.get(b"op")
        if op == b"\x02":
            connection, time = fields.get(b"conn", b""), fields.get(b"time", b"")
            if len(connection) != 4 or len(time) != 8:
                raise BagFormatError("a message has no valid header", start)
            number = unpack(connection)[0]
            if number not in layout.connections:
                raise BagFormatError("a message of an unknown connection", start)
            sec, nsec = time_of(time)
            yield start, number, sec * 1_000_000_000 + nsec, content[header_end + 4 : at]
        elif op == b"\x07" and add_connections:
            record = Record(start, fields, header_end + 4, data_size)
            if len(layout.connections) < MAX_CONNECTIONS:
                layout.connections.setdefault(record.u32(b"conn"), _connection(record, content[header_end + 4 : at]))


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
