"""Opening a log: its format is found from its name and its beginning."""

from __future__ import annotations

import itertools
from pathlib import Path

from navstack.core.bounded_reading import open_regular
from navstack.core.errors import LogError
from navstack.core.files import exists, is_dir
from navstack.drives.carmen import CarmenDrive
from navstack.drives.lines import read_lines
from navstack.drives.messages import Drive, DriveOptions
from navstack.drives.run_record import RecordDrive
from navstack.logs.open_log import BAG_MAGIC, MCAP_MAGIC, SQLITE_MAGIC

_SEARCHED_LINES = 100_000
_KNOWN = "CARMEN logs (.log, .log.gz), bags and MCAP files, recorded runs (run.npz or the folder of one)"


def open_drive(path: str | Path, options: DriveOptions | None = None) -> Drive:
    """Open a log. Raises LogError for a missing file and for a format that is not known."""
    file = Path(path)
    if not exists(file):
        raise LogError(f"{file} does not exist; give the path of a log: {_KNOWN}", file=str(file))
    if is_bag(file):
        from navstack.drives.ros_log import RosDrive

        return RosDrive(file, options)
    if is_dir(file) or file.suffix == ".npz":
        return RecordDrive(file, options)
    for _, text in itertools.islice(read_lines(file), _SEARCHED_LINES):
        if text.startswith(("FLASER ", "ODOM ", "# message formats defined", "# CARMEN")):
            return CarmenDrive(file, options)
    raise LogError(f"{file} is in no format that navstack reads; it reads {_KNOWN}", file=str(file))


def is_bag(path: Path) -> bool:
    """Return whether a file or folder is a bag or an MCAP file, by its content. Raises LogError if it cannot be read."""
    if is_dir(path):
        return (path / "metadata.yaml").is_file()
    try:
        with open_regular(path) as file:
            return file.read(16).startswith((BAG_MAGIC, MCAP_MAGIC, SQLITE_MAGIC))
    except OSError as exc:
        raise LogError(f"cannot read {path}: {exc.strerror or exc}", file=str(path)) from exc
