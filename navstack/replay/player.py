"""Passes the messages of a log to a robot: transforms, odometry, sensor data, recorded commands and plans."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    FrameError,
    FrameTree,
    GridGeometry,
    LogError,
    NavError,
    OccupancyGrid,
    PointCloud,
    Pose2D,
    RobotState,
    SensorData,
    Transform2D,
    Twist2D,
    clean_frame,
)
from navstack.logs import CLOCKS_DIFFER_S, LOOK_AHEAD_S, Log, LogMessage, first_odometry, first_parents
from navstack.move_base import StaleOdometryError
from navstack.parameters import Configuration, SimParams
from navstack.replay.topics import Topics, find_topics
from navstack.ros_messages import (
    LEVEL,
    NS_PER_S,
    Clock,
    StampedTransform,
    Transform3D,
    TransformTree,
    quaternion_of_yaw,
    seconds,
)
from navstack.ros_messages import messages as ros

# --- a robot whose sensor data and odometry come from a log; its motion is recorded, so commands have no effect --------


class LoggedRobot:
    """Implements `navstack.plugins.Robot`; the player of a log fills it."""

    def __init__(self) -> None:
        self.frames = FrameTree()
        self.odometry: RobotState | None = None
        """The newest odometry."""
        self.true_pose: Pose2D | None = None
        """The newest true pose (map frame), if the log has it."""
        self.requested = Twist2D()
        """The newest command of navstack, which has no effect."""
        self.recorded: Twist2D | None = None
        """The newest command in the log."""
        self._scans: list[SensorData] = []

    def add_scan(self, data: SensorData) -> None:
        """Add sensor data, for the next call of `scans`."""
        self._scans.append(data)

    def state(self) -> RobotState:
        """Return the newest odometry. Raises StaleOdometryError before the first one."""
        if self.odometry is None:
            raise StaleOdometryError("no odometry has been received; check the log's topic of odometry")
        return self.odometry

    def scans(self) -> Sequence[SensorData]:
        """Return the sensor data since the last call, in the order of the log."""
        found, self._scans = self._scans, []
        return found

    def command(self, twist: Twist2D) -> None:
        """Keep a command; it has no effect."""
        self.requested = twist

    def pose_in(self, frame: str, base_frame: str) -> Pose2D | None:
        """Return the newest pose of the robot in `frame`; None if it is not known."""
        try:
            return Pose2D(*self.frames.lookup(frame, base_frame))
        except NavError:
            return None


MAX_PROBLEMS: Final = 100
"""Largest number of different problems that are kept."""
GAP_FACTOR: Final = 4.0
"""A topic is silent after this many times its mean period without a message."""


@dataclass(slots=True)
class RecordedPath:
    """A plan in the log."""

    time: float
    frame: str
    poses: NDArray[np.float64]
    """(n, 3) x, y, yaw."""


@dataclass(slots=True)
class Silence:
    """A time without messages on a topic."""

    topic: str
    start: float
    """s"""
    duration: float
    """s"""


@dataclass(slots=True)
class _Rate:
    """Statistics of one topic."""

    count: int = 0
    first: float = 0.0
    last: float = 0.0
    silences: list[Silence] = field(default_factory=list[Silence])


class Player:
    """Feeds a `LoggedRobot`. `problems` counts messages that could not be used, by reason."""

    def __init__(
        self, robot: LoggedRobot, topics: Topics, clock: Clock, *, base_frame: str, periods: Mapping[str, float]
    ) -> None:
        """`periods`: mean time (s) between two messages by topic, for silences."""
        self.robot = robot
        self.clock = clock
        self.frames = TransformTree(robot.frames)
        self.problems: dict[str, int] = {}
        self._plans: list[RecordedPath] = []
        self.late_transforms = 0
        """Number of transforms that arrived more than 0.1 s after their stamp."""
        self._topics = topics
        self._base_frame = base_frame
        self._periods = periods
        self._rates: dict[str, _Rate] = {}
        self._tilted: set[str] = set()
        self._scan_fields: dict[str, ros.ScanFields] = {}
        self._range_fields: dict[str, ros.RangeFields] = {}
        self.derives_odometry_frame = not any(topic == "/tf" for topic in topics.transforms)
        """True if the log has no /tf: the pose of the odometry then is the transform odom -> base."""

    @property
    def frames_topics(self) -> tuple[str, ...]:
        """The topics of transforms."""
        return self._topics.transforms

    @property
    def sensor_topics(self) -> tuple[str, ...]:
        """The topics of sensors, as the log names them."""
        return tuple(self._topics.sensors)

    @property
    def odometry_topic(self) -> str:
        """The topic of the odometry; empty if there is none."""
        return self._topics.odometry

    def sensor_name(self, topic: str) -> str:
        """Return the name that the parameters have for a topic of a sensor."""
        return self._topics.sensors[topic].name

    @property
    def silences(self) -> list[Silence]:
        """Times without sensor data or odometry, ordered by their start."""
        return sorted((s for rate in self._rates.values() for s in rate.silences), key=lambda silence: silence.start)

    def take_plans(self) -> list[RecordedPath]:
        """Return the plans of the log since the last call."""
        found, self._plans = self._plans, []
        return found

    def play(self, message: LogMessage) -> None:
        """Pass on one message; one that is not valid is counted in `problems`."""
        topic = message.topic
        try:
            if topic in self._topics.sensors:
                self._note_rate(topic, self.clock.time(message.time_ns))
                self._sensor(topic, message)
            elif topic in self._topics.transforms:
                self._transforms(topic, message)
            elif topic == self._topics.odometry:
                self._note_rate(topic, self.clock.time(message.time_ns))
                self._odometry(message)
            elif topic == self._topics.commands:
                self.robot.recorded = ros.command_of(message.data, message.type)
            elif topic in self._topics.plans:
                frame, poses = ros.path_of(message.data)
                self._plans.append(RecordedPath(self.clock.time(message.time_ns), frame, poses))
            elif topic == ros.EXPORTED_SENSORS:
                self._scan_fields, self._range_fields = ros.sensor_fields_of(message.data)
            elif topic == self._topics.truth:
                self.robot.true_pose = ros.odometry_of(message.data, self.clock).pose
        except (LogError, FrameError) as exc:
            self._problem(f"{topic}: {exc.message}")

    def _problem(self, text: str) -> None:
        if text in self.problems or len(self.problems) < MAX_PROBLEMS:
            self.problems[text] = self.problems.get(text, 0) + 1

    def _note_rate(self, topic: str, now: float) -> None:
        rate = self._rates.setdefault(topic, _Rate(first=now, last=now))
        gap, period = now - rate.last, self._periods.get(topic, 0.0)
        if rate.count and period > 0.0 and gap > max(GAP_FACTOR * period, 0.2):
            rate.silences.append(Silence(topic, rate.last, gap))
        rate.count, rate.last = rate.count + 1, now

    def _transforms(self, topic: str, message: LogMessage) -> None:
        found = ros.transforms_of(message.data, self.clock)
        if topic == "/tf_static":
            self.frames.add_static(found)
            return
        now = self.clock.time(message.time_ns)
        self.late_transforms += sum(now - item.stamp > 0.1 for item in found)
        self.frames.add(found)

    def _odometry(self, message: LogMessage) -> None:
        found = ros.odometry_of(message.data, self.clock)
        self.robot.odometry = RobotState(found.pose, found.velocity, found.stamp, found.frame)
        if self.derives_odometry_frame:
            child = found.child or self._base_frame
            self.robot.frames.set(found.frame, child, Transform2D(*found.pose), found.stamp)
            self.frames.parents[child] = found.frame

    def _sensor(self, topic: str, message: LogMessage) -> None:
        data: Any = message.data
        sensor = self._topics.sensors[topic]
        stamp = self.clock.stamp(data)
        if sensor.type == ros.RANGE:
            fields = self._range_fields.get(ros.frame_of(data))
            self.robot.add_scan(ros.range_of(data, sensor.name, stamp, fields))
            return
        frame = ros.frame_of(data)
        mounting = self.frames.mounting(frame)
        if sensor.type in ros.CLOUDS:
            points = np.ascontiguousarray(mounting.leveled(ros.points_of(data)))
            self.robot.add_scan(PointCloud(points, stamp, frame, sensor.name))
            return
        upside_down = mounting.tilt > 1.5707963267948966
        tilt = 3.141592653589793 - mounting.tilt if upside_down else mounting.tilt
        if tilt > LEVEL and frame not in self._tilted:
            self._tilted.add(frame)
            self._problem(f'{topic}: "{frame}" is tilted by {tilt:.2f} rad; its scans are used as if it was level')
        fields = self._scan_fields.get(topic)
        scan = ros.scan_of(data, sensor.name, stamp, height=mounting.height, upside_down=upside_down, fields=fields)
        self.robot.add_scan(scan)


# --- before the first cycle: the clock, the first transforms, the map, where the robot is -----------------------------


LOOK_BACK_S: Final = 10.0
"""The last poses are known from this much of a log (s)."""
FREE_EXTENT_M: Final = 40.0
"""Width and height of the map of a robot without a map (m)."""


def find_clock(log: Log, topics: Topics) -> tuple[Clock, str]:
    """Return the clock of a log, and a note if the stamps belong to another clock than the times of the recording."""
    shifts: list[int] = []
    for message in log.messages(topics.used, end=LOOK_AHEAD_S):
        if message.topic not in (topics.odometry, *topics.sensors):
            continue
        with suppress(LogError):
            shifts.append(message.time_ns - ros.header_ns(message.data))
        if len(shifts) >= 50:
            break
    shift = round(median(shifts)) if shifts else 0
    if abs(shift) < CLOCKS_DIFFER_S * NS_PER_S:
        return Clock(log.start_ns), ""
    return Clock(log.start_ns, shift), (
        f"the stamps of the messages differ from the times of the recording by {seconds(shift):.0f} s (a simulation recorded "
        "with wall time?); they are shifted by the median difference of the first messages"
    )


def periods_of(log: Log, topics: Topics) -> dict[str, float]:
    """Return the mean time (s) between two messages of the topics of sensors and odometry."""
    counts = {channel.topic: channel.count for channel in log.channels}
    return {
        topic: log.duration / counts[topic]
        for topic in (topics.odometry, *topics.sensors)
        if topic and counts.get(topic, 0) > 1
    }


def first_transforms(
    log: Log, player: Player, configuration: Configuration, mountings: Mapping[str, tuple[str, tuple[float, ...]]]
) -> list[str]:
    """Add the static transforms, those of `mountings` and those of sensors that only the parameters describe; return notes.

    Static transforms are valid at all times, so all of them are read before the first cycle.
    """
    if "/tf_static" in player.frames_topics:
        for message in log.messages(["/tf_static"]):
            player.play(message)
    for frame, (parent, (x, y, z, yaw)) in mountings.items():
        transform = Transform3D(x, y, z, quaternion_of_yaw(yaw))
        player.frames.add_static([StampedTransform(clean_frame(parent), clean_frame(frame), 0.0, transform)])
    known = {*first_parents(log, ("/tf",)), *player.frames.parents}
    base = configuration.local_costmap.params.robot_base_frame
    notes: list[str] = []
    for topic, frame in _sensor_frames(log, player).items():
        if frame in known or frame == base:
            continue
        lidar = _lidar(configuration.navstack.sim, player.sensor_name(topic), frame)
        if lidar is None:
            notes.append(
                f'the frame "{frame}" of {topic} is not in the log, so its messages are not used; give its pose with '
                f"--mount {frame}=x,y,z,yaw"
            )
            continue
        transform = Transform3D(lidar.x, lidar.y, lidar.height, quaternion_of_yaw(lidar.yaw))
        player.frames.add_static([StampedTransform(base, frame, 0.0, transform)])
        notes.append(
            f'the frame "{frame}" of {topic} is not in the log; its pose on {base} is that of the simulated lidar: '
            f"x {lidar.x:g}, y {lidar.y:g}, z {lidar.height:g} m, yaw {lidar.yaw:g} rad; another one: --mount "
            f"{frame}=x,y,z,yaw"
        )
    return notes


def _sensor_frames(log: Log, player: Player) -> dict[str, str]:
    """Return the frame of the first message of each topic of a sensor."""
    found: dict[str, str] = {}
    wanted = set(player.sensor_topics)
    if wanted:
        for message in log.messages(sorted(wanted), end=LOOK_AHEAD_S):
            if message.topic not in found:
                try:
                    found[message.topic] = ros.frame_of(message.data)
                except LogError:
                    continue
            if len(found) == len(wanted):
                break
    return found


def _lidar(sim: SimParams, topic: str, frame: str) -> Any:
    """Return the simulated lidar with this frame, or, if there is none, of this topic."""
    lidars = [sim.lidar(name) for name in sim.lasers]
    same_frame = [lidar for lidar in lidars if lidar.frame == frame]
    same_topic = [lidar for lidar in lidars if lidar.topic.strip("/") == topic.strip("/")]
    return next(iter(same_frame or same_topic), None)


def place_robot(log: Log, player: Player, configuration: Configuration, initial_pose: Pose2D | None) -> list[str]:
    """Connect the map to the odometry if the log does not; return notes.

    Without messages of the odometry its transform in /tf says where the robot is. Raises LogError for an initial pose in a log
    with a localization.
    """
    map_frame = configuration.global_costmap.params.global_frame
    moving = first_parents(log, ("/tf",))
    parents = {**player.frames.parents, **moving}
    base = root = configuration.local_costmap.params.robot_base_frame
    seen: set[str] = set()
    odometry = first_odometry(log, player.odometry_topic, player.clock) if player.odometry_topic else None
    if player.derives_odometry_frame and odometry is not None:
        parents[odometry.child or root] = odometry.frame
    while root in parents and root not in seen:
        seen.add(root)
        root = parents[root]
    if root == map_frame or map_frame in seen:
        if initial_pose is not None:
            raise LogError(f'the log has a localization ("{map_frame}" is in its tf); leave --initial-pose out')
        return []
    first = Transform2D(*odometry.pose) if odometry is not None else _first_in_tf(log, player, root, base)
    if first is None and initial_pose is None:
        text = (
            f'the log has neither odometry nor a transform from "{root}" to "{map_frame}": the robot\'s pose is unknown'
        )
        return [f"{text}; if it stands, give the pose with --initial-pose x,y,yaw"]
    offset = Transform2D()
    if initial_pose is not None:
        offset = Transform2D(*initial_pose) @ (first or Transform2D()).inverse()
    player.robot.frames.set_static(map_frame, root, offset)
    if initial_pose is not None:
        return [] if first is not None else ["the log does not say how the robot moves: it stands at the initial pose"]
    note = (
        f'the log has no localization (no transform from "{root}" to "{map_frame}"): "{root}" is used as "{map_frame}"; give '
        "the robot's first pose in the map with --initial-pose x,y,yaw"
    )
    return [note]


def _first_in_tf(log: Log, player: Player, root: str, base: str) -> Transform2D | None:
    """Return the first pose of the base in the root of its frames by /tf; None if it is not known."""
    frames = FrameTree()
    tree = TransformTree(frames)
    for topic in ("/tf_static", "/tf"):
        for message in (
            log.messages([topic], end=None if topic == "/tf_static" else LOOK_AHEAD_S) if log.has(topic) else ()
        ):
            with suppress(LogError, FrameError):
                found = ros.transforms_of(message.data, player.clock)
                (tree.add_static if topic == "/tf_static" else tree.add)(found)
            with suppress(FrameError):
                if topic == "/tf" and root != base:
                    return frames.lookup(root, base)
    return None


def logged_map(log: Log, topics: Topics, note: Callable[[str], None] | None = None) -> OccupancyGrid | None:
    """Return the first map of a log; None if it has none. `note` gets what is unusual about it.

    Raises LogError for a map that is not valid.
    """
    if not topics.map:
        return None
    for message in log.messages([topics.map]):
        return ros.map_of(message.data, topics.map, note)
    return None


def empty_map(log: Log, topics: Topics, initial_pose: Pose2D | None, frame: str) -> OccupancyGrid:
    """Return a free map of 40 x 40 m around the first pose of the robot."""
    center = initial_pose
    if center is None and topics.odometry:
        odometry = first_odometry(log, topics.odometry, Clock(log.start_ns))
        center = None if odometry is None else odometry.pose
    center = center or Pose2D(0.0, 0.0)
    cells = round(FREE_EXTENT_M / 0.05)
    x, y = (round(value - 0.5 * FREE_EXTENT_M, 2) for value in (center.x, center.y))
    data = np.zeros((cells, cells), np.int8)
    return OccupancyGrid(data, GridGeometry(cells, cells, 0.05, x, y), 0.0, frame, raw=True)


def last_pose(log: Log, configuration: Configuration, chosen: Mapping[str, str], initial_pose: Pose2D | None) -> Pose2D:
    """Return the pose of the robot in the global frame at the end of a log. Raises LogError if it is not known."""
    topics = find_topics(log, configuration, chosen)
    clock, _ = find_clock(log, topics)
    robot = LoggedRobot()
    base = configuration.local_costmap.params.robot_base_frame
    player = Player(robot, topics, clock, base_frame=base, periods={})
    first_transforms(log, player, configuration, {})
    place_robot(log, player, configuration, initial_pose)
    wanted = [topic for topic in (*topics.transforms, topics.odometry) if topic]
    for message in log.messages(wanted, start=max(0.0, log.duration - LOOK_BACK_S)):
        player.play(message)
    frame = configuration.global_costmap.params.global_frame
    pose = robot.pose_in(frame, base)
    if pose is None:
        raise LogError(
            f'the pose of the robot in "{frame}" is not known at the end of {log.path}; give the goal as x,y,yaw'
        )
    return pose
