"""Mutations of the images of maps: headers of png, pgm, tiff and bmp with forged fields, and large valid images."""

from __future__ import annotations

import io
import random
import struct
import zlib
from functools import cache
from typing import Any, Final

import numpy as np
from PIL import Image

from tools.fuzz.text import mutated_bytes

_SIZES: Final = (0, 1, 12, 8, 255, 8900, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1)
_PNG_TYPES: Final = {
    "1": (1, 1, 0),
    "L": (8, 1, 0),
    "LA": (8, 2, 4),
    "RGB": (8, 3, 2),
    "RGBA": (8, 4, 6),
    "I;16": (16, 1, 0),
}
"""Bits per channel, channels, and color type of a png."""
_MODES: Final = ("1", "L", "LA", "P", "RGB", "RGBA", "I;16")


@cache
def small_images() -> tuple[bytes, ...]:
    """Images of 12 x 8 pixels in the formats that maps are stored in."""
    pixels = np.arange(96, dtype=np.uint8).reshape(8, 12)
    images = [_encoded(Image.fromarray(pixels).convert(mode), "PNG") for mode in _MODES[:-1]]
    deep: Image.Image = Image.fromarray(pixels.astype(np.uint16) * 257)
    images += [
        _encoded(deep, "PNG"),
        _encoded(deep, "TIFF"),
        _encoded(Image.fromarray(pixels.astype(np.float32)), "TIFF"),
    ]
    gray: Image.Image = Image.fromarray(pixels)
    images += [_encoded(gray, kind) for kind in ("PPM", "BMP", "GIF", "TIFF", "JPEG", "TGA", "PCX", "WEBP")]
    images += [_encoded(gray, "TIFF", compression=c) for c in ("tiff_lzw", "packbits", "tiff_adobe_deflate")]
    images.append(b"P2\n# comment\n12 8\n255\n" + b" ".join(str(v).encode() for v in pixels.ravel()))
    images.append(b"P1\n12 8\n" + b" ".join(b"01"[v % 2 : v % 2 + 1] for v in pixels.ravel().tolist()))
    images.append(b'/* XPM */\nstatic char *a[] = {\n"2 1 2 1",\n"a c #000000",\n"b c #ffffff",\n"ab"};\n')
    return tuple(images)


def _encoded(image: Image.Image, kind: str, **options: Any) -> bytes:
    out = io.BytesIO()
    image.save(out, kind, **options)
    return out.getvalue()


@cache
def large_image(mode: str, side: int) -> bytes:
    """A valid png of `side` x `side` white pixels, about 1000 times smaller than its pixels."""
    bits, channels, color = _PNG_TYPES[mode]
    row = b"\0" + b"\xff" * ((side * bits * channels + 7) // 8)
    compressor = zlib.compressobj(1)
    data = b"".join(compressor.compress(row) for _ in range(side)) + compressor.flush()
    head = struct.pack(">IIBBBBB", side, side, bits, color, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def chunk(kind: bytes, data: bytes) -> bytes:
    """A png chunk with its checksum."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def mutated_image(rng: random.Random) -> bytes:
    """Return an image with changed bytes or forged header fields; rarely a large valid one."""
    chance = rng.random()
    if chance < 0.002:
        return large_image(rng.choice(list(_PNG_TYPES)), rng.choice((3000, 8900, 8944, 12000)))
    data = rng.choice(small_images())
    if chance < 0.6:
        forged = _forged(data, rng)
        if forged is not None:
            data = forged
            if chance < 0.5:
                return data
    for _ in range(rng.choice((1, 1, 2, 5))):
        data = mutated_bytes(data, rng)
    return data


def _forged(data: bytes, rng: random.Random) -> bytes | None:
    if data.startswith(b"\x89PNG"):
        return _forged_png(data, rng)
    if data[:2] in (b"II", b"MM"):
        return _forged_tiff(data, rng)
    if data[:1] == b"P" and data[1:2].isdigit():
        return _forged_pnm(data, rng)
    if data.startswith(b"BM"):
        offset = rng.choice((2, 10, 14, 18, 22, 26, 28, 30, 34, 46))
        return data[:offset] + struct.pack("<I", rng.choice(_SIZES)) + data[offset + 4 :]
    if data.startswith(b"GIF"):
        offset = rng.choice((6, 8))
        return data[:offset] + struct.pack("<H", rng.choice(_SIZES) & 0xFFFF) + data[offset + 2 :]
    return None


def _forged_png(data: bytes, rng: random.Random) -> bytes:
    """Chunks with valid checksums: other sizes and depths, chunks added, repeated, removed or emptied."""
    chunks: list[tuple[bytes, bytes]] = []
    at = 8
    while at + 8 <= len(data):
        length = struct.unpack(">I", data[at : at + 4])[0]
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    i = rng.randrange(len(chunks))
    match rng.randrange(6):
        case 0 | 1:
            fields = list(struct.unpack(">IIBBBBB", chunks[0][1]))
            j = rng.randrange(7)
            fields[j] = rng.choice(_SIZES) if j < 2 else rng.choice((0, 1, 2, 3, 4, 6, 8, 16, 32, 255))
            chunks[0] = (b"IHDR", struct.pack(">IIBBBBB", *fields))
        case 2:
            kind = rng.choice(
                (b"tEXt", b"zTXt", b"iTXt", b"iCCP", b"PLTE", b"tRNS", b"gAMA", b"acTL", b"fcTL", b"eXIf", b"pHYs")
            )
            packed = rng.choice((b"", b"a\0\0" + zlib.compress(bytes(3_000_000)), b"\xff" * 20, rng.randbytes(12)))
            chunks.insert(i, (kind, packed))
        case 3:
            chunks[i:i] = [chunks[rng.randrange(len(chunks))]] * rng.choice((1, 3, 500))
        case 4:
            del chunks[i]
        case _:
            kind, content = chunks[i]
            chunks[i] = (kind, mutated_bytes(content, rng))
    return data[:8] + b"".join(chunk(*c) for c in chunks)


def _forged_tiff(data: bytes, rng: random.Random) -> bytes:
    """Another value, type, count or tag in an entry of the directory, or a directory that follows itself."""
    order = "<" if data[:2] == b"II" else ">"
    start = struct.unpack(order + "I", data[4:8])[0]
    if start + 2 > len(data):
        return data
    count = struct.unpack(order + "H", data[start : start + 2])[0]
    if rng.random() < 0.1:
        at = start + 2 + 12 * count
        return data[:at] + struct.pack(order + "I", start) + data[at + 4 :]
    entry = start + 2 + 12 * rng.randrange(max(1, count))
    offset, size = rng.choice(((0, 2), (2, 2), (4, 4), (8, 4), (8, 4), (8, 4)))
    value = (
        rng.choice(_SIZES) % 2 ** (8 * size) if rng.random() < 0.7 else rng.choice((1, 2, 3, 4, 5, 7, 8, 32773, 32946))
    )
    packed = struct.pack(order + ("H" if size == 2 else "I"), value)
    return data[: entry + offset] + packed + data[entry + offset + size :]


def _forged_pnm(data: bytes, rng: random.Random) -> bytes:
    kind = rng.choice((b"P1", b"P2", b"P4", b"P5", b"P6", b"P7", b"Pf", b"PF", b"P0", b"P9"))
    numbers = [12, 8, 255]
    numbers[rng.randrange(3)] = rng.choice((*_SIZES, -1, 10**30, 15, 256))
    words = [b"%d" % n for n in numbers]
    if rng.random() < 0.2:
        words[rng.randrange(3)] = rng.choice((b"", b"x", b"1.5", b"0x10", b"# " + b"c" * 500, b"9" * 5000, b"\0"))
    between = rng.choice((b" ", b"\n", b"\n# comment\n", b"\t", b""))
    body = data[-96:] if rng.random() < 0.7 else rng.choice((b"", b"1 2 3", b"-5 " * 96, b"99999 " * 96))
    return kind + b"\n" + between.join(words) + b"\n" + body
