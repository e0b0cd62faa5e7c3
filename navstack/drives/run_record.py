"""Recorded runs of navstack as logs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from navstack.core import Pose2D, Transform2D
from navstack.core.errors import LogError
from navstack.drives.messages import Drive, DriveMessage, Odometry, Reference, Scan


class RecordDrive(Drive):
    """The scans of a recorded run, its odometry, and the robot's pose in the map as reference."""

    kind = "record"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        from navstack.record import Record

        self.record = Record.load(path)
        if not self.record.scans:
            raise LogError(
                f"{path} contains no scans; record the run of a robot with a lidar (`simulate --out DIR`)",
                file=str(path),
            )

    def __iter__(self) -> Iterator[DriveMessage]:
        """Yield the messages; see `Drive`. The odometry at a scan is interpolated between control cycles."""
        record = self.record
        times, poses = record.times, record.odom_poses
        yaw = np.unwrap(poses[:, 2])
        for scan in record.scans:
            x, y = (float(np.interp(scan.t, times, poses[:, i])) for i in range(2))
            yield Odometry(scan.t, Transform2D(x, y, float(np.interp(scan.t, times, yaw))))
            yield Reference(scan.t, Pose2D(*scan.pose))
            yield Scan(scan.scan, scan.mounting)
