"""The records of a ROS 1 bag, version 2.0: <u32 length><header><u32 length><data>; a header is a list of name=value.

Source of the format: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import struct
from typing import BinaryIO, Final, NamedTuple

from navstack.core.bounded_reading import size_text
from navstack.core.optional_dependencies import require

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
