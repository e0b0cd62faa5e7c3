"""Messages of a log, and the interface that every format offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Final

from navstack.core import LaserScan, OccupancyGrid, Pose2D, Transform2D

MAX_PROBLEMS: Final = 100
"""Largest number of different problems of a log that are kept."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose of the base in the odometry frame at `stamp` (s). The frame never jumps."""

    stamp: float
    pose: Transform2D


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """A scan; `sensor` is the pose of its sensor in the base frame."""

    scan: LaserScan
    sensor: Transform2D

    @property
    def stamp(self) -> float:
        """Time of the scan (s)."""
        return self.scan.stamp


@dataclass(frozen=True, slots=True)
class Reference:
    """The pose of the base in the map at `stamp` (s), as recorded by the author of the log."""

    stamp: float
    pose: Pose2D


DriveMessage = Odometry | Scan | Reference


@dataclass(frozen=True, slots=True)
class DriveOptions:
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


class Drive(ABC):
    """A log of one robot. Reading is streaming: memory does not grow with the length of the log."""

    kind: ClassVar[str]
    """Name of the format."""

    def __init__(self, path: Path, options: DriveOptions | None = None) -> None:
        self.path = path
        self.options = options or DriveOptions()
        self.notes: list[str] = []
        """What was chosen without being named."""
        self.problems: dict[str, int] = {}
        """What could not be used in the last pass over the log, with its number."""

    @property
    def epoch(self) -> float:
        """What to add to a stamp of the drive for the time that the log itself has (s)."""
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
    def __iter__(self) -> Iterator[DriveMessage]:
        """Yield the messages, from the beginning, in the order of the log; stamps never decrease.

        The odometry and the reference of a scan come before the scan. Raises LogError.
        """


@dataclass(frozen=True, slots=True, eq=False)
class DriveFrame:
    """A scan with the odometry and, if there is one, the reference pose at its stamp."""

    index: int
    """Number of the scan in the log, from 0."""
    scan: LaserScan
    sensor: Transform2D
    odometry: Transform2D
    reference: Pose2D | None


def drive_frames(log: Drive, *, every: int = 1, first: int = 0) -> Iterator[DriveFrame]:
    """Yield scans `first`, `first + every`, .. of a log with the last odometry before each.

    A reference belongs to a scan if their stamps are equal. Scans before the first odometry are left out.
    """
    odometry: Transform2D | None = None
    reference: Reference | None = None
    index = 0
    for message in log:
        if isinstance(message, Odometry):
            odometry = message.pose
        elif isinstance(message, Reference):
            reference = message
        else:
            if odometry is not None and index >= first and (index - first) % every == 0:
                known = reference is not None and reference.stamp == message.stamp
                yield DriveFrame(
                    index, message.scan, message.sensor, odometry, reference.pose if reference and known else None
                )
            index += 1
            reference = None
