"""The last recorded run of the user, which `explain`, `plot` and `live` take if no run is named."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from navstack.cli.output import print_note
from navstack.core import InputError, is_dir, write_text

if TYPE_CHECKING:
    from navstack.record import RunRecorder as Recorder


def save_record(recorder: Recorder, folder: Path) -> dict[str, str]:
    """Write the files of a record into `folder` and remember it as the last run. Returns their names. Raises OutputError."""
    files = {what: str(name) for what, name in recorder.save(folder).items()}
    try:
        pointer = _pointer()
        pointer.parent.mkdir(parents=True, exist_ok=True)
        write_text(pointer, f"{folder.resolve()}\n")
    except (OSError, RuntimeError, InputError):  # without a home, or on a full disk: the record is there
        pass
    return files


def last_run() -> Path:
    """Return the folder of the last run, and print it as a note. Raises InputError if there is none."""
    try:
        folder = Path(_pointer().read_text(encoding="utf-8").strip())
    except (OSError, RuntimeError, UnicodeDecodeError):
        raise InputError(
            "no run is named, and none was recorded yet; record one with: navstack simulate", argument="RUN"
        ) from None
    if not is_dir(folder):
        raise InputError(
            f"no run is named, and the last one, {folder}, does not exist any more; name one", argument="RUN"
        )
    print_note(f"the last run: {folder}")
    return folder


def _pointer() -> Path:
    """Return the file with the name of the last run."""
    state = os.environ.get("XDG_STATE_HOME")
    return (Path(state) if state else Path.home() / ".local" / "state") / "navstack" / "last_run"
