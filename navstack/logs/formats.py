"""Opens a log of any format."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from navstack.core import LogError, open_regular
from navstack.logs.log import Log

BAG_MAGIC: Final = b"#ROSBAG V"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
SQLITE_MAGIC: Final = b"SQLite format 3\0"


def open_log(path: str | os.PathLike[str], *, partial: bool = False) -> Log:
    """Open a ROS 1 bag, a ROS 2 bag (its folder, or a .db3 or .mcap file) or an MCAP file. The content decides, not the name.

    A truncated, damaged or unindexed file is an error that says what can be read; with `partial=True`, that is read, and
    `Log.problem` is the error. Raises LogError, and InputError if the extra for the format is not installed.
    """
    path = Path(path)
    log = _open(path)
    if log.problem is not None and not partial:
        problem = log.problem
        log.close()
        raise problem
    return log


def _open(path: Path) -> Log:
    if path.is_dir():
        from navstack.logs.rosbag2 import open_rosbag2

        if not (path / "metadata.yaml").is_file():
            raise LogError(
                f"{path} is a folder without metadata.yaml, so it is not a ROS 2 bag; give the bag's folder or file",
                path=str(path),
            )
        return open_rosbag2(path)
    magic = _magic(path)
    if magic.startswith(BAG_MAGIC):
        from navstack.logs.bag import open_bag

        return open_bag(path)
    if magic.startswith(MCAP_MAGIC):
        from navstack.logs.mcap_file import open_mcap

        return open_mcap(path)
    if magic.startswith(SQLITE_MAGIC):
        from navstack.logs.rosbag2 import open_rosbag2

        return open_rosbag2(path)
    what = "is empty" if not magic else "is not a log that navstack reads"
    raise LogError(
        f"{path} {what} (offset 0); give a ROS 1 bag, a ROS 2 bag (folder, .db3 or .mcap) or an MCAP file",
        path=str(path),
        offset=0,
    )


def _magic(path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            return file.read(16)
    except FileNotFoundError as exc:
        raise LogError(f"{path} does not exist; give the path of a recorded log", path=str(path)) from exc
    except OSError as exc:
        raise LogError(f"cannot read {path}: {exc.strerror}", path=str(path)) from exc
