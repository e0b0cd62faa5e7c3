"""One message with the state of the session: a JSON header and binary blobs, compressed together.

Layout: one byte, 0 plain or 1 deflated (zlib); then the payload: the length of the header (u32, little endian), the header as
UTF-8 JSON, and the blobs, one after another. The header's `blobs` lists their lengths; other entries name a blob by its index.
"""

from __future__ import annotations

import json
import struct
import zlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

SMALLEST_DEFLATED: Final = 400
"""Shorter payloads are sent as they are (bytes)."""


class Frame:
    """A message under construction."""

    def __init__(self, header: dict[str, Any]) -> None:
        self.header = header
        self._blobs: list[bytes] = []

    def blob(self, data: NDArray[Any] | bytes) -> int:
        """Adds a blob and returns its index."""
        self._blobs.append(data if isinstance(data, bytes) else np.ascontiguousarray(data).tobytes())
        return len(self._blobs) - 1

    def encode(self) -> bytes:
        """Returns the bytes of the message."""
        self.header["blobs"] = [len(blob) for blob in self._blobs]
        header = json.dumps(self.header, separators=(",", ":"), allow_nan=False).encode()
        payload = b"".join((struct.pack("<I", len(header)), header, *self._blobs))
        if len(payload) < SMALLEST_DEFLATED:
            return b"\0" + payload
        return b"\1" + zlib.compress(payload, 1)


def decode(message: bytes) -> tuple[dict[str, Any], list[bytes]]:
    """Returns header and blobs of a message; for tests and other clients."""
    payload = zlib.decompress(message[1:]) if message[0] else message[1:]
    (length,) = struct.unpack_from("<I", payload)
    header: dict[str, Any] = json.loads(payload[4 : 4 + length])
    blobs: list[bytes] = []
    at = 4 + length
    for size in header["blobs"]:
        blobs.append(payload[at : at + size])
        at += size
    return header, blobs
