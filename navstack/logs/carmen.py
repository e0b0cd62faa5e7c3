"""Logs of CARMEN (Carnegie Mellon Robot Navigation Toolkit): FLASER and ODOM lines.

    FLASER n r1 .. rn  x y theta  x y theta  time host time      pose of the laser, pose of the robot
    ODOM x y theta tv rv acceleration  time host time

Corrected logs, in which a SLAM program has replaced the poses, repeat the corrected pose after each scan in an ODOM line of
time 0; the odometry goes on from there. The reader undoes that: its odometry is the sum of the increments between lines, and
never contains the step onto a new base. Without ODOM lines the poses of the FLASER lines are the odometry. Other lines are
left out.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, cast

import numpy as np

from navstack.core import (
    LaserScan,
    LogError,
    Pose2D,
    Transform2D,
    normalize_angle,
    normalize_angles,
    open_regular,
    shortened,
    size_text,
)
from navstack.localization import LoggedScan, Relations
from navstack.logs.scan_log import ScanLog, ScanLogOptions

# --- bounded reading of text logs line by line, plain or compressed with gzip -----------------------------------------


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


_RELATION_FIELDS: Final = 8
_LEVEL_RAD: Final = 1e-3


def read_relations(path: Path) -> Relations:
    """Read a file of relations; `#` begins a comment. Raises LogError for a line without eight numbers, or of a tilted robot."""
    rows: list[list[float]] = []
    for number, text in read_lines(path):
        fields = text.partition("#")[0].split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError:
            row = []
        if len(row) != _RELATION_FIELDS or not all(map(math.isfinite, row)):
            raise LogError(
                f'{path}:{number}: "{shortened(text.strip(), 80)}" is no relation; a line has eight numbers: '
                "stamp1 stamp2 x y z roll pitch yaw",
                file=str(path),
                line=number,
            )
        if max(abs(row[5]), abs(row[6])) > _LEVEL_RAD:
            raise LogError(
                f"{path}:{number}: roll {row[5]:g} and pitch {row[6]:g} rad: only relations on level ground can be compared",
                file=str(path),
                line=number,
            )
        rows.append(row)
    if not rows:
        raise LogError(f"{path} has no relation; a line is stamp1 stamp2 x y z roll pitch yaw", file=str(path))
    table = np.array(rows)
    return Relations(table[:, 0], table[:, 1], np.column_stack((table[:, 2:4], normalize_angles(table[:, 7]))))


NO_RETURN: Final = 50.0
"""From this range on (m), a beam has no return: the lasers of these logs report 81.91 or their maximum."""

_STEP_S: Final = 1.0
"""Time between scans whose times are the same (s),"""
_BACKWARD_STEP_S: Final = 1e-3
"""and after a scan whose time goes back: the next one has a right time again."""

_POSES: Final = 6
_AFTER_RANGES: Final = 9
"""Fields after the ranges: two poses, time, host, time."""


class CarmenLog(ScanLog):
    """A CARMEN log. The pose in a FLASER line is the reference of its scan: the corrected one in a corrected log."""

    kind = "carmen"

    def __init__(self, path: Path, options: ScanLogOptions | None = None, *, no_return: float = NO_RETURN) -> None:
        super().__init__(path, options)
        self._no_return = no_return

    def __iter__(self) -> Iterator[LoggedScan]:
        """Yield the scans; see `ScanLog`."""
        self.problems.clear()
        odometry, base, has_odometry = Transform2D(), None, False
        stamp, last_scan = -math.inf, -math.inf
        scans, index, began = 0, 0, 0.0
        for number, text in read_lines(self.path):
            word = text.split(maxsplit=1)[0] if not text.isspace() else ""
            if word not in ("ODOM", "FLASER"):
                continue
            fields = text.split()
            try:
                if word == "ODOM":
                    pose, time = _odometry(fields)
                    has_odometry = True
                    if base is not None and time != 0.0:
                        odometry = odometry @ (base.inverse() @ pose)
                    base = pose
                    if time != 0.0 or not math.isfinite(stamp):
                        stamp = max(stamp, time)
                    continue
                ranges, laser, robot, time = _scan(fields)
            except ValueError as exc:
                raise LogError(f"{self.path}:{number}: {exc}", file=str(self.path), line=number) from None
            if math.isnan(time):
                time = last_scan + _STEP_S if math.isfinite(last_scan) else 0.0
            elif time <= last_scan:
                self._problem("the time of a scan is not after that of the scan before; it got a later one")
            # some logs have lost the digits of their times: each scan needs its own
            later = last_scan + (_STEP_S if time == last_scan else _BACKWARD_STEP_S)
            stamp = max(stamp, time if time > last_scan else later)
            last_scan = stamp
            if not has_odometry:  # a raw log without ODOM lines: both poses of a FLASER line are the odometry
                odometry = odometry if base is None else odometry @ (base.inverse() @ robot)
                base = robot
            scans += 1
            began = stamp if scans == 1 else began
            if self.within(stamp - began):
                reference = None if self.options.topics.get("reference") == "none" else Pose2D(*robot)
                yield LoggedScan(index, self._laser_scan(ranges, stamp), robot.inverse() @ laser, odometry, reference)
                index += 1
        if scans == 0:
            raise LogError(
                f"{self.path} contains no scan: a CARMEN log has lines that begin with FLASER", file=str(self.path)
            )

    def _laser_scan(self, ranges: list[float], stamp: float) -> LaserScan:
        with np.errstate(over="ignore"):  # a range beyond float32 has no return
            values = np.array(ranges, np.float32)
        values[values >= self._no_return] = np.inf
        values[values < 0.0] = np.nan
        return LaserScan(
            values, -math.pi / 2.0, angular_step(len(ranges)), 0.02, self._no_return, stamp, "laser", "scan"
        )


def angular_step(n: int) -> float:
    """Return the angle between the beams (rad) of a scan of `n` beams over half a circle, which a FLASER line does not say.

    Lasers of these logs have 180 or 181 beams by 1 degree, 360 or 361 by half a degree: without the last one, the
    beams do not cover the whole half circle.
    """
    for degrees in (1.0, 0.5, 0.25):
        if n in (round(180.0 / degrees), round(180.0 / degrees) + 1):
            return math.radians(degrees)
    return math.pi / max(n - 1, 1)


def _odometry(fields: list[str]) -> tuple[Transform2D, float]:
    if len(fields) < 8:
        raise ValueError(f"ODOM has {len(fields) - 1} fields, not x y theta tv rv acceleration time host time")
    return _pose(fields[1:4]), _number(fields[7], "the time")


def _scan(fields: list[str]) -> tuple[list[float], Transform2D, Transform2D, float]:
    n = int(fields[1]) if len(fields) > 1 and fields[1].isdecimal() and len(fields[1]) < 8 else 0
    if n < 1:
        shown = shortened(fields[1], 20) if len(fields) > 1 else "nothing"
        raise ValueError(f"FLASER must be followed by the number of ranges, not by {shown}")
    if len(fields) == 2 + n + _POSES:  # some logs have no times
        fields = [*fields, "nan"]
    elif len(fields) < 2 + n + _AFTER_RANGES:
        raise ValueError(
            f"FLASER announces {n} ranges, but {len(fields) - 2} fields follow instead of {n + _AFTER_RANGES}: {n} ranges, "
            "two poses x y theta, time host time"
        )
    ranges = [_range(text) for text in fields[2 : 2 + n]]
    rest = fields[2 + n :]
    time = math.nan if len(rest) == _POSES + 1 else _number(rest[6], "the time")
    return ranges, _pose(rest[:3]), _pose(rest[3:6]), time


def _pose(fields: list[str]) -> Transform2D:
    x, y, yaw = (_number(text, name) for text, name in zip(fields, ("x", "y", "theta"), strict=True))
    return Transform2D(x, y, normalize_angle(yaw))


def _range(text: str) -> float:
    value = float(text) if len(text) < 40 else math.nan
    return value if math.isfinite(value) else math.nan


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{what} must be a number, not {shortened(text, 20)}") from None
    if not math.isfinite(value) or abs(value) > 1e12:
        raise ValueError(f"{what} must be a finite number, not {shortened(text, 20)}")
    return value
