"""Recorded runs of navstack as logs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from navstack.core import OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import LogError
from navstack.drives.messages import Drive, DriveMessage, DriveOptions, Odometry, Reference, Scan
from navstack.record import Record


class RecordDrive(Drive):
    """The scans of a recorded run, its odometry, and the robot's pose in the map as reference."""

    kind = "record"

    def __init__(self, path: Path, options: DriveOptions | None = None, record: Record | None = None) -> None:
        """`record`: the run itself, if it has been read."""
        super().__init__(path, options)
        self.record = Record.load(path) if record is None else record
        if not self.record.scans:
            raise LogError(
                f"{path} contains no scans; record the run of a robot with a lidar (`simulate --out DIR`)",
                file=str(path),
            )
        self._topic = self._chosen_topic()

    @classmethod
    def of(cls, record: Record) -> RecordDrive:
        """Return the drive of a run in memory."""
        return cls(record.path or Path("the run"), record=record)

    def _chosen_topic(self) -> str:
        """Return the lidar to use: the chosen one, else the first."""
        topics = list(dict.fromkeys(scan.scan.topic.strip("/") for scan in self.record.scans))
        chosen = self.options.topics.get("scan", "").strip("/")
        if chosen and chosen not in topics:
            raise LogError(f"{self.path} has no scans of {chosen}; its lidars: {', '.join(topics)}", topic=chosen)
        if len(topics) > 1 and not chosen:
            self.notes.append(f"the scans are those of {topics[0]}; others: --topic scan={topics[1]}")
        return chosen or topics[0]

    @property
    def map(self) -> OccupancyGrid | None:
        """The map of the run."""
        return self.record.map

    def __iter__(self) -> Iterator[DriveMessage]:
        """Yield the messages; see `Drive`. The odometry at a scan is interpolated between control cycles."""
        record, known = self.record, self.options.topics.get("reference") != "none"
        times, poses = record.times, record.odom_poses
        yaw = np.unwrap(poses[:, 2])
        for scan in record.scans:
            if scan.scan.topic.strip("/") != self._topic or not self.within(scan.t):
                continue
            x, y = (float(np.interp(scan.t, times, poses[:, i])) for i in range(2))
            yield Odometry(scan.t, Transform2D(x, y, float(np.interp(scan.t, times, yaw))))
            if known:
                yield Reference(scan.t, Pose2D(*scan.pose))
            yield Scan(scan.scan, scan.mounting)
