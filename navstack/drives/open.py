"""Opening a log: its format is found from its name and its beginning."""

from __future__ import annotations

import itertools
from pathlib import Path

from navstack.core.errors import LogError
from navstack.core.files import exists, is_dir
from navstack.drives.carmen import CarmenDrive
from navstack.drives.lines import read_lines
from navstack.drives.messages import Drive
from navstack.drives.run_record import RecordDrive

_SEARCHED_LINES = 100_000
_KNOWN = "CARMEN logs (.log, .log.gz), recorded runs (run.npz or the folder of one)"


def open_drive(path: str | Path) -> Drive:
    """Open a log. Raises LogError for a missing file and for a format that is not known."""
    file = Path(path)
    if not exists(file):
        raise LogError(f"{file} does not exist; give the path of a log: {_KNOWN}", file=str(file))
    if is_dir(file) or file.suffix == ".npz":
        return RecordDrive(file)
    for _, text in itertools.islice(read_lines(file), _SEARCHED_LINES):
        if text.startswith(("FLASER ", "ODOM ", "# message formats defined", "# CARMEN")):
            return CarmenDrive(file)
    raise LogError(f"{file} is in no format that navstack reads; it reads {_KNOWN}", file=str(file))
