"""Contacts and why a robot touched an obstacle: from its motion, its commands and what it saw before.

What moves can touch a robot by its own motion. A contact is the robot's if it sent a command that was worse than a stop although
it saw the obstacle: `UNEXPLAINED`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from navstack.core import Footprint, LaserScan, Pose2D, Transform2D, Twist2D
from navstack.local_planner import control_period
from navstack.scenario import Run
from navstack.sim import Collision, Solids

MIN_POINTS: Final = 2
"""Points of a scan that make an obstacle seen."""
SEEN_M: Final = 0.03
"""Points of a scan at most this far from an obstacle are its points."""
_STEP_S: Final = 0.01
_STANDING_M_S: Final = 0.01
_OVERLAP_ROUNDING_M2: Final = 1e-6
"""Overlaps that differ by less are equal: 1 mm of a corner."""

Cause = Literal[
    "it moved into the standing robot",
    "seen too late",
    "not in view",
    "it moved into the way",
    "unexplained",
]
UNEXPLAINED: Final[Cause] = "unexplained"
"""The cause that is left: a stop would have been better."""


@dataclass(frozen=True, slots=True)
class Braking:
    """How a robot stops."""

    footprint: Footprint
    turns: bool
    """False for a round robot, whose outline does not turn with it."""
    holonomic: bool
    max_decel: tuple[float, float, float]
    """m/s², rad/s²; inf without a limit."""
    dead_time_s: float
    """Between a command and its effect."""
    period_s: float
    """Between two commands."""

    def outlines(self, moment: Moment, command: Twist2D) -> Iterator[tuple[float, shapely.Polygon]]:
        """Yield time (s) and outline of the robot that follows `command` until the next check and then brakes."""
        x, y, yaw = moment.pose
        velocity = np.array(moment.velocity, np.float64)
        change = np.array(self.max_decel) * _STEP_S
        sent, wanted = np.array(moment.sent_before, np.float64), np.array(command, np.float64)
        if not self.holonomic:
            sent[1] = wanted[1] = 0.0
        free = self.dead_time_s + self.period_s
        t = 0.0
        while True:
            heading = yaw if self.turns else 0.0
            outline = affinity.rotate(self.footprint.polygon, heading, (0.0, 0.0), use_radians=True)
            yield t, affinity.translate(outline, x, y)
            target = sent if t < self.dead_time_s - 1e-9 else wanted if t < free - 1e-9 else np.zeros(3)
            if t >= free - 1e-9 and not velocity.any():
                return
            step = np.clip(target - velocity, -change, change)
            vx, vy, w = (velocity + 0.5 * step).tolist()
            velocity = velocity + step
            c, s = math.cos(yaw + 0.5 * w * _STEP_S), math.sin(yaw + 0.5 * w * _STEP_S)
            x, y, yaw = x + _STEP_S * (c * vx - s * vy), y + _STEP_S * (s * vx + c * vy), yaw + _STEP_S * w
            t += _STEP_S


@dataclass(frozen=True, slots=True)
class Sight:
    """What the newest scan showed."""

    points: NDArray[np.float64]
    """(k, 2) map frame."""
    solids: Solids
    """Where the obstacles were."""


@dataclass(frozen=True, slots=True)
class SeenWall:
    """What a robot touched that stands still, and since when it knew it."""

    shape: shapely.Polygon
    since: float
    """Time (s) of the first scan with a point on it; inf without one."""


class SeenPoints:
    """Where scans had points, in cells of 2 * SEEN_M, and since when."""

    def __init__(self) -> None:
        self._since: dict[tuple[int, int], float] = {}

    def add(self, points: NDArray[np.float64], time: float) -> None:
        """Add the points (k, 2) of a scan."""
        cells: NDArray[np.int64] = np.unique(np.floor(points / (2.0 * SEEN_M)).astype(np.int64), axis=0)
        for cell in map(tuple, cells.tolist()):
            self._since.setdefault(cell, time)

    def wall(self, shape: shapely.Polygon) -> SeenWall:
        """Return since when a shape that stands still is seen."""
        size = 2.0 * SEEN_M
        low_x, low_y, high_x, high_y = (math.floor(v / size) for v in shape.buffer(SEEN_M).bounds)
        near = (
            since
            for ix in range(low_x, high_x + 1)
            for iy in range(low_y, high_y + 1)
            if (since := self._since.get((ix, iy))) is not None
            and shape.distance(shapely.Point((ix + 0.5) * size, (iy + 0.5) * size)) <= size
        )
        return SeenWall(shape, min(near, default=math.inf))


@dataclass(frozen=True, slots=True)
class Moment:
    """The state at a check: a cycle in which a command is sent."""

    time: float
    pose: Pose2D
    velocity: Twist2D
    sent_before: Twist2D
    sent: Twist2D
    solids: Solids
    sight: Sight


def cause_of(robot: Braking, moments: Sequence[Moment], collision: Collision, wall: SeenWall | None = None) -> Cause:
    """Return why the robot touched the obstacle; `moments` are the checks before it, at least one, oldest first.

    `wall`: what it touched of the map, if it touched that; what stands still and was seen once is known.
    """
    last = moments[-1]
    if max(_fastest(robot, last.velocity), _fastest(robot, last.sent_before)) < _STANDING_M_S:
        return "it moved into the standing robot"
    if wall is not None:
        return _cause_by_wall(robot, moments, wall)
    seen = next((m for m in moments if _is_seen(m, collision)), None)
    if seen is None or not _can_stop(robot, seen, moments, collision):
        return "seen too late"
    return _cause_by_checks(robot, moments, collision)


def is_worse_than_stop(robot: Braking, moment: Moment, obstacle: shapely.Polygon) -> bool:
    """Return True if a stop would have touched the obstacle later or not at all, or would have overlapped it less."""
    if moment.sent == Twist2D():
        return False
    sent, stop = (list(robot.outlines(moment, command)) for command in (moment.sent, Twist2D()))
    first = [next((t for t, body in way if body.intersects(obstacle)), math.inf) for way in (sent, stop)]
    if first[0] > 0.0:
        return first[0] < first[1] - 1e-9
    # the next check can change what comes after it
    k = round((robot.dead_time_s + robot.period_s) / _STEP_S)
    overlaps = [way[min(k, len(way) - 1)][1].intersection(obstacle).area for way in (sent, stop)]
    return overlaps[0] > overlaps[1] + _OVERLAP_ROUNDING_M2


def sight_of(scan: LaserScan | None, sensor: Pose2D, solids: Solids) -> Sight:
    """Return what a scan showed that was measured at the pose `sensor` (map frame)."""
    if scan is None:
        return Sight(np.empty((0, 2)), solids)
    ranges = np.asarray(scan.ranges, np.float64)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    hit = np.isfinite(ranges) & (ranges <= scan.range_max)
    points = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))[hit]
    return Sight(Transform2D(*sensor).apply_points(points), solids)


def _fastest(robot: Braking, velocity: Twist2D) -> float:
    return velocity.speed + abs(velocity.wz) * robot.footprint.circumscribed_radius


def _cause_by_wall(robot: Braking, moments: Sequence[Moment], wall: SeenWall) -> Cause:
    """Return whether the robot could know what stands there, in time for a stop."""
    seen = next((m for m in moments if m.time >= wall.since - 1e-9), None)
    if seen is None:
        return "not in view"
    if seen is not moments[0] and any(body.intersects(wall.shape) for _, body in robot.outlines(seen, Twist2D())):
        return "seen too late"
    return UNEXPLAINED


def _cause_by_checks(robot: Braking, moments: Sequence[Moment], collision: Collision) -> Cause:
    """Compare the checks with what can be guaranteed: nothing is touched that is seen and stays where it is.

    Go back to the last check at which the robot would not have touched the obstacle. If the obstacle then moved, what was sent
    at all later checks must have been no worse than a stop, as far as the robot saw the obstacle.
    """
    after: Moment | None = None
    for moment in reversed(moments):
        there = _obstacle(moment.solids, collision)
        if not any(body.intersects(there) for _, body in robot.outlines(moment, moment.sent)):
            if after is None or there.symmetric_difference(_obstacle(after.solids, collision)).area > 1e-9:
                return "it moved into the way"
            return UNEXPLAINED
        if is_worse_than_stop(robot, moment, there):
            return UNEXPLAINED if _is_seen(moment, collision) else "not in view"
        after = moment
    return UNEXPLAINED


def _is_seen(moment: Moment, collision: Collision) -> bool:
    shape = _obstacle(moment.sight.solids, collision)
    near = shapely.dwithin(shape, shapely.points(moment.sight.points), SEEN_M)
    return int(near.sum()) >= MIN_POINTS


def touched_cell(collision: Collision, resolution: float) -> shapely.Polygon:
    """Return the cell of the map that the robot touched; `resolution` in meters."""
    return shapely.Point(collision.at).buffer(0.5 * resolution, cap_style="square")


def _obstacle(solids: Solids, collision: Collision) -> shapely.Polygon:
    if collision.kind == "disc":
        x, y, radius = solids.discs[collision.index].tolist()
        return shapely.Point(x, y).buffer(radius, quad_segs=32)
    return shapely.Polygon(solids.polygon(collision.index))


def _can_stop(robot: Braking, seen: Moment, moments: Sequence[Moment], collision: Collision) -> bool:
    """Return True if a robot that stops as soon as it sees the obstacle does not touch it, which moves on meanwhile."""
    times = np.array([m.time for m in moments])
    for t, body in robot.outlines(seen, Twist2D()):
        at = int(np.searchsorted(times, seen.time + t + 1e-9, side="right")) - 1
        if body.intersects(_obstacle(moments[at].solids, collision)):
            return False
    return True


# --- the contacts of a run --------------------------------------------------------------------------------------------


_REMEMBERED_S: Final = 3.0
"""Longer than any robot here takes to stop."""


class ContactWatch:
    """Keeps the last seconds of a run, and finds the cause of each contact. Call `look` after every step."""

    def __init__(self, run: Run) -> None:
        self.causes: list[Cause] = []
        """The cause of each contact of the robot, oldest first."""
        self._run = run
        robot = run.robot
        lidars = [robot.params.lidar(name) for name in robot.params.lasers]
        self._mounts = {lidar.frame: Pose2D(lidar.x, lidar.y, lidar.yaw) for lidar in lidars}
        self._braking = _braking(run)
        self._moments: deque[Moment] = deque()
        self._sight = sight_of(None, robot.pose, robot.solids)
        self._seen = SeenPoints()
        self._sent = Twist2D()

    def look(self) -> None:
        """Find the causes of the new contacts; remember the current state if a command was sent, or none was due."""
        robot, tick = self._run.robot, self._run.move_base.last_tick
        for collision in robot.collisions[len(self.causes) :]:
            before = [m for m in self._moments if m.time < collision.time - 1e-9]
            wall = self._wall(collision)
            self.causes.append(cause_of(self._braking, before, collision, wall) if before else UNEXPLAINED)
        scan = next((s for s in reversed(tick.scans) if isinstance(s, LaserScan) and s.frame in self._mounts), None)
        if scan is not None:
            sensor = Transform2D(*robot.pose).apply(self._mounts[scan.frame])
            self._sight = sight_of(scan, sensor, robot.solids)
            self._seen.add(self._sight.points, robot.time)
        sent, now = self._run.move_base.command, robot.time
        if tick.command is None and self._moments and now < self._moments[-1].time + self._braking.period_s - 1e-9:
            return  # the costmaps or the planner were due: the command before holds on
        moment = Moment(now, robot.pose, robot.state().velocity, self._sent, sent, robot.solids, self._sight)
        self._sent = sent
        self._moments.append(moment)
        while self._moments[0].time < now - _REMEMBERED_S:
            self._moments.popleft()

    def _wall(self, collision: Collision) -> SeenWall | None:
        """Return what the robot touched if it stands still; None for what moves."""
        robot = self._run.robot
        if collision.kind == "map":
            return self._seen.wall(touched_cell(collision, self._run.scenario.map.geometry.resolution))
        return None if robot.world.moves else self._seen.wall(_obstacle(robot.solids, collision))


def _braking(run: Run) -> Braking:
    """Return how the robot of a run stops: within the accelerations of its controller."""
    robot, controller = run.robot, run.move_base.local_planner
    limits = controller.limits
    x, y, w = (a if a > 0.0 else math.inf for a in (limits.acc_lim_x, limits.acc_lim_y, limits.acc_lim_theta))
    period = control_period(run.scenario.configuration.move_base.controller_frequency)
    return Braking(
        robot.footprint,
        not robot.footprint.is_round,
        robot.params.kinematics == "holonomic",
        (x, y, w),
        robot.params.command_delay,
        period,
    )
