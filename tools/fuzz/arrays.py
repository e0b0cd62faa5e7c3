"""Mutations of npz files: members, headers of arrays, the archive's own tables, content that expands."""

from __future__ import annotations

import io
import json
import random
import struct
import zipfile
import zlib
from collections.abc import Mapping
from functools import cache
from typing import Any, Final

import numpy as np

from tools.fuzz.text import mutated_bytes, mutated_text
from tools.fuzz.values import mutated_tree

_DTYPES: Final = (
    *(
        "<f8",
        "<f4",
        ">f8",
        "|i1",
        "<i8",
        "|u1",
        "|b1",
        "|O",
        "<U4",
        "<U1000000",
        "|S0",
        "|V0",
        "|V8",
        "<M8[ns]",
        "<c16",
    ),
    *(
        [("a", "<f8"), ("b", "|O")],
        [("a", "<f8")],
        "x",
        "<f16",
        "|S2147483647",
        ("<f8", (3,)),
        "<f8,<f8",
        1,
        None,
        "<f2",
    ),
)
_SHAPES: Final[tuple[Any, ...]] = (
    *(
        (),
        (0,),
        (1,),
        (3,),
        (5, 3),
        (0, 3),
        (10**12,),
        (2**62, 8),
        (-1,),
        (10**9,) * 3,
        (2**63,),
        (1,) * 33,
        (3, 0, 10**15),
    ),
    *((True,), (1.5,), ("a",), 5, None, [2, 3], (10**400,), (4, 4), (1000, 1000), (0, 10**18), (2**31, 2**31, 0)),
)


def packed(members: Mapping[str, bytes]) -> bytes:
    """Return an archive with these members, not compressed."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def array_bytes(
    shape: Any, descr: Any, content: bytes, *, fortran: Any = False, version: tuple[int, int] = (1, 0)
) -> bytes:
    """Return an npy file whose header states anything."""
    header = repr({"descr": descr, "fortran_order": fortran, "shape": shape}).encode("latin-1", "replace") + b"\n"
    length = struct.pack("<H" if version[0] == 1 else "<I", len(header) & (0xFFFF if version[0] == 1 else 0xFFFFFFFF))
    return b"\x93NUMPY" + bytes(version) + length + header + content


def mutated_archive(members: Mapping[str, bytes], rng: random.Random) -> bytes:
    """Change members of an npz file and pack it again, or change the archive's tables or bytes."""
    changed = dict(members)
    for _ in range(rng.choice((1, 1, 2, 3))):
        name = rng.choice(list(changed))
        if "meta.json" in changed and rng.random() < 0.4:
            changed["meta.json"] = _document(members["meta.json"], rng)
        elif name.endswith(".jsonl"):
            changed[name] = _events(changed[name], rng)
        elif name.endswith(".npy"):
            changed[name] = _array(changed[name], changed, rng)
        else:
            changed[name] = mutated_bytes(changed[name], rng)
    if rng.random() < 0.1:
        del changed[rng.choice(list(changed))]
    if rng.random() < 0.05:
        added = rng.choice(
            ("../x.npy", "/etc/x.npy", "x" * 3000 + ".npy", "poses.npy/", "sub/poses.npy", "\U0001f916.npy")
        )
        changed[added] = rng.choice(list(members.values()))
    chance = rng.random()
    if chance < 0.001:
        return _bomb(changed, rng)
    data = packed(changed)
    if chance < 0.1:
        return mutated_bytes(data, rng)
    return _forged_tables(data, rng) if chance < 0.2 else data


def _document(data: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.15:
        return mutated_text(data, rng)
    tree: Any = json.loads(data)
    for _ in range(rng.choice((1, 1, 2, 5))):
        tree = mutated_tree(tree, rng)
    try:
        return json.dumps(tree).encode()
    except (RecursionError, ValueError):
        return b"[" * 100_000


def _events(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines()
    if not lines or rng.random() < 0.2:
        return mutated_text(data, rng)
    i = rng.randrange(len(lines))
    if rng.random() < 0.2:
        lines[i:i] = [rng.choice(lines)] * rng.choice((1, 3, 5000))
    else:
        try:
            lines[i] = json.dumps(mutated_tree(json.loads(lines[i]), rng)).encode()
        except ValueError:  # an earlier change has broken the line
            lines[i] = mutated_bytes(lines[i], rng)
    return b"\n".join(lines)


def _array(data: bytes, others: Mapping[str, bytes], rng: random.Random) -> bytes:
    """Forge the header, the values or the length of an array, or take another member's content."""
    try:
        array = np.lib.format.read_array(io.BytesIO(data))
    except Exception:  # a member that an earlier change has broken
        return mutated_bytes(data, rng)
    match rng.randrange(9):
        case 0:
            return mutated_text(data[:128], rng) + data[128:]
        case 1:
            return rng.choice(list(others.values()))
        case 2:
            return array_bytes(rng.choice(_SHAPES), array.dtype.str, array.tobytes())
        case 3:
            return array_bytes(array.shape, rng.choice(_DTYPES), array.tobytes())
        case 4:
            version = rng.choice(((1, 0), (2, 0), (3, 0), (9, 9), (0, 0)))
            fortran = rng.choice((True, False, 1, "x", None))
            return array_bytes(array.shape, array.dtype.str, array.tobytes(), fortran=fortran, version=version)
        case 5:
            shape, descr = rng.choice(_SHAPES), rng.choice(_DTYPES)
            return array_bytes(shape, descr, bytes(rng.choice((0, 8, 64, 4096))))
        case 6 if array.size:
            return _saved(_values(array, rng))
        case 7 if array.ndim:
            longer = rng.random() < 0.5
            return _saved(
                np.concatenate([array] * rng.choice((2, 3, 200))) if longer else array[: rng.choice((0, 1, 2))]
            )
        case _:
            return mutated_bytes(data, rng)


def _values(array: np.ndarray[Any, Any], rng: random.Random) -> np.ndarray[Any, Any]:
    changed = array.copy()
    flat = changed.reshape(-1)
    at = slice(None) if rng.random() < 0.3 else rng.randrange(flat.size)
    with np.errstate(all="ignore"):
        if changed.dtype.kind == "f":
            flat[at] = rng.choice((np.nan, np.inf, -np.inf, 1e308, -1e30, 1e-320, 1e9, -1.0))
        elif changed.dtype.kind in "iu":
            info = np.iinfo(changed.dtype)
            flat[at] = rng.choice((info.min, info.max, 0, 1, info.max // 2))
        else:
            raw = bytearray(changed.tobytes())
            raw[rng.randrange(len(raw))] = rng.randrange(256)
            changed = np.frombuffer(bytes(raw), changed.dtype).reshape(changed.shape)
    return changed


def _saved(array: np.ndarray[Any, Any]) -> bytes:
    out = io.BytesIO()
    np.lib.format.write_array(out, np.ascontiguousarray(array), allow_pickle=False)
    return out.getvalue()


def _forged_tables(data: bytes, rng: random.Random) -> bytes:
    """Overwrite a field of the archive's directory or of a member's header: sizes, offsets, method, flags, name length."""
    signature, fields = rng.choice(
        (
            (b"PK\x01\x02", ((8, 2), (10, 2), (16, 4), (20, 4), (24, 4), (28, 2), (30, 2), (32, 2), (42, 4))),
            (b"PK\x03\x04", ((6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2))),
            (b"PK\x05\x06", ((4, 2), (8, 2), (10, 2), (12, 4), (16, 4), (20, 2))),
        )
    )
    places = [i for i in range(len(data) - 4) if data[i : i + 4] == signature] if len(data) < 20_000 else []
    if not places:
        at = data.rfind(signature)
        places = [at] if at >= 0 else []
    if not places:
        return mutated_bytes(data, rng)
    offset, size = rng.choice(fields)
    at = rng.choice(places) + offset
    value = rng.choice(
        (0, 1, 8, 12, 99, 0x7FFFFFFF, 0xFFFFFFFF, 0xFFFFFFFE, 600_000_000, 599_000_000, rng.randrange(2**32))
    )
    return data[:at] + (value % 2 ** (8 * size)).to_bytes(size, "little") + data[at + size :]


@cache
def _zeros(megabytes: int) -> tuple[bytes, int]:
    """Deflated zeros and their checksum."""
    compressor = zlib.compressobj(1, zlib.DEFLATED, -15)
    piece, checksum, out = bytes(1_000_000), 0, bytearray()
    for _ in range(megabytes):
        out += compressor.compress(piece)
        checksum = zlib.crc32(piece, checksum)
    return bytes(out + compressor.flush()), checksum


def _bomb(members: Mapping[str, bytes], rng: random.Random) -> bytes:
    """An archive of which one member expands to 30 MB .. 2 GB of zeros; its size may be stated wrongly."""
    megabytes = rng.choice((30, 31, 250, 590, 2000))
    content, checksum = _zeros(megabytes)
    name = rng.choice([*members, "x.npy", "map.npy"])
    others = packed({k: v for k, v in members.items() if k != name})
    end = others.rfind(b"PK\x05\x06")
    count, size, start = struct.unpack("<HII", others[end + 10 : end + 20])
    stated = rng.choice((megabytes * 1_000_000, megabytes * 1_000_000, 100, 0xFFFFFFFF)) & 0xFFFFFFFF
    encoded = name.encode()
    fields = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 33, checksum, len(content), stated, len(encoded), 0)
    local = b"PK\x03\x04" + fields + encoded + content
    central = b"PK\x01\x02\x14\x03" + fields + struct.pack("<HHHII", 0, 0, 0, 0, start) + encoded
    directory = others[start : start + size] + central
    tail = struct.pack("<HHHHIIH", 0, 0, count + 1, count + 1, len(directory), start + len(local), 0)
    return others[:start] + local + directory + b"PK\x05\x06" + tail
