"""Bounded reading of files that others wrote: regular files only, up to a size; values in messages are shortened.

Every reader of navstack opens its input here. A pipe, a device or a socket has no end; a file may be larger than memory, or
expand beyond it. The errors are OSErrors with a `strerror`, which the readers turn into their own errors.
"""

from __future__ import annotations

import errno
import io
import os
import reprlib
import stat
from pathlib import Path
from typing import Any, Final

_KINDS: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a character device"),
    (stat.S_ISBLK, "a block device"),
    (stat.S_ISSOCK, "a socket"),
)
_MAX_READ: Final = 8_000_000
"""Largest single read of a CappedFile."""


class NotRegularFileError(OSError):
    """The path is a pipe, a device or a socket."""


class TooLargeError(OSError):
    """The file is larger than its reader allows."""


def open_regular(path: Path) -> io.BufferedReader:
    """Open a regular file for reading, without waiting for a writer of a pipe.

    Raises NotRegularFileError for a pipe, device or socket, and the OSErrors of `open` (IsADirectoryError for a folder).
    """
    # without O_NONBLOCK, opening a pipe without a writer never returns
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        number = os.open(path, flags)
    except OSError as exc:
        # a socket, or a device without driver
        if exc.errno in (errno.ENXIO, errno.ENODEV, errno.EOPNOTSUPP):
            raise NotRegularFileError(exc.errno, "is not a regular file", str(path)) from None
        raise
    try:
        mode = os.fstat(number).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "a special file")
            raise NotRegularFileError(errno.EINVAL, f"is not a regular file but {kind}", str(path))
    except BaseException:
        os.close(number)
        raise
    return io.BufferedReader(io.FileIO(number, "rb"))


def read_bytes(path: Path, limit: int) -> bytes:
    """Return the content of a regular file of at most `limit` bytes.

    Raises TooLargeError, NotRegularFileError, and the OSErrors of `open`.
    """
    with open_regular(path) as stream:
        # one byte over the limit detects a file that is too large without reading it all; files that lie about their size
        # (in /proc) are read as well
        data = stream.read(limit + 1)
    if len(data) > limit:
        raise TooLargeError(errno.EFBIG, f"is larger than {size_text(limit)}", str(path))
    return data


def size_text(size: int) -> str:
    """Return a number of bytes for messages: `100 kB`, `1 MB`."""
    return f"{size // 1_000_000} MB" if size >= 1_000_000 else f"{size // 1000} kB" if size >= 1000 else f"{size} bytes"


class CappedFile(io.BufferedReader):
    """A regular file, open for reading (`open_regular`), that refuses single reads of more than 8 MB.

    For parsers (zipfile) that read as many bytes as a length in the file says.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(open_regular(path).detach())

    def read(self, size: int | None = -1, /) -> bytes:
        """Read up to `size` bytes, by default the rest. Raises ValueError if that is more than 8 MB."""
        wanted = _MAX_READ + 1 if size is None or size < 0 else size
        data = super().read(min(wanted, _MAX_READ + 1))
        if len(data) > _MAX_READ:
            raise ValueError(f"a part of the file has a length of more than {size_text(_MAX_READ)}")
        return data


class _ShortRepr(reprlib.Repr):
    """Representations of at most about 100 characters for any value."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 2
        self.maxdict = self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxdeque = 4
        self.maxstring = self.maxother = 60
        self.maxlong = 40


_SHORT = _ShortRepr()
_LONGEST: Final = 100


def short_repr(value: Any) -> str:
    """Return `repr(value)` for a message, shortened with `...`; nested values are not expanded beyond two levels."""
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 4096:
        return "an integer of more than 1000 digits"  # its conversion to text takes quadratic time, or is refused
    return shortened(_SHORT.repr(value), _LONGEST)


def shortened(text: str, longest: int) -> str:
    """Return a text of at most `longest` characters; a longer one ends with `...`."""
    return text if len(text) <= longest else f"{text[: longest - 3]}..."
