"""Condition nodes of Nav2. Source of the rules: nav2_behavior_tree/plugins/condition."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np

from navstack.behavior_trees.blackboard import Port, StampedPose, inputs
from navstack.behavior_trees.nodes import FAILURE, IDLE, SUCCESS, Condition, GoalWatch, Status, node
from navstack.core import Path, angle_between

NANO: Final = 1_000_000_000
_FRAMES: Final = inputs(global_frame="string", robot_base_frame="string")


def _result(true: bool) -> Status:
    return SUCCESS if true else FAILURE


class _GoalCondition(Condition):
    PORTS = inputs(goal="pose", goals="poses")

    __slots__ = ("goals",)

    goals: GoalWatch

    def setup(self) -> None:
        """Connect to the goals."""
        self.goals = GoalWatch(self)


@node("GoalUpdated")
class GoalUpdated(_GoalCondition):
    """SUCCESS if the goal has changed since the last tick; FAILURE in the first tick after a reset."""

    def tick(self) -> Status:
        """Compare the goals."""
        changed = self.goals.changed()
        return _result(changed and self.status is not IDLE)


@node("GlobalUpdatedGoal")
class GlobalUpdatedGoal(_GoalCondition):
    """SUCCESS in the first tick of all and when the goal has changed; a reset changes nothing."""

    __slots__ = ("first",)

    def __init__(self) -> None:
        super().__init__()
        self.first = True

    def tick(self) -> Status:
        """Compare the goals."""
        changed = self.goals.changed() or self.first
        self.first = False
        return _result(changed)


@node("InitialPoseReceived", ports=inputs(initial_pose_received="bool"))
class InitialPoseReceived(Condition):
    """SUCCESS if the port, or the entry of its name, is true."""

    def tick(self) -> Status:
        """Read the entry."""
        value = self.get("initial_pose_received")
        return _result(bool(self.blackboard.get("initial_pose_received") if value is None else value))


@node("IsStuck")
class IsStuck(Condition):
    """SUCCESS if the robot brakes harder than 10 m/s2, between the last two ticks with new odometry."""

    __slots__ = ("history",)

    LIMIT = -10.0

    def __init__(self) -> None:
        super().__init__()
        self.history: deque[tuple[int, float]] = deque(maxlen=3)

    def tick(self) -> Status:
        """Compare the velocities."""
        history, now = self.history, self.tree.now_ns
        if not history or history[-1][0] != now:
            history.append((now, self.tree.servers.velocity().vx))
        if len(history) < 3:
            return FAILURE
        (before, v0), (after, v1) = history[-2], history[-1]
        return _result((v1 - v0) / ((after - before) / NANO) < self.LIMIT)


@node("TimeExpired", ports=inputs(seconds=("double", "1.0")))
class TimeExpired(Condition):
    """SUCCESS every `seconds`; FAILURE in the first tick after a reset."""

    __slots__ = ("period", "start")

    def __init__(self) -> None:
        super().__init__()
        self.start = 0
        self.period = 1.0

    def tick(self) -> Status:
        """Compare the time."""
        now = self.tree.now_ns
        if self.status is IDLE:
            self.period = self.number("seconds", 1.0)
            self.start = now
            return FAILURE
        if (now - self.start) / NANO < self.period:
            return FAILURE
        self.start = now
        return SUCCESS


@node("PathExpiringTimer", ports=inputs(seconds=("double", "1.0"), path="path"))
class PathExpiringTimer(Condition):
    """SUCCESS if the path is the same for `seconds`; a new path starts the time again, a reset does not."""

    __slots__ = ("path_now", "period", "start")

    def __init__(self) -> None:
        super().__init__()
        self.start: int | None = None
        self.period = 1.0
        self.path_now: object = None

    def tick(self) -> Status:
        """Compare path and time."""
        now, path = self.tree.now_ns, self.get("path")
        if self.start is None:
            self.period = self.number("seconds", 1.0)
            self.path_now, self.start = path, now
            return FAILURE
        if path is not self.path_now:
            self.path_now, self.start = path, now
        if (now - self.start) / NANO < self.period:
            return FAILURE
        self.start = now
        return SUCCESS


@node("DistanceTraveled", ports=(*inputs(distance=("double", "1.0")), *_FRAMES))
class DistanceTraveled(Condition):
    """SUCCESS each time the robot is `distance` (m) from where it was last; FAILURE in the first tick after a reset."""

    __slots__ = ("start",)

    def __init__(self) -> None:
        super().__init__()
        self.start: StampedPose | None = None

    def tick(self) -> Status:
        """Compare the poses."""
        pose = self.tree.robot_pose(self.text("global_frame"), self.text("robot_base_frame"))
        if self.status is IDLE or self.start is None:
            self.start = pose
            return FAILURE
        if pose is None or math.hypot(pose.x - self.start.x, pose.y - self.start.y) < self.number("distance", 1.0):
            return FAILURE
        self.start = pose
        return SUCCESS


class _Battery(Condition):
    PORTS = inputs(battery_topic=("string", "/battery_status"))

    def reading(self, name: str) -> float | None:
        """Return a value of the last message of the topic, a mapping with `percentage`, `voltage` and `charging`."""
        message = self.tree.topics.get(self.text("battery_topic"))
        value = message.get(name) if isinstance(message, dict) else None  # pyright: ignore[reportUnknownMemberType,reportUnknownVariableType]
        return float(value) if isinstance(value, (int, float)) else None


@node("IsBatteryLow", ports=inputs(min_battery="double!", is_voltage=("bool", "false")))
class IsBatteryLow(_Battery):
    """SUCCESS if the percentage (0 to 1), or the voltage, is at most `min_battery`; FAILURE before the first message."""

    def tick(self) -> Status:
        """Compare the reading."""
        value = self.reading("voltage" if self.flag("is_voltage") else "percentage")
        return _result(value is not None and value <= self.number("min_battery"))


@node("IsBatteryCharging")
class IsBatteryCharging(_Battery):
    """SUCCESS while the battery is charging."""

    def tick(self) -> Status:
        """Read the topic."""
        return _result(bool(self.reading("charging")))


@node("TransformAvailable", ports=inputs(child="string!", parent="string!"))
class TransformAvailable(Condition):
    """SUCCESS once the transform between two frames is known, and from then on."""

    __slots__ = ("found",)

    def __init__(self) -> None:
        super().__init__()
        self.found = False

    def tick(self) -> Status:
        """Ask for the transform."""
        child, parent = self.text("child"), self.text("parent")
        if not child or not parent:
            raise self.failure('a frame is empty; write child=".." and parent=".."')
        self.found = self.found or self.tree.servers.can_transform(child, parent)
        return _result(self.found)


@node("GoalReached", ports=inputs(goal="pose!", robot_base_frame="string"))
class GoalReached(Condition):
    """SUCCESS if the robot is within the parameter `goal_reached_tol` (0.25 m) of the goal."""

    def tick(self) -> Status:
        """Compare the poses."""
        goal = self.get("goal")
        if not isinstance(goal, StampedPose):
            return FAILURE
        pose = self.tree.robot_pose(goal.frame, self.text("robot_base_frame"))
        if pose is None:
            return FAILURE
        tolerance = self.tree.servers.parameter("goal_reached_tol", 0.25)
        return _result(_squared(pose, goal) <= tolerance * tolerance)


def _squared(a: StampedPose, b: StampedPose) -> float:
    dx, dy = a.x - b.x, a.y - b.y
    return dx * dx + dy * dy


@node(
    "ArePosesNear",
    ports=inputs(ref_pose="pose!", target_pose="pose!", global_frame="string", tolerance=("double", "0.5")),
)
class ArePosesNear(Condition):
    """SUCCESS if two poses are within `tolerance` (m). Poses in two frames are far from each other."""

    def tick(self) -> Status:
        """Compare the poses."""
        first, second = self.get("ref_pose"), self.get("target_pose")
        if not isinstance(first, StampedPose) or not isinstance(second, StampedPose) or first.frame != second.frame:
            return FAILURE
        tolerance = self.number("tolerance", 0.5)
        return _result(_squared(first, second) <= tolerance * tolerance)


def end_within(path: Path, begin: int, distance: float) -> int:
    """Return the index after the first pose further than `distance` (m) along the path from pose `begin`."""
    poses = path.poses[begin:]
    if len(poses) < 2 or not math.isfinite(distance):
        return len(path)
    driven = np.cumsum(np.hypot(np.diff(poses[:, 0]), np.diff(poses[:, 1])))
    beyond = np.flatnonzero(driven > distance)
    return begin + int(beyond[0]) + 1 if len(beyond) else len(path)


class NearestPose:
    """The pose of a path that is nearest to the robot. On the same path, a limited search begins at the pose found last."""

    __slots__ = ("_begin", "_path")

    def __init__(self) -> None:
        self._begin = 0
        self._path: Path | None = None

    def find(self, path: Path, pose: StampedPose, search: float | None, angular_weight: float = 0.0) -> int:
        """Return its index.

        `search`: length of the path that is searched (m), None for the whole path; `angular_weight` (m/rad) of the difference
        of the headings in the distance.
        """
        if search is None or path is not self._path:
            self._path, self._begin = path, 0
        end = len(path) if search is None else max(end_within(path, self._begin, search), self._begin + 1)
        near = path.poses[self._begin : end]
        distances = np.hypot(near[:, 0] - pose.x, near[:, 1] - pose.y)
        if angular_weight:
            turns = np.array([angle_between(pose.yaw, float(yaw)) for yaw in near[:, 2]])
            distances = np.hypot(distances, angular_weight * turns)
        self._begin += int(np.argmin(distances))
        return self._begin


@node(
    "IsGoalNearby",
    ports=(
        *inputs(path="path!", proximity_threshold=("double", "1.0"), max_robot_pose_search_dist=("double", "-1.0")),
        *_FRAMES,
    ),
)
class IsGoalNearby(Condition):
    """SUCCESS if the rest of the path, from its pose nearest to the robot, is shorter than `proximity_threshold` (m)."""

    __slots__ = ("nearest",)

    def __init__(self) -> None:
        super().__init__()
        self.nearest = NearestPose()

    def tick(self) -> Status:
        """Measure the rest of the path."""
        path = self.get("path")
        if not isinstance(path, Path) or not len(path):
            return FAILURE
        search = self.number("max_robot_pose_search_dist", -1.0)
        pose = self.tree.robot_pose(path.frame, self.text("robot_base_frame"))
        if pose is None:
            return FAILURE
        rest = path.poses[self.nearest.find(path, pose, search if search >= 0.0 else None) :]
        length = float(np.hypot(np.diff(rest[:, 0]), np.diff(rest[:, 1])).sum())
        return _result(length < self.number("proximity_threshold", 1.0))


@node(
    "IsWithinPathTrackingBounds",
    ports=inputs(
        max_error_left=("double", "0.5"),
        max_error_right=("double", "0.5"),
        max_error_heading=("double", "3.14"),
        tracking_feedback="tracking_feedback!",
    ),
)
class IsWithinPathTrackingBounds(Condition):
    """SUCCESS while the controller's tracking error is within bounds, and before its first feedback."""

    def tick(self) -> Status:
        """Compare the errors."""
        feedback = self.get("tracking_feedback")
        if not isinstance(feedback, TrackingFeedback):
            return SUCCESS
        position = feedback.position_error
        side = self.number("max_error_left" if position >= 0.0 else "max_error_right", 0.5)
        heading = abs(self.number("max_error_heading", 3.14))
        return _result(abs(position) <= abs(side) and abs(feedback.heading_error) <= heading)


class TrackingFeedback(tuple[float, float]):
    """Errors of a controller: position (m, positive to the left of the path) and heading (rad)."""

    __slots__ = ()

    def __new__(cls, position_error: float = 0.0, heading_error: float = 0.0) -> TrackingFeedback:
        """Make a feedback."""
        return super().__new__(cls, (position_error, heading_error))

    @property
    def position_error(self) -> float:
        """Distance from the path (m), positive to its left."""
        return self[0]

    @property
    def heading_error(self) -> float:
        """Difference to the heading of the path (rad)."""
        return self[1]


@node("AreErrorCodesPresent")
class AreErrorCodesPresent(Condition):
    """SUCCESS if the code is one of `error_codes_to_check`."""

    PORTS = (Port("error_code", "unsigned", required=True), Port("error_codes_to_check", "ints"))

    CODES: tuple[int, ...] = ()

    __slots__ = ("codes",)

    def setup(self) -> None:
        """Read the codes, once."""
        given = self.get("error_codes_to_check")
        self.codes = frozenset(self.CODES or (given if isinstance(given, list) else ()))

    def tick(self) -> Status:
        """Compare the code."""
        return _result(self.get("error_code") in self.codes)


@node("WouldAControllerRecoveryHelp")
class WouldAControllerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS if clearing or moving may help the controller: unknown error, patience, progress, no valid control."""

    CODES = (100, 104, 105, 106)


@node("WouldAPlannerRecoveryHelp")
class WouldAPlannerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS if clearing or moving may help the planner: unknown error, no valid path, time-out."""

    CODES = (200, 207, 208, 300, 307, 308)


@node("WouldASmootherRecoveryHelp")
class WouldASmootherRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS if a recovery may help the smoother."""

    CODES = (500, 502, 503, 504)


@node("WouldARouteRecoveryHelp")
class WouldARouteRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS if a recovery may help the route server: unknown error, time-out, no valid route."""

    CODES = (400, 404, 405)
