"""Scan logs from bags of ROS 1 and ROS 2 and MCAP files."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from navstack.core import FrameError, FrameTree, LaserScan, LogError, NavError, OccupancyGrid, Pose2D, Transform2D
from navstack.localization import LoggedScan
from navstack.logs.contents import CLOCKS_DIFFER_S, first_odometry, first_parents
from navstack.logs.formats import open_log
from navstack.logs.log import Log, LogMessage
from navstack.logs.scan_log import ScanLog, ScanLogOptions
from navstack.ros_messages import (
    LEVEL,
    NS_PER_S,
    TRUTH,
    Clock,
    StampedTransform,
    TopicFinder,
    Transform3D,
    TransformTree,
    quaternion_of_yaw,
    seconds,
    short_type,
)
from navstack.ros_messages import messages as ros

# --- which topics and frames of a ROS log are used: scans, odometry, reference, map ------------------------------


POSE_WITH_COVARIANCE: Final = "geometry_msgs/msg/PoseWithCovarianceStamped"
REFERENCES: Final = (ros.ODOMETRY, ros.POSE, POSE_WITH_COVARIANCE)
"""Types of messages that can be the reference."""
SCAN_TOPICS: Final = ("/scan", "/base_scan", "/scan_filtered", "/laser")
ODOMETRY_TOPICS: Final = ("/odom", "/odometry/filtered")
"""Usual names."""


@dataclass(slots=True)
class ScanLogTopics:
    """Topics and frames by role; an empty name: the log has none."""

    scan: str
    odometry: str = ""
    """Topic of the odometry; empty: its transform in /tf is used."""
    base: str = "base_link"
    """Frame of the base."""
    odom: str = "odom"
    """Frame of the odometry; empty: the log has none, and the poses of the reference take its place."""
    reference: str = ""
    """Topic of poses of the base in the map; `tf`: the transform of `map_frame`."""
    map: str = ""
    map_frame: str = "map"
    transforms: tuple[str, ...] = ()
    exported: str = ""
    """Topic with the exact fields of the scans of an exported run."""
    notes: list[str] = field(default_factory=list[str])

    @property
    def used(self) -> list[str]:
        """Every topic that is read."""
        reference = "" if self.reference == "tf" else self.reference
        return sorted({t for t in (self.scan, self.odometry, reference, self.exported, *self.transforms) if t})


def find_scan_log_topics(log: Log, options: ScanLogOptions) -> ScanLogTopics:
    """Return the topics of a log by role. Raises LogError for scans, odometry or a chosen topic that it does not have."""
    chosen = {role: topic for role, topic in options.topics.items() if role != "reference"}
    finder = TopicFinder(str(log.path), log.types, chosen)
    nothing = "so there is nothing to localize with"
    topics = ScanLogTopics(finder.find("scan", (ros.SCAN,), SCAN_TOPICS, needed=nothing), notes=finder.notes)
    topics.transforms = finder.transforms()
    topics.exported = finder.sensor_fields()
    topics.map = finder.named("map", (ros.MAP,), ("/map",))
    reference = options.topics.get("reference", "")
    try:
        _find_odometry(log, finder, topics)
    except LogError as exc:
        if not options.poses_suffice or "/odom" in finder.chosen:
            raise
        topics.odom = ""
        _find_base(log, topics)
        _find_reference(log, reference or _only_poses(log), topics)
        if not topics.reference:
            raise LogError(
                f"{exc.message}; nor poses of the robot: give a topic with --reference TOPIC", path=str(log.path)
            ) from exc
        where = "/tf" if topics.reference == "tf" else topics.reference
        topics.notes.append(f"the log has no odometry; the poses of {where} are used")
        return topics
    _find_reference(log, reference, topics)
    return topics


def _find_base(log: Log, topics: ScanLogTopics) -> None:
    """Find the base of a robot without odometry, and the frame in which its pose is known, from the frame of its scans up."""
    parents = first_parents(log, ("/tf_static", "/tf"))
    moving = first_parents(log, ("/tf",))
    frame = next((ros.frame_of(message.data) for message in log.messages([topics.scan])), topics.base)
    chain = [frame]
    while chain[-1] in parents and parents[chain[-1]] not in chain:
        chain.append(parents[chain[-1]])
    named = [base for base in ("base_footprint", "base_link") if base in chain]
    moved = [base for base in chain if base in moving]
    truth = first_odometry(log, TRUTH, Clock(log.start_ns)) if log.has(TRUTH) else None
    if truth is not None and truth.child in chain:
        topics.base = truth.child
    elif named or len(chain) > 1:
        topics.base = (named or moved or chain[-1:])[0]
    if chain[-1] not in (topics.base, frame):
        topics.map_frame = chain[-1]


def _only_poses(log: Log) -> str:
    """Return the only topic of poses of the robot; empty if there is none, or a choice."""
    found = [
        topic for topic in log.topics_of(ros.POSE, POSE_WITH_COVARIANCE) if not topic.endswith(("goal", "initialpose"))
    ]
    if log.has(TRUTH) or len(found) != 1:
        return ""
    return found[0]


def _find_odometry(log: Log, finder: TopicFinder, topics: ScanLogTopics) -> None:
    """Find the odometry: that of /tf, which every localizer of ROS uses, or else the poses of a topic."""
    moving = first_parents(log, ("/tf_static", "/tf"))
    is_chosen = "/odom" in finder.chosen
    if is_chosen or any(topic != TRUTH for topic in finder.of(ros.ODOMETRY)):
        topics.odometry = finder.find("odom", (ros.ODOMETRY,), ODOMETRY_TOPICS, needed="so there is no odometry")
        first = first_odometry(log, topics.odometry, Clock(log.start_ns))
        if first is not None:
            topics.odom, topics.base = first.frame, first.child or topics.base
    else:
        topics.base = next((b for b in ("base_footprint", "base_link") if b in moving), topics.base)
    reached = {topics.base}
    frame = topics.base
    while frame in moving and moving[frame] not in reached:
        frame = moving[frame]
        reached.add(frame)
    if not is_chosen and topics.odom in reached and topics.odom != topics.base:
        topics.odometry = ""
    elif not topics.odometry:
        raise LogError(
            f'{log.path} has no odometry: neither a topic of {short_type(ros.ODOMETRY)} nor a transform from "{topics.base}" to '
            f'"{topics.odom}" in /tf',
            path=str(log.path),
        )
    if frame not in (topics.base, topics.odom):
        topics.map_frame = frame


def _find_reference(log: Log, chosen: str, topics: ScanLogTopics) -> None:
    """Find the reference: what was chosen, else the true pose of a simulation, else the localization that was recorded."""
    in_tf = topics.map_frame in first_parents(log, ("/tf_static", "/tf")).values()
    if chosen == "none":
        return
    if chosen == "tf" and not in_tf:
        raise LogError(f'{log.path} has no transform from "{topics.odom}" to a map in /tf; use --reference none')
    if chosen and chosen != "tf":
        finder = TopicFinder(str(log.path), log.types, {"reference": chosen})
        topics.reference = finder.choice("reference", REFERENCES)
    elif not chosen and TRUTH in log.topics_of(ros.ODOMETRY):
        topics.reference = TRUTH
        topics.notes.append(f"the reference is {TRUTH}")
    elif in_tf:
        topics.reference = "tf"
        if not chosen:
            topics.notes.append(
                f'the reference is the localization in the log (/tf, "{topics.map_frame}"), which has errors of its own; '
                "leave it out with --reference none"
            )


WAIT_S: Final = 1.0
"""A scan waits this long for the odometry and the reference at its stamp (s)."""
TOLERANCE_S: Final = 0.2
"""Odometry this old (s) serves if no newer one comes."""
_BASE, _WORLD = "\nbase", "\nworld"
"""Frames of the reference: names that no log has."""


class RosScanLog(ScanLog):
    """A log of ROS: scans, odometry at their stamps by interpolation, and a reference if the log has one.

    A scan is passed on when the odometry at its stamp is known, which may come later in the log. Times are those of the headers,
    in seconds since the first message.
    """

    kind = "bag"

    def __init__(self, path: Path, options: ScanLogOptions | None = None) -> None:
        """Open the log and choose its topics. Raises LogError, and InputError if the extra for the format is not installed."""
        super().__init__(path, options)
        self._log = open_log(path, partial=self.options.partial)
        self.topics: ScanLogTopics = find_scan_log_topics(self._log, self.options)
        self._clock = _clock_of(self._log, self.topics.scan)
        self._static: list[StampedTransform] | None = None
        self.notes += [*self._log.notes, *self.topics.notes]

    @property
    def epoch(self) -> float:
        """What to add to a stamp of a scan for the time in the headers of the log (s)."""
        return (self._clock.start_ns - self._clock.stamp_shift_ns) / NS_PER_S

    @property
    def map(self) -> OccupancyGrid | None:
        """The first map of the log. Raises LogError for one that is not valid."""
        if self.topics.map:
            for message in self._log.messages([self.topics.map]):
                return ros.map_of(message.data, self.topics.map, self._problem)
        return None

    def __iter__(self) -> Iterator[LoggedScan]:
        """Yield the scans; see `ScanLog`."""
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

    def __init__(self, log: RosScanLog, clock: Clock, static: list[StampedTransform]) -> None:
        self._log = log
        self._topics = log.topics
        self._clock = clock
        self._tree = FrameTree()
        self._frames = TransformTree(self._tree)
        self._frames.add_static(static)
        self._truth = FrameTree()
        self._waiting: deque[tuple[float, Any]] = deque()
        self._fields: dict[str, ros.ScanFields] = {}
        self._last = -math.inf
        self._count = 0

    def read(self, message: LogMessage) -> Iterator[LoggedScan]:
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
            self._log.problem(f"{topic}: {exc.message}")
        yield from self._ready(seconds(message.time_ns, self._clock.start_ns))

    def rest(self) -> Iterator[LoggedScan]:
        """Yield what is left at the end of the log."""
        yield from self._ready(math.inf)
        if not self._count:
            topics = self._topics
            raise LogError(
                f"{self._log.path}: no scan of {topics.scan} could be used: {'; '.join(self._log.problems) or 'no scan'}",
                path=str(self._log.path),
            )

    def _ready(self, now: float) -> Iterator[LoggedScan]:
        """Yield the scans whose odometry is known, or that have waited long enough at `now` (s)."""
        while self._waiting:
            stamp, data = self._waiting[0]
            late = now - stamp > WAIT_S
            reference = self._reference(stamp)
            odometry = self._lookup(stamp, TOLERANCE_S if late else 0.0) if self._topics.odom else reference
            if odometry is None and not late:
                return
            if reference is None and self._topics.reference and not late:
                return
            self._waiting.popleft()
            if odometry is None:
                self._log.problem(f'{self._topics.scan}: no pose of "{self._topics.base}" at the time of the scan')
                continue
            if stamp <= self._last:
                self._log.problem(f"{self._topics.scan}: a scan is not newer than the one before it")
                continue
            scan = self._scan(stamp, data)
            if scan is None:
                continue
            self._last = stamp
            pose = None if reference is None else Pose2D(*reference)
            yield LoggedScan(self._count, *scan, odometry, pose)
            self._count += 1

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

    def _scan(self, stamp: float, data: Any) -> tuple[LaserScan, Transform2D] | None:
        """Return the scan with the pose of its sensor; None, with a problem, if that is not known."""
        topics, topic = self._topics, self._topics.scan
        try:
            frame = ros.frame_of(data)
            mounting = self._frames.mounting(frame)
            upside_down = mounting.tilt > 0.5 * math.pi
            tilt = math.pi - mounting.tilt if upside_down else mounting.tilt
            if tilt > LEVEL:
                self._log.problem(
                    f'{topic}: "{frame}" is tilted by {tilt:.2f} rad; its scans are used as if it was level'
                )
            fields = self._fields.get(topic)
            scan = ros.scan_of(
                data, topic.strip("/"), stamp, height=mounting.height, upside_down=upside_down, fields=fields
            )
        except NavError as exc:
            self._log.problem(f"{topic}: {exc.message}")
            return None
        try:
            return scan, self._tree.lookup(topics.base, frame, stamp, math.inf)
        except NavError:
            raise LogError(
                f'{self._log.path} does not say where "{frame}", the frame of {topic}, is on "{topics.base}"; give it with '
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
