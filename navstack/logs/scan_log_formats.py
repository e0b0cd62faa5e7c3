"""Open a log of scans in any format: CARMEN logs, bags, MCAP files, recorded runs."""

from __future__ import annotations

import itertools
from pathlib import Path

from navstack.core import LogError, exists, is_dir, open_regular
from navstack.logs.carmen import CarmenLog, read_lines
from navstack.logs.formats import BAG_MAGIC, MCAP_MAGIC, SQLITE_MAGIC
from navstack.logs.ros_scan_log import RosScanLog
from navstack.logs.scan_log import RunScanLog, ScanLog, ScanLogOptions

_SEARCHED_LINES = 100_000
_KNOWN = "CARMEN logs (.log, .log.gz), bags and MCAP files, recorded runs (run.npz or the folder of one)"


def open_scan_log(path: str | Path, options: ScanLogOptions | None = None) -> ScanLog:
    """Open a log; its format is found from its name and its beginning.

    Raises LogError for a missing file and for a format that is not known.
    """
    file = Path(path)
    if not exists(file):
        raise LogError(f"{file} does not exist; give the path of a log: {_KNOWN}", file=str(file))
    if is_bag(file):
        return RosScanLog(file, options)
    if is_dir(file) or file.suffix == ".npz":
        return RunScanLog(file, options)
    for _, text in itertools.islice(read_lines(file), _SEARCHED_LINES):
        if text.startswith(("FLASER ", "ODOM ", "# message formats defined", "# CARMEN")):
            return CarmenLog(file, options)
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
