"""Opens a log of any format."""

from __future__ import annotations

import os
from pathlib import Path, PurePath
from typing import Final

import yaml

from navstack.core import LogError, NavError, open_regular, read_bytes, shortened
from navstack.logs.log import Log

BAG_MAGIC: Final = b"#ROSBAG V"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
SQLITE_MAGIC: Final = b"SQLite format 3\0"


MOST_METADATA: Final = 20_000_000
"""Largest metadata.yaml (bytes)."""


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
        renamed, note = _renamed_file(path)
        if renamed is None:
            return open_rosbag2(path)
        log = _open(renamed)
        log.notes.append(note)
        return log
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


def _renamed_file(folder: Path) -> tuple[Path | None, str]:
    """Return the only file of a bag whose metadata names one that is not there, and a note; None if the named files are there.

    Raises LogError if the folder has no file or several in place of the missing ones.
    """
    metadata = folder / "metadata.yaml"
    try:
        found = yaml.safe_load(read_bytes(metadata, MOST_METADATA))
        named = [PurePath(name).name for name in found["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (OSError, NavError, yaml.YAMLError, KeyError, TypeError, RecursionError):
        return None, ""  # the reader says what is wrong with the metadata
    missing = [name for name in named if not (folder / name).is_file()]
    if not missing:
        return None, ""
    present = sorted(file for file in folder.iterdir() if file.suffix in (".db3", ".mcap"))
    has = ", ".join(file.name for file in present) or "no .db3 or .mcap file"
    text = f"{metadata} names {shortened(', '.join(missing), 120)}, and the folder has {shortened(has, 200)}"
    if len(present) != 1 or len(named) != 1:
        raise LogError(
            f"{text}: rename the files to the names of the metadata, or open them one by one", path=str(folder)
        )
    return present[0], f"{text}: that is read instead"


def _magic(path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            return file.read(16)
    except FileNotFoundError as exc:
        raise LogError(f"{path} does not exist; give the path of a recorded log", path=str(path)) from exc
    except OSError as exc:
        raise LogError(f"cannot read {path}: {exc.strerror}", path=str(path)) from exc
