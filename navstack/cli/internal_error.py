"""The last resort: an exception that no command expects becomes one message; its traceback goes to a file."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import shlex
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Final

EXIT_INTERNAL: Final = 70
"""EX_SOFTWARE of sysexits.h."""
_show = False


def show_traceback(shown: bool) -> None:
    """Sets whether tracebacks are printed instead of written to a file (`--debug`, NAVSTACK_DEBUG=1)."""
    global _show
    _show = shown


def report(exc: Exception, arguments: Sequence[str]) -> int:
    """Reports a defect of navstack to the user; returns the exit code."""
    text = "".join(traceback.format_exception(exc))
    command = shlex.join(["navstack", *arguments])
    where = f"{type(exc).__name__}: {_first_line(exc)}"
    if _show:
        _print(text)
        details = "the traceback is above"
    else:
        file = _write(f"{command}\n{_versions()}\n\n{text}")
        details = f"the traceback is in {file}" if file is not None else "--debug prints the traceback"
    message = (
        f"internal error: {where}. This is a defect of navstack, not of your input; {details}. Please report it to the "
        "maintainers of navstack with this file and, if possible, the input files"
    )
    if "--json" in arguments:
        error = {"code": 9099, "name": "INTERNAL", "message": message, "exception": where}
        with contextlib.suppress(OSError, ValueError):
            print(json.dumps({"error": error}), flush=True)
    else:
        _print(f"error: {message}")
    return EXIT_INTERNAL


def _first_line(exc: Exception) -> str:
    try:
        text = " ".join(str(exc).split())
    except Exception:  # an exception whose text cannot be made
        return "(no text)"
    return text if len(text) <= 200 else f"{text[:197]}..."


def _versions() -> str:
    from navstack import __version__

    return f"navstack {__version__}, Python {platform.python_version()}, {platform.platform()}"


def _write(text: str) -> Path | None:
    """Writes the report to a new file of the system's folder for temporary files; None if that is impossible."""
    try:
        number, name = tempfile.mkstemp(prefix="navstack_error_", suffix=".txt")
        with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return None
    return Path(name)


def _print(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)
