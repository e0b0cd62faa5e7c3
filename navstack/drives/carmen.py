"""Logs of CARMEN (Carnegie Mellon Robot Navigation Toolkit): FLASER and ODOM lines.

    FLASER n r1 .. rn  x y theta  x y theta  time host time      pose of the laser, pose of the robot
    ODOM x y theta tv rv acceleration  time host time

Corrected logs, in which a SLAM program has replaced the poses, repeat the corrected pose after each scan in an ODOM line of
time 0; the odometry goes on from there. The reader undoes that: its odometry is the sum of the increments between lines, and
never contains the step onto a new base. Other lines are left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from navstack.core import LaserScan, Pose2D, Transform2D, normalize_angle
from navstack.core.bounded_reading import shortened
from navstack.core.errors import LogError
from navstack.drives.lines import read_lines
from navstack.drives.messages import Drive, DriveMessage, DriveOptions, Odometry, Reference, Scan

NO_RETURN: Final = 50.0
"""From this range on (m), a beam has no return: the lasers of these logs report 81.91 or their maximum."""

_STEP_S: Final = 1.0
"""Time between scans whose times do not increase (s)."""

_AFTER_RANGES: Final = 9
"""Fields after the ranges: two poses, time, host, time."""


class CarmenDrive(Drive):
    """A CARMEN log. The pose in a FLASER line is the reference of its scan: the corrected one in a corrected log."""

    kind = "carmen"

    def __init__(self, path: Path, options: DriveOptions | None = None, *, no_return: float = NO_RETURN) -> None:
        super().__init__(path, options)
        self._no_return = no_return

    def __iter__(self) -> Iterator[DriveMessage]:
        """Yield the messages; see `Drive`."""
        odometry, base = Transform2D(), None
        stamp, last_scan = -math.inf, -math.inf
        scans, began = 0, 0.0
        for number, text in read_lines(self.path):
            word = text.split(maxsplit=1)[0] if not text.isspace() else ""
            if word not in ("ODOM", "FLASER"):
                continue
            fields = text.split()
            try:
                if word == "ODOM":
                    pose, time = _odometry(fields)
                    if base is not None and time != 0.0:
                        odometry = odometry @ (base.inverse() @ pose)
                    base = pose
                    if time == 0.0 and math.isfinite(stamp):
                        continue
                    stamp = max(stamp, time)
                    yield Odometry(stamp, odometry)
                    continue
                ranges, laser, robot, time = _scan(fields)
            except ValueError as exc:
                raise LogError(f"{self.path}:{number}: {exc}", file=str(self.path), line=number) from None
            # some logs have lost the digits of their times: each scan needs its own
            stamp = max(stamp, time if time > last_scan else last_scan + _STEP_S)
            last_scan = stamp
            if base is None:
                base = robot
                yield Odometry(stamp, odometry)
            scans += 1
            began = stamp if scans == 1 else began
            if not self.within(stamp - began):
                continue
            if self.options.topics.get("reference") != "none":
                yield Reference(stamp, Pose2D(*robot))
            yield Scan(self._laser_scan(ranges, stamp), robot.inverse() @ laser)
        if scans == 0:
            raise LogError(
                f"{self.path} contains no scan: a CARMEN log has lines that begin with FLASER", file=str(self.path)
            )

    def _laser_scan(self, ranges: list[float], stamp: float) -> LaserScan:
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
    if len(fields) < 2 + n + _AFTER_RANGES:
        raise ValueError(
            f"FLASER announces {n} ranges, but {len(fields) - 2} fields follow instead of {n + _AFTER_RANGES}: {n} ranges, "
            "two poses x y theta, time host time"
        )
    ranges = [_range(text) for text in fields[2 : 2 + n]]
    rest = fields[2 + n :]
    return ranges, _pose(rest[:3]), _pose(rest[3:6]), _number(rest[6], "the time")


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
