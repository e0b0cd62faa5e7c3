"""Bounded reading of text logs line by line, plain or compressed with gzip."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, cast

from navstack.core.bounded_reading import open_regular, size_text
from navstack.core.errors import LogError

MAX_LINE: Final = 1_000_000
"""Longest line (bytes): a scan of 100,000 ranges."""

MAX_BYTES: Final = 20_000_000_000
"""Largest expanded log (bytes)."""

_GZIP: Final = b"\x1f\x8b"


def read_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and text of each line. Raises LogError for a file that cannot be read, is damaged, or is no text."""
    number = 0
    try:
        with open_regular(path) as file:
            packed = file.peek(2)[:2] == _GZIP
            stream = cast("BinaryIO", gzip.GzipFile(fileobj=file)) if packed else file
            size = 0
            while line := stream.readline(MAX_LINE + 1):
                number += 1
                size += len(line)
                if len(line) > MAX_LINE:
                    raise LogError(
                        f"{path}:{number}: the line is longer than {size_text(MAX_LINE)}, so the file is no log",
                        file=str(path),
                        line=number,
                    )
                if size > MAX_BYTES:
                    raise LogError(f"{path}:{number}: the log is larger than {MAX_BYTES // 10**9} GB", line=number)
                yield number, _text(line, path, number)
    except OSError as exc:
        why = "the compressed file is damaged" if isinstance(exc, gzip.BadGzipFile) else exc.strerror or str(exc)
        raise LogError(f"cannot read {path}: {why}", file=str(path)) from exc
    except (EOFError, zlib.error) as exc:
        raise LogError(
            f"{path}:{number + 1}: the compressed file is damaged or incomplete after {number} lines; copy it again",
            file=str(path),
            line=number + 1,
        ) from exc


def _text(line: bytes, path: Path, number: int) -> str:
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError:
        text = line.decode("latin-1")
    if "\0" in text:
        raise LogError(f"{path}:{number}: the file is binary, not a text log", file=str(path), line=number)
    return text
