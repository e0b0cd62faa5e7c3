"""Bags of ROS 1 and ROS 2 and MCAP files as drives."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from navstack.core import FrameTree, OccupancyGrid, Pose2D, Transform2D
from navstack.core.errors import FrameError, LogError, NavError
from navstack.drives.messages import Drive, DriveMessage, DriveOptions, Odometry, Reference, Scan
from navstack.drives.ros_topics import DriveTopics, find_drive_topics
from navstack.logs import Log, LogMessage, open_log
from navstack.logs import messages as ros
from navstack.logs.log import NS_PER_S, seconds
from navstack.logs.messages import Clock, StampedTransform
from navstack.logs.rotations import Transform3D, quaternion_of_yaw
from navstack.logs.transforms import LEVEL, LoggedFrames

CLOCKS_DIFFER_S: Final = 600.0
"""Stamps that differ more from the time of the recording (s) belong to another clock."""
WAIT_S: Final = 1.0
"""A scan waits this long for the odometry and the reference at its stamp (s)."""
TOLERANCE_S: Final = 0.2
"""Odometry this old (s) serves if no newer one comes."""
_BASE, _WORLD = "\nbase", "\nworld"
"""Frames of the reference: names that no log has."""


class RosDrive(Drive):
    """A log of ROS: scans, odometry at their stamps by interpolation, and a reference if the log has one.

    A scan is passed on when the odometry at its stamp is known, which may come later in the log. Times are those of the headers,
    in seconds since the first message.
    """

    kind = "bag"

    def __init__(self, path: Path, options: DriveOptions | None = None) -> None:
        """Open the log and choose its topics. Raises LogError, and InputError if the extra for the format is not installed."""
        super().__init__(path, options)
        self._log = open_log(path, partial=self.options.partial)
        self.topics: DriveTopics = find_drive_topics(self._log, self.options)
        self._clock = _clock_of(self._log, self.topics.scan)
        self._static: list[StampedTransform] | None = None
        self.notes += self.topics.notes

    @property
    def epoch(self) -> float:
        """What to add to a stamp of the drive for the time in the headers of the log (s)."""
        return (self._clock.start_ns - self._clock.stamp_shift_ns) / NS_PER_S

    @property
    def map(self) -> OccupancyGrid | None:
        """The first map of the log. Raises LogError for one that is not valid."""
        if self.topics.map:
            for message in self._log.messages([self.topics.map]):
                return ros.map_of(message.data)
        return None

    def __iter__(self) -> Iterator[DriveMessage]:
        """Yield the messages; see `Drive`."""
        self.problems.clear()
        reader = _Reader(self, self._clock, self._static_transforms())
        start, end = self.options.start, self.options.end
        for message in self._log.messages(self.topics.used, start=start, end=end):
            yield from reader.read(message)
        yield from reader.rest()

    def problem(self, text: str) -> None:
        """Count something that could not be used."""
        self._problem(text)

    def _static_transforms(self) -> list[StampedTransform]:
        """Return the transforms that are valid at all times, in whatever place of the log."""
        if self._static is None:
            found: list[StampedTransform] = []
            if "/tf_static" in self.topics.transforms:
                for message in self._log.messages(["/tf_static"]):
                    try:
                        found += ros.transforms_of(message.data, self._clock)
                    except LogError as exc:
                        self._problem(f"/tf_static: {exc.message}")
            for frame, (x, y, z, yaw) in self.options.mountings.items():
                pose = Transform3D(x, y, z, quaternion_of_yaw(yaw))
                found.append(StampedTransform(self.topics.base, frame, 0.0, pose))
            self._static = found
        return self._static


class _Reader:
    """One pass over the log."""

    def __init__(self, drive: RosDrive, clock: Clock, static: list[StampedTransform]) -> None:
        self._drive = drive
        self._topics = drive.topics
        self._clock = clock
        self._tree = FrameTree()
        self._frames = LoggedFrames(self._tree)
        self._frames.add_static(static)
        self._truth = FrameTree()
        self._waiting: deque[tuple[float, Any]] = deque()
        self._fields: dict[str, ros.ScanFields] = {}
        self._last = -math.inf
        self._found_odometry = False

    def read(self, message: LogMessage) -> Iterator[DriveMessage]:
        """Take a message; yield what is complete with it."""
        topic, topics = message.topic, self._topics
        try:
            if topic == topics.scan:
                self._waiting.append((self._clock.stamp(message.data), message.data))
            elif topic == "/tf":
                self._frames.add(ros.transforms_of(message.data, self._clock))
            elif topic == topics.odometry:
                found = ros.odometry_of(message.data, self._clock)
                self._tree.set(topics.odom, topics.base, Transform2D(*found.pose), found.stamp)
            elif topic == topics.reference:
                self._truth.set(_WORLD, _BASE, Transform2D(*_pose_in(message)), self._clock.stamp(message.data))
            elif topic == topics.exported:
                self._fields, _ = ros.sensor_fields_of(message.data)
        except (LogError, FrameError) as exc:
            self._drive.problem(f"{topic}: {exc.message}")
        yield from self._ready(seconds(message.time_ns, self._clock.start_ns))

    def rest(self) -> Iterator[DriveMessage]:
        """Yield what is left at the end of the log."""
        yield from self._ready(math.inf)
        if not self._found_odometry:
            topics = self._topics
            raise LogError(
                f"{self._drive.path}: no scan of {topics.scan} could be used: {'; '.join(self._drive.problems) or 'no scan'}",
                path=str(self._drive.path),
            )

    def _ready(self, now: float) -> Iterator[DriveMessage]:
        """Yield the scans whose odometry is known, or that have waited long enough at `now` (s)."""
        while self._waiting:
            stamp, data = self._waiting[0]
            late = now - stamp > WAIT_S
            odometry = self._lookup(stamp, TOLERANCE_S if late else 0.0)
            if odometry is None and not late:
                return
            reference = self._reference(stamp)
            if reference is None and self._topics.reference and not late:
                return
            self._waiting.popleft()
            if odometry is None:
                self._drive.problem(f'{self._topics.scan}: no pose of "{self._topics.base}" at the time of the scan')
                continue
            if stamp <= self._last:
                self._drive.problem(f"{self._topics.scan}: a scan is not newer than the one before it")
                continue
            scan = self._scan(stamp, data)
            if scan is None:
                continue
            self._found_odometry = True
            self._last = stamp
            yield Odometry(stamp, odometry)
            if reference is not None:
                yield Reference(stamp, Pose2D(*reference))
            yield scan

    def _lookup(self, stamp: float, tolerance_s: float) -> Transform2D | None:
        try:
            return self._tree.lookup(self._topics.odom, self._topics.base, stamp, tolerance_s)
        except NavError:
            return None

    def _reference(self, stamp: float) -> Transform2D | None:
        topics = self._topics
        if not topics.reference:
            return None
        try:
            if topics.reference == "tf":
                return self._tree.lookup(topics.map_frame, topics.base, stamp)
            return self._truth.lookup(_WORLD, _BASE, stamp)
        except NavError:
            return None

    def _scan(self, stamp: float, data: Any) -> Scan | None:
        """Return the scan with the pose of its sensor; None, with a problem, if that is not known."""
        topics, topic = self._topics, self._topics.scan
        try:
            frame = ros.frame_of(data)
            mounting = self._frames.mounting(frame)
            upside_down = mounting.tilt > 0.5 * math.pi
            tilt = math.pi - mounting.tilt if upside_down else mounting.tilt
            if tilt > LEVEL:
                self._drive.problem(
                    f'{topic}: "{frame}" is tilted by {tilt:.2f} rad; its scans are used as if it was level'
                )
            fields = self._fields.get(topic)
            scan = ros.scan_of(
                data, topic.strip("/"), stamp, height=mounting.height, upside_down=upside_down, fields=fields
            )
        except NavError as exc:
            self._drive.problem(f"{topic}: {exc.message}")
            return None
        try:
            return Scan(scan, self._tree.lookup(topics.base, frame, stamp, math.inf))
        except NavError:
            raise LogError(
                f'{self._drive.path} does not say where "{frame}", the frame of {topic}, is on "{topics.base}"; give it with '
                f"--mount {frame}=X,Y,Z,YAW (m, rad), such as --mount {frame}=-0.06,0,0.17,0",
                frame=frame,
            ) from None


def _pose_in(message: LogMessage) -> Pose2D:
    """Return the pose of an Odometry, PoseStamped or PoseWithCovarianceStamped."""
    return ros.pose_of(message.data.pose if message.type == ros.POSE else message.data.pose.pose)


def _clock_of(log: Log, topic: str) -> Clock:
    """Return the clock of the log; the stamps of its scans may belong to another one than the times of the recording."""
    for message in log.messages([topic]):
        try:
            shift = message.time_ns - ros.header_ns(message.data)
        except LogError:
            continue
        far = abs(shift) > CLOCKS_DIFFER_S * NS_PER_S
        return Clock(log.start_ns, shift if far else 0)
    return Clock(log.start_ns)
