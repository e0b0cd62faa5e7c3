"""Passes the messages of a log to a robot: transforms, odometry, sensor data, recorded commands and plans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import PointCloud, RobotState, Transform2D
from navstack.core.errors import FrameError, LogError
from navstack.logs import LogMessage
from navstack.logs import messages as ros
from navstack.logs.messages import Clock
from navstack.logs.transforms import LEVEL, LoggedFrames
from navstack.replay.logged_robot import LoggedRobot
from navstack.replay.topics import Topics

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
        self.frames = LoggedFrames(robot.frames)
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
                self.robot.recorded = ros.command_of(message)
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
            points = np.ascontiguousarray(mounting.levelled(ros.points_of(data)))
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
