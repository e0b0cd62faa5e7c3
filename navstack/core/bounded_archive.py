"""Bounded reading of npz archives that others wrote: their size is known before it is read, arrays hold no objects.

Errors of the content are ValueErrors, KeyErrors and those of zipfile and zlib, which the readers turn into their own errors.
"""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core.bounded_reading import CappedFile, size_text

_PIECE: Final = 1_000_000
_MAX_HEADER: Final = 20_000
_VERSIONS: Final = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def expanded_size(archive: zipfile.ZipFile) -> int:
    """Return the sum of the sizes of all members (bytes). Raises ValueError for a compression that numpy does not use."""
    for info in archive.infolist():
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{info.filename} is compressed in a way that navstack does not use")
    return sum(info.file_size for info in archive.infolist())


def read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytearray:
    """Read a whole member, piece by piece: a member never expands beyond its stated size. Verifies its checksum."""
    content = bytearray(info.file_size)
    view, at = memoryview(content), 0
    with archive.open(info) as stream:
        while at < len(content):
            piece = stream.read(min(_PIECE, len(content) - at))
            if not piece:
                raise ValueError(f"{info.filename} is shorter than stated")
            view[at : at + len(piece)] = piece
            at += len(piece)
        if stream.read(1):
            raise ValueError(f"{info.filename} is longer than stated")
    return content


def read_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """Read an array whose header agrees with the size of its member. Raises ValueError."""
    content = read_member(archive, info)
    header = io.BytesIO(content[:_MAX_HEADER])
    version = np.lib.format.read_magic(header)
    if version not in _VERSIONS:
        raise ValueError(f"{info.filename} is not an array of version 1 or 2")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shape, fortran, dtype = _VERSIONS[version](header)
    first = header.tell()
    if dtype.hasobject:
        raise ValueError(f"{info.filename} contains Python objects")
    stated = math.prod(shape) * dtype.itemsize
    if stated != len(content) - first:
        raise ValueError(f"{info.filename} has {len(content) - first} bytes instead of {stated}")
    return np.frombuffer(content, dtype, math.prod(shape), first).reshape(shape, order="F" if fortran else "C")


def read_arrays(path: Path, names: Iterable[str], limit: int) -> Mapping[str, NDArray[Any]]:
    """Return the named arrays of an npz file that expands to at most `limit` bytes.

    Raises OSErrors, ValueErrors, KeyError for an absent array, and the errors of zipfile and zlib.
    """
    with CappedFile(path) as file, zipfile.ZipFile(file) as archive:
        total = expanded_size(archive)
        if total > limit:
            raise ValueError(f"it expands to {size_text(total)}, more than {size_text(limit)}")
        return {name: read_array(archive, archive.getinfo(f"{name}.npy")) for name in names}
