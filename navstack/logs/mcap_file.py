"""MCAP files with messages of ROS 1 or ROS 2, read chunk by chunk; the file's summary or, without one, a pass over the file
says where they are.

Source of the format: mcap.dev/spec.
"""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, Final

from navstack.core import LogError, NavError, open_regular, require, shortened, size_text
from navstack.logs.log import Channel, Decoder, Log, damaged, ordered_messages
from navstack.ros_messages import topic_name

SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x03, 0x04, 0x05, 0x06
DATA_END: Final = 0x0F
MAGIC: Final = b"\x89MCAP0\r\n"
MAX_RECORD: Final = 500_000_000
"""Largest record, and largest uncompressed chunk (bytes)."""
LOOSE: Final = 1000
"""Number of messages outside chunks that are read together."""
_HEAD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")


def open_mcap(path: Path) -> Log:
    """Open an MCAP file. Raises LogError, and InputError if the extra is not installed."""
    require("mcap", "reading an MCAP file")
    source = _McapFile(path)
    return Log(path, source, format="MCAP", is_ros1=source.is_ros1)


@dataclass(slots=True)
class _Entry:
    """A chunk, or messages outside chunks (`end` is then their end in the file)."""

    offset: int
    start_ns: int
    end_ns: int
    counts: dict[int, int] = field(default_factory=dict[int, int])
    end: int = -1
    is_cut: bool = False
    """True for a chunk that the end of the file cuts off."""
    limit: int = -1
    """Where the next chunk of the summary begins; -1 for none. Two entries for the same bytes would multiply them."""


class _FormatError(Exception):
    """The file is not valid at `offset`."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.message = message
        self.offset = offset


class _McapFile:
    """An MCAP file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO = open_regular(path)
        self._size = self._file.seek(0, 2)
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._known: dict[int, Any] = {}
        self._entries: list[_Entry] = []
        self._counts: dict[int, int] = {}
        self._problem: _FormatError | None = None
        try:
            if not self._read_summary():
                self._scan()
            self._channel_of = {number: self._channel(number) for number in self._known}
        except BaseException:
            self._file.close()
            raise
        encodings = {str(channel.message_encoding) for channel in self._known.values()}
        self.is_ros1 = encodings == {"ros1"}
        self._decoder = Decoder(ros1=self.is_ros1)
        self._other_encodings = sorted(encodings - {"ros1", "cdr"})

    @property
    def channels(self) -> Sequence[Channel]:
        return tuple(self._channel_of.values())

    @property
    def span_ns(self) -> tuple[int, int] | None:
        if not self._entries:
            return None
        return min(entry.start_ns for entry in self._entries), max(entry.end_ns for entry in self._entries)

    @property
    def problem(self) -> LogError | None:
        problem = self._problem
        if problem is None:
            return None
        return damaged(self._path, problem.message, problem.offset, self.channels, self.span_ns)

    def decode(self, channel: Channel, raw: bytes) -> Any:
        if self._other_encodings:
            raise LogError(
                f"{self._path} has messages in the encoding {', '.join(self._other_encodings)}; only those of ROS (ros1, cdr) "
                "can be decoded",
                path=str(self._path),
            )
        return self._decoder.decode(channel, raw)

    def close(self) -> None:
        self._file.close()

    def raw_messages(
        self, channels: Collection[Channel], start_ns: int | None, end_ns: int | None
    ) -> Iterator[tuple[Channel, int, bytes]]:
        chosen = set(channels)
        wanted = {number: channel for number, channel in self._channel_of.items() if channel in chosen}
        return ordered_messages(self._path, self._entries, self._messages_of, wanted, start_ns, end_ns)

    # --- layout -------------------------------------------------------------------------------------------------------

    def _read_summary(self) -> bool:
        """Read channels and chunks from the summary; return False if it is missing, not valid or incomplete."""
        reader = require("mcap.reader", "reading an MCAP file")
        self._file.seek(0)
        try:
            summary = reader.SeekingReader(self._file, record_size_limit=MAX_RECORD).get_summary()
        except Exception:  # any error of the library on a damaged file: the scan says where
            return False
        if summary is None or (statistics := summary.statistics) is None:
            return False
        if not summary.chunk_indexes or not summary.channels:
            return False
        if any(
            index.chunk_start_offset + 9 > self._size
            or not index.message_index_offsets.keys() <= summary.channels.keys()
            for index in summary.chunk_indexes
        ):
            return False
        self._counts = dict(statistics.channel_message_counts)
        if (
            sum(self._counts.values()) != statistics.message_count
            or len(summary.chunk_indexes) != statistics.chunk_count
        ):
            return False
        self._known = dict(summary.channels)
        for schema in summary.schemas.values():
            self._add_schema(schema)
        every = dict.fromkeys(self._known, 1)
        self._entries = [
            _Entry(
                index.chunk_start_offset,
                index.message_start_time,
                index.message_end_time,
                dict.fromkeys(index.message_index_offsets, 1) or every,
            )
            for index in summary.chunk_indexes
        ]
        in_order = sorted(self._entries, key=lambda entry: entry.offset)
        for entry, after in pairwise(in_order):
            entry.limit = after.offset
            if entry.offset == after.offset:  # the bytes of a chunk would count several times
                self._entries.clear()
                return False
        return True

    def _scan(self) -> None:
        """Visit all records. The end of the readable part is the offset of the problem, unless the file is complete."""
        at, loose = 8, None
        complete = False
        while at + 9 <= self._size:
            self._file.seek(at)
            op, length = _HEAD.unpack(self._file.read(9))
            if op == DATA_END:
                self._file.seek(-len(MAGIC), 2)
                complete = self._file.read() == MAGIC
                break
            if at + 9 + length > self._size or length > MAX_RECORD or op == 0:
                if op == CHUNK:
                    self._add_cut_chunk(at)
                break
            try:
                if op == CHUNK:
                    loose = None
                    self._add_chunk(at, length)
                elif op == MESSAGE:
                    loose = self._add_loose(at, self._file.read(length), loose)
                elif op in (SCHEMA, CHANNEL):
                    self._add_description(op, self._file.read(length), at)
            except _FormatError as exc:
                self._problem = _FormatError(f"is damaged: {exc.message}", exc.offset)
                return
            at += 9 + length
        if not complete:
            self._problem = _FormatError("is truncated", at)

    def _add_chunk(self, at: int, length: int) -> None:
        entry = _Entry(at, 1 << 64, 0)
        content = self._chunk_content(at, length)
        for op, start, end in _records(content, at):
            if op in (SCHEMA, CHANNEL):
                self._add_description(op, content[start:end], at)
            elif op == MESSAGE:
                number, _, time_ns, _ = _message(content, start, end, at)
                self._count(entry, number, time_ns, at)
        if entry.counts:
            self._entries.append(entry)

    def _add_cut_chunk(self, at: int) -> None:
        """Add the messages of a chunk that the end of the file cuts off."""
        entry = _Entry(at, 1 << 64, 0, is_cut=True)
        with contextlib.suppress(_FormatError, struct.error):
            content = self._chunk_content(at, self._size - at - 9, cut=True)
            for op, start, end in _records(content, at):
                if op in (SCHEMA, CHANNEL):
                    self._add_description(op, content[start:end], at)
                elif op == MESSAGE:
                    number, _, time_ns, _ = _message(content, start, end, at)
                    self._count(entry, number, time_ns, at)
        if entry.counts:
            self._entries.append(entry)

    def _add_loose(self, at: int, data: bytes, entry: _Entry | None) -> _Entry:
        number, _, time_ns, _ = _message(data, 0, len(data), at)
        if entry is None or sum(entry.counts.values()) >= LOOSE:
            entry = _Entry(at, 1 << 64, 0)
            self._entries.append(entry)
        self._count(entry, number, time_ns, at)
        entry.end = at + 9 + len(data)
        return entry

    def _count(self, entry: _Entry, number: int, time_ns: int, at: int) -> None:
        if number not in self._known:
            raise _FormatError("a message of an unknown channel", at)
        entry.counts[number] = entry.counts.get(number, 0) + 1
        self._counts[number] = self._counts.get(number, 0) + 1
        entry.start_ns, entry.end_ns = min(entry.start_ns, time_ns), max(entry.end_ns, time_ns)

    def _add_description(self, op: int, data: bytes, at: int) -> None:
        """Add a schema or a channel."""
        records = require("mcap.records", "reading an MCAP file")
        stream = require("mcap.data_stream", "reading an MCAP file").ReadDataStream(io.BytesIO(data))
        try:
            if op == SCHEMA:
                self._add_schema(records.Schema.read(stream))
            else:
                channel = records.Channel.read(stream)
                self._known[channel.id] = channel
        except Exception as exc:  # any error of the library on damaged bytes
            raise _FormatError(f"a schema or channel cannot be read ({shortened(str(exc), 60)})", at) from exc

    def _add_schema(self, schema: Any) -> None:
        self._schemas[schema.id] = schema.name, schema.encoding, bytes(schema.data).decode("utf-8", "replace")

    def _channel(self, number: int) -> Channel:
        channel = self._known[number]
        name, encoding, definition = self._schemas.get(channel.schema_id, ("", "", ""))
        package, _, last = name.rpartition("/")
        package = package.removesuffix("/msg")
        return Channel(
            topic_name(channel.topic),
            f"{package}/msg/{last}" if package else name,
            self._counts.get(number, 0),
            definition if encoding in ("ros1msg", "ros2msg") else "",
            "transient_local" in channel.metadata.get("offered_qos_profiles", ""),
        )

    # --- messages -----------------------------------------------------------------------------------------------------

    def _messages_of(self, entry: _Entry) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield position, channel number, time (ns) and data of each message. Raises LogError."""
        try:
            if entry.end >= 0:
                self._file.seek(entry.offset)
                content = self._file.read(entry.end - entry.offset)
            else:
                self._file.seek(entry.offset)
                op, length = _HEAD.unpack(self._file.read(9))
                if op != CHUNK:
                    raise _FormatError("the index points to a record that is not a chunk", entry.offset)
                if 0 <= entry.limit < entry.offset + 9 + length:
                    raise _FormatError("the index points into a chunk", entry.limit)
                if entry.is_cut:
                    length = self._size - entry.offset - 9
                content = self._chunk_content(entry.offset, length, cut=entry.is_cut)
            for op, start, end in _records(content, entry.offset):
                if op == MESSAGE:
                    number, at, time_ns, data = _message(content, start, end, entry.offset)
                    yield at, number, time_ns, data
        except (_FormatError, struct.error) as exc:
            if entry.is_cut:
                return
            reason = exc.message if isinstance(exc, _FormatError) else "a chunk is cut off"
            raise LogError(
                f"{self._path} is damaged: {reason} (offset {entry.offset:,})",
                path=str(self._path),
                offset=entry.offset,
            ) from exc

    def _chunk_content(self, at: int, length: int, *, cut: bool = False) -> bytes:
        """Return the uncompressed content of the chunk at `at`, or its readable part if it is `cut` off. Raises _FormatError."""
        if length > MAX_RECORD or at + 9 + length > self._size:
            raise _FormatError("a chunk is longer than the file", at)
        self._file.seek(at + 9)
        data = self._file.read(length)
        try:
            size, _, name_length = struct.unpack_from("<QII", data, 16)
            name = data[32 : 32 + name_length]
            (stored,) = struct.unpack_from("<Q", data, 32 + name_length)
        except struct.error as exc:
            raise _FormatError("a chunk is cut off", at) from exc
        body = data[40 + name_length :]
        if (stored != len(body) and not cut) or size > MAX_RECORD:
            raise _FormatError(f"a chunk has a wrong size ({size_text(size)})", at)
        content = _decompress(body, name, size, at)
        if len(content) != size and not cut:
            raise _FormatError(f"a chunk has {len(content)} bytes instead of {size}", at)
        return content


def _decompress(body: bytes, name: bytes, size: int, at: int) -> bytes:
    """Return the content of a chunk; at most one byte more than `size`."""
    if not name:
        return body
    try:
        if name == b"lz4":
            lz4 = require("lz4.frame", "an MCAP file with LZ4 compression")
            return lz4.LZ4FrameDecompressor().decompress(body, size + 1)
        if name == b"zstd":
            zstandard = require("zstandard", "an MCAP file with zstd compression")
            with zstandard.ZstdDecompressor().stream_reader(body) as stream:
                return _read_at_most(stream, size + 1)
    except NavError:
        raise
    except Exception as exc:  # any error of the library on damaged bytes
        raise _FormatError(f"a chunk cannot be decompressed ({shortened(str(exc), 60)})", at) from exc
    raise _FormatError(f"a chunk has the unknown compression {name[:20]!r}", at)


def _read_at_most(stream: Any, size: int) -> bytes:
    """Return up to `size` bytes of a stream; a single read may return less than there is."""
    parts: list[bytes] = []
    while size > 0:
        part = stream.read(size)
        if not part:
            break
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def _records(content: bytes, offset: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, start and end of each record in a chunk."""
    at, size = 0, len(content)
    while at < size:
        if at + 9 > size:
            raise _FormatError("a record is cut off", offset)
        op, length = _HEAD.unpack_from(content, at)
        at += 9
        if at + length > size:
            raise _FormatError("a record is longer than its chunk", offset)
        yield op, at, at + length
        at += length


def _message(content: bytes, start: int, end: int, offset: int) -> tuple[int, int, int, bytes]:
    """Return channel number, position, time (ns) and data of the message in `content[start:end]`."""
    if end - start < _MESSAGE.size:
        raise _FormatError("a message is cut off", offset)
    number, _, time_ns, _ = _MESSAGE.unpack_from(content, start)
    return number, start, time_ns, content[start + _MESSAGE.size : end]
