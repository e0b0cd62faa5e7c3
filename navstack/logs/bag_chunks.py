"""Where the chunks and the connections of a ROS 1 bag are: from its index, or, without one, from the chunks themselves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, Final

from navstack.logs import bag_records as records
from navstack.logs.bag_records import BagFormatError, EndOfFile, Record, read_record
from navstack.logs.log import Channel, topic_name

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
    if header.op != records.BAG_HEADER:
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
        record = _expect(file, size, records.CONNECTION)
        layout.connections[record.u32(b"conn")] = _connection(record, file.read(record.data_size))
    for _ in range(chunks):
        record = _expect(file, size, records.CHUNK_INFO)
        data = file.read(record.data_size)
        count = record.u32(b"count")
        if record.u32(b"ver") != 1 or len(data) != 8 * count:
            raise BagFormatError("the entry of a chunk is not valid", record.offset)
        numbers = [records.U32.unpack_from(data, 4 * i)[0] for i in range(2 * count)]
        counts = dict(zip(numbers[::2], numbers[1::2], strict=True))
        if not counts.keys() <= layout.connections.keys():
            raise BagFormatError("the entry of a chunk names an unknown connection", record.offset)
        at = record.u64(b"chunk_pos")
        if at >= index_at:
            raise BagFormatError("the entry of a chunk points beyond the chunks", record.offset)
        layout.chunks.append(ChunkEntry(at, record.time_ns(b"start_time"), record.time_ns(b"end_time"), counts))
    return layout


def _expect(file: BinaryIO, size: int, op: int) -> Record:
    record = read_record(file, size)
    if record.op != op:
        raise BagFormatError(f"a record of kind {record.op} instead of {op}", record.offset)
    return record


def _connection(record: Record, data: bytes) -> Channel:
    """Return the channel of a connection record."""
    fields = records.parse_fields(data, record.offset)
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
            if record.op == records.CHUNK:
                entry = _scan_chunk(file, record, layout)
                if entry is not None:
                    layout.chunks.append(entry)
            elif record.op not in (records.INDEX, records.CONNECTION, records.CHUNK_INFO):
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
    content = records.decompress(
        file.read(record.data_size), record.text(b"compression"), record.u32(b"size"), record.offset
    )
    return _entry(content, record.offset, layout)


def _cut_off(file: BinaryIO, offset: int, size: int, layout: BagLayout) -> ChunkEntry | None:
    """Return the entry of the last chunk if it is not compressed: the messages before the end of the file can be read."""
    file.seek(offset)
    try:
        header = file.read(records.U32.unpack(file.read(4))[0])
        fields = records.parse_fields(header, offset)
        if fields.get(b"op") != bytes([records.CHUNK]) or fields.get(b"compression") != b"none":
            return None
        at = offset + 4 + len(header) + 4
        if size - at > records.MAX_CHUNK or size <= at:
            return None
        file.seek(at)
        entry = _entry(file.read(size - at), offset, layout)
    except (BagFormatError, records.struct.error):
        return None
    if entry is not None:
        entry.size = size - at
    return entry


def _entry(content: bytes, offset: int, layout: BagLayout) -> ChunkEntry | None:
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
        header = file.read(records.U32.unpack(file.read(4))[0])
        file.seek(chunk.offset + 4 + len(header) + 4)
        yield from parse_chunk(file.read(chunk.size), layout)
        return
    record = read_record(file, size)
    if record.op != records.CHUNK:
        raise BagFormatError("the index points to a record that is not a chunk", record.offset)
    content = records.decompress(
        file.read(record.data_size), record.text(b"compression"), record.u32(b"size"), record.offset
    )
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
    unpack, time_of = records.U32.unpack_from, records.TIME.unpack
    at, end = 0, len(content)
    while at + 4 <= end:
        start = at
        length = unpack(content, at)[0]
        header_end = at + 4 + length
        if header_end + 4 > end:
            return
        fields = records.parse_fields(content[at + 4 : header_end], start)
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
