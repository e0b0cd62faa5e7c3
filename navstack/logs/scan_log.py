"""The scans of one robot with odometry and reference poses: what localization and mapping need of a log, from every format.

`Log` has the messages of ROS by topic.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Final

import numpy as np

from navstack.core import LogError, OccupancyGrid, Pose2D, Transform2D
from navstack.localization import LoggedScan
from navstack.record import Record

MAX_PROBLEMS: Final = 100
"""Largest number of different problems of a log that are kept."""


@dataclass(frozen=True, slots=True)
class ScanLogOptions:
    """What to read of a log, where the log leaves a choice."""

    topics: Mapping[str, str] = field(default_factory=dict[str, str])
    """Topic by role: `scan`, `odom`, `map`, and `reference`: a topic of poses, `tf` (map -> odom of the log) or `none`."""
    mountings: Mapping[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])
    """Frame -> x, y, z, yaw on the base, for sensors that the log does not place."""
    start: float | None = None
    """First time (s since the beginning of the log); None: its beginning."""
    end: float | None = None
    partial: bool = False
    """Read what can be read of a damaged bag."""
    poses_suffice: bool = False
    """In a log without odometry the poses of the reference take its place: enough for a map, nothing to localize with."""


class ScanLog(ABC):
    """The scans of one robot in a log, with the odometry at each. Reading is streaming: memory does not grow with the length."""

    kind: ClassVar[str]
    """Name of the format."""

    def __init__(self, path: Path, options: ScanLogOptions | None = None) -> None:
        self.path = path
        self.options = options or ScanLogOptions()
        self.notes: list[str] = []
        """What was chosen without being named."""
        self.problems: dict[str, int] = {}
        """What could not be used in the last pass over the log, with its number."""

    @property
    def epoch(self) -> float:
        """What to add to a stamp of a scan for the time that the log itself has (s)."""
        return 0.0

    @property
    def map(self) -> OccupancyGrid | None:
        """The map in the log; None if it has none. Raises LogError for one that is not valid."""
        return None

    def within(self, stamp: float) -> bool:
        """Return whether a time (s) belongs to the chosen part of the log."""
        start, end = self.options.start, self.options.end
        return (start is None or stamp >= start) and (end is None or stamp <= end)

    def _problem(self, text: str) -> None:
        if text in self.problems or len(self.problems) < MAX_PROBLEMS:
            self.problems[text] = self.problems.get(text, 0) + 1

    @abstractmethod
    def __iter__(self) -> Iterator[LoggedScan]:
        """Yield the scans from the beginning of the log, in its order and numbered from 0; stamps never decrease.

        Raises LogError.
        """


def logged_scans(log: ScanLog, *, every: int = 1, first: int = 0) -> Iterator[LoggedScan]:
    """Return the scans `first`, `first + every`, .. of a log."""
    return itertools.islice(log, first, None, every)


# --- recorded runs of navstack ----------------------------------------------------------------------------------------


class RunScanLog(ScanLog):
    """The scans of a recorded run, its odometry, and the robot's pose in the map as reference."""

    kind = "record"

    def __init__(self, path: Path, options: ScanLogOptions | None = None, record: Record | None = None) -> None:
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
    def of(cls, record: Record) -> RunScanLog:
        """Return the scans of a run in memory."""
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

    def __iter__(self) -> Iterator[LoggedScan]:
        """Yield the scans; see `ScanLog`. The odometry at a scan is interpolated between control cycles."""
        record, known = self.record, self.options.topics.get("reference") != "none"
        times, poses = record.times, record.odom_poses
        yaw = np.unwrap(poses[:, 2])
        index = 0
        for scan in record.scans:
            if scan.scan.topic.strip("/") != self._topic or not self.within(scan.t):
                continue
            x, y = (float(np.interp(scan.t, times, poses[:, i])) for i in range(2))
            odometry = Transform2D(x, y, float(np.interp(scan.t, times, yaw)))
            yield LoggedScan(index, scan.scan, scan.mounting, odometry, Pose2D(*scan.pose) if known else None)
            index += 1
