"""Rows of a record while it is made: in memory, or in files on disk that are removed when the process ends.

A row is converted to its final form only when the record is read or written, so a row costs its bytes and no objects.
"""

from __future__ import annotations

import struct
import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import OutputError

BLOCK_BYTES: Final = 1 << 18
"""A column on disk is written in blocks of about this size."""
BLOCK_ROWS: Final = 4096
"""Rows of a table that are converted at once."""
_STRUCT: Final = {"<f8": "d", "<i4": "i", "<i8": "q", "<U": "i"}


class Streamed(NamedTuple):
    """An array that is never in memory as a whole."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    column_major: bool
    pieces: Callable[[], Iterator[Any]]
    """Its bytes, in the order of the file; to be used before anything is added."""
    array: Callable[[], NDArray[Any]]
    """The array after all; of a column on disk, the part that is used."""


class Column:
    """Values of one type, or rows of `width` of them, in the order in which they were added."""

    def __init__(self, dtype: Any, width: int | None = None, folder: Path | None = None) -> None:
        """`folder`: where the file is; None keeps the values in memory. Raises OutputError if it is not writable."""
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self._width = width
        self._row_bytes = self.dtype.itemsize * (1 if width is None else width)
        self._buffer = bytearray()
        self._folder = folder
        self._file: IO[bytes] | None = None
        self._written = 0

    def __len__(self) -> int:
        return (self._written + len(self._buffer)) // self._row_bytes if self._row_bytes else 0

    @property
    def shape(self) -> tuple[int, ...]:
        """(n,) or (n, width)."""
        return (len(self),) if self._width is None else (len(self), self._width)

    def extend(self, values: NDArray[Any]) -> None:
        """Adds values (n,) or rows (n, width). Raises OutputError."""
        self.extend_bytes(np.ascontiguousarray(values, self.dtype).tobytes())

    def extend_bytes(self, content: bytes) -> None:
        """Adds the bytes of whole rows. Raises OutputError."""
        self._buffer += content
        if self._folder is not None and len(self._buffer) >= BLOCK_BYTES:
            self._flush()

    def array(self) -> NDArray[Any]:
        """Returns the rows so far: a copy, or the file itself, of which only what is used is read."""
        if self._file is None or not len(self):
            return np.frombuffer(bytes(self._buffer), self.dtype).reshape(self.shape).copy()
        self._flush()
        return np.memmap(self._file, self.dtype, "r", shape=self.shape)

    def pieces(self) -> Iterator[Any]:
        """Yields the bytes of the rows so far."""
        if self._file is None:
            yield bytes(self._buffer)
            return
        self._flush()
        at, end = 0, self._written
        while at < end:
            self._file.seek(at)
            piece = self._file.read(min(BLOCK_BYTES, end - at))
            if not piece:
                raise OSError("the temporary file of the record is shorter than it was")
            at += len(piece)
            yield piece

    def streamed(self) -> Streamed:
        """Returns the rows so far as an array of the file."""
        shape = self.shape
        return Streamed(self.dtype, shape, False, self.pieces, lambda: self.array()[: shape[0]])

    def _flush(self) -> None:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115
                weakref.finalize(self, self._file.close)
            self._file.seek(self._written)
            content = memoryview(self._buffer)
            while content:
                content = content[self._file.write(content) :]
        except OSError as exc:
            raise OutputError(
                f"cannot write the record into {self._folder}: {exc.strerror or exc}; choose another folder with --out, or "
                "leave the record out",
                path=str(self._folder),
            ) from exc
        self._written += len(self._buffer)
        self._buffer = bytearray()


class Texts:
    """Texts that recur, by number."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._names: list[str] = []

    def number(self, text: str) -> int:
        """Returns the number of a text."""
        found = self._numbers.get(text)
        if found is None:
            found = self._numbers[text] = len(self._names)
            self._names.append(text)
        return found

    def array(self) -> NDArray[np.str_]:
        """Returns the texts by number, as wide as the longest, at least one character."""
        return np.array(self._names or [""], f"<U{self.width}")

    @property
    def width(self) -> int:
        """Length of the longest text, at least 1."""
        return max((len(name) for name in self._names), default=0) or 1


class Table:
    """Rows of a table of the format; its texts are kept by number."""

    def __init__(self, columns: list[tuple[str, str]], folder: Path | None = None) -> None:
        """`columns`: names and types as in `navstack.record.format.TABLES`."""
        self._columns = columns
        self.texts: dict[str, Texts] = {name: Texts() for name, kind in columns if kind == "<U"}
        self._pack = struct.Struct("<" + "".join(_STRUCT[kind] for _, kind in columns)).pack
        self.rows = Column([(name, "<i4" if kind == "<U" else kind) for name, kind in columns], None, folder)

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, *values: Any) -> None:
        """Adds a row: a value per column, for a text its number. Raises OutputError."""
        self.rows.extend_bytes(self._pack(*values))

    def streamed(self) -> Streamed:
        """Returns the table in its final form: texts as wide as the longest."""
        dtype = np.dtype([(name, self._final(name, kind)) for name, kind in self._columns])
        count = len(self)
        texts = {name: found.array() for name, found in self.texts.items()}

        def converted(rows: NDArray[Any]) -> NDArray[Any]:
            out = np.zeros(len(rows), dtype)
            for name, _ in self._columns:
                out[name] = texts[name][rows[name]] if name in texts else rows[name]
            return out

        def pieces() -> Iterator[Any]:
            rows = self.rows.array()
            for first in range(0, count, BLOCK_ROWS):
                yield converted(rows[first : min(first + BLOCK_ROWS, count)]).tobytes()

        return Streamed(dtype, (count,), False, pieces, lambda: converted(self.rows.array()[:count]))

    def _final(self, name: str, kind: str) -> str:
        return f"<U{self.texts[name].width}" if kind == "<U" else kind


def side_by_side(columns: list[Column], rows: int) -> Streamed:
    """Returns the column-major array (rows, len(columns)) of columns (rows,) of 32-bit floats."""
    columns = list(columns)
    shape = rows, len(columns)

    def pieces() -> Iterator[Any]:
        for column in columns:
            yield from column.pieces()

    def array() -> NDArray[Any]:
        out = np.empty(shape, "<f4", order="F")
        for i, column in enumerate(columns):
            out[:, i] = column.array()[:rows]
        return out

    # an array of one row or column has both orders, which numpy calls row-major
    return Streamed(np.dtype("<f4"), shape, rows > 1 and len(columns) > 1, pieces, array)


def looked_up(numbers: Column, rows: NDArray[Any]) -> Streamed:
    """Returns the array (n, width) with `rows[numbers]`."""

    def pieces() -> Iterator[Any]:
        all_numbers = numbers.array()
        for first in range(0, len(all_numbers), BLOCK_ROWS):
            yield rows[all_numbers[first : first + BLOCK_ROWS]].tobytes()

    count = len(numbers)
    return Streamed(rows.dtype, (count, rows.shape[1]), False, pieces, lambda: rows[numbers.array()[:count]])


class OnDemand(Mapping[str, NDArray[Any]]):
    """Arrays by name; one that is streamed is made at its first use."""

    def __init__(self, arrays: Mapping[str, NDArray[Any] | Streamed]) -> None:
        self._arrays: dict[str, NDArray[Any] | Streamed] = dict(arrays)

    def __getitem__(self, name: str) -> NDArray[Any]:
        found = self._arrays[name]
        if isinstance(found, Streamed):
            found = self._arrays[name] = found.array()
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)
