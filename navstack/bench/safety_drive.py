"""Drives a scene of the safety search with or without the collision monitor, and explains each contact.

The monitor takes obstacles for static. So it guarantees no contact with a static obstacle that was seen while the robot could
still brake; what moves can touch the robot by its own motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from navstack.bench.safety_scene import (
    DEAD_TIME_S,
    DURATION_S,
    PERIOD_S,
    HostileSource,
    SafetyScene,
    room,
    safety_scene,
)
from navstack.core import LaserScan, Pose2D, Transform2D, Twist2D
from navstack.parameters.models.collision_monitor import CollisionMonitorParams, MonitorSourceParams, ZoneParams
from navstack.safety import CollisionMonitor, CommandChain
from navstack.sim import Collision, SimulatedRobot, World
from navstack.sim.solids import Solids

MIN_POINTS: Final = 2
SEEN_M: Final = 0.03
"""Points of a scan at most this far from an obstacle are its points."""
_STEP_S: Final = 0.01
_STANDING_M_S: Final = 0.01
_OVERLAP_ROUNDING_M2: Final = 1e-6
"""Overlaps that differ by less are equal: 1 mm of a corner."""

Cause = Literal[
    "it moved into the standing robot",
    "seen too late",
    "hidden by another obstacle",
    "it moved into the way",
    "unexplained",
]


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact of the robot with an obstacle."""

    time: float
    obstacle: str
    cause: str
    """`Cause`, or empty without the monitor."""

    def as_dict(self) -> dict[str, Any]:
        """Return the contact for JSON."""
        return {"time": self.time, "obstacle": self.obstacle, "cause": self.cause}


@dataclass(frozen=True, slots=True)
class Moment:
    """The state at a check."""

    time: float
    pose: Pose2D
    velocity: Twist2D
    sent_before: Twist2D
    sent: Twist2D
    solids: Solids
    points: NDArray[np.float64]
    """(k, 2) points of the scan, map frame."""


def build_monitor(scene: SafetyScene, robot: SimulatedRobot) -> CollisionMonitor:
    """Return a monitor with one zone: the footprint with a margin, approach."""
    corners = [list(point) for point in scene.zone().exterior.coords[:-1]]
    x, y, w = scene.robot.max_decel
    params = CollisionMonitorParams(
        polygons=["footprint"],
        observation_sources=["scan"],
        source_timeout=0.5,
        max_decel=[-x, -y, -w],
        reaction_time=DEAD_TIME_S,
        check_frequency=1.0 / PERIOD_S,
        blocks={
            "footprint": ZoneParams(
                action_type="approach", points=str(corners), min_points=MIN_POINTS, time_before_collision=1.0
            ),
            "scan": MonitorSourceParams(),
        },
    )
    return CollisionMonitor(
        params,
        frames=robot.frames,
        base_frame=robot.base_frame,
        odom_frame=robot.odom_frame,
        footprint=scene.robot.footprint,
    )


class SafetyDrive:
    """One drive of a scene."""

    def __init__(self, number: int, *, monitored: bool, log: bool = False) -> None:
        """`log` keeps the moments, which explanations need."""
        self.scene = safety_scene(number)
        world = World(room(), shapes=self.scene.shapes)
        self.robot = SimulatedRobot(self.scene.sim, world, self.scene.robot.footprint, self.scene.start, seed=number)
        monitor = build_monitor(self.scene, self.robot) if monitored else None
        self.chain = CommandChain(self.robot, monitor=monitor)
        self.moments: list[Moment] = []
        self._log = log
        self.moved = 0.0
        """Path length driven (m)."""

    def run(self) -> list[Collision]:
        """Drive for `DURATION_S`; return the contacts."""
        source = HostileSource(self.scene)
        robot, chain = self.robot, self.chain
        sent = Twist2D()
        for k in range(round(DURATION_S / PERIOD_S)):
            now = k * PERIOD_S
            robot.advance_to(now)
            scans = chain.scans()
            before = sent
            chain.send("navigation", source.command(now), now)
            step = chain.tick(now)
            sent = step.sent if step is not None else sent
            if self._log:
                scan = next((s for s in scans if isinstance(s, LaserScan)), None)
                points = _map_points(scan, robot.pose)
                state = robot.state()
                self.moments.append(Moment(now, robot.pose, state.velocity, before, sent, robot.solids, points))
        self.moved = robot.distance_travelled
        return robot.collisions


def explain_contacts(number: int) -> list[Contact]:
    """Drive a scene with the monitor and explain each contact."""
    drive = SafetyDrive(number, monitored=True, log=True)
    return [_explained(drive, collision) for collision in drive.run()]


def contacts_of(drive: SafetyDrive) -> list[Contact]:
    """Drive a scene and return its contacts without explanations."""
    return [Contact(c.time, c.name or c.kind, "") for c in drive.run()]


# --- explanation ------------------------------------------------------------------------------------------------------


def _explained(drive: SafetyDrive, collision: Collision) -> Contact:
    moments = [m for m in drive.moments if m.time < collision.time - 1e-9]
    return Contact(collision.time, collision.name or collision.kind, _cause(drive.scene, moments, collision))


def _fastest(scene: SafetyScene, velocity: Twist2D) -> float:
    return velocity.speed + abs(velocity.wz) * scene.robot.footprint.circumscribed_radius


def _cause(scene: SafetyScene, moments: list[Moment], collision: Collision) -> Cause:
    last = moments[-1]
    if max(_fastest(scene, last.velocity), _fastest(scene, last.sent_before)) < _STANDING_M_S:
        return "it moved into the standing robot"
    if collision.kind == "map":
        return "unexplained"  # walls are always seen
    seen = next((m for m in moments if _is_seen(m, collision)), None)
    if seen is None or not _can_stop(scene, seen, Twist2D(), collision, moments):
        return "seen too late"
    return _cause_by_checks(scene, moments, collision)


def _cause_by_checks(scene: SafetyScene, moments: list[Moment], collision: Collision) -> Cause:
    """Compare the checks with the monitor's guarantee: nothing is touched that is seen and stays where it is.

    Go back to the last check at which the robot would not have touched the obstacle. If the obstacle then moved, what the monitor
    sent at all later checks must have been no worse than a stop, as far as it saw the obstacle.
    """
    after: Moment | None = None
    for moment in reversed(moments):
        there = _obstacle(moment.solids, collision)
        if not _touches(scene, moment, moment.sent, there):
            if after is None or there.symmetric_difference(_obstacle(after.solids, collision)).area > 1e-9:
                return "it moved into the way"
            return "unexplained"
        if is_worse_than_stop(scene, moment, there):
            return "unexplained" if _is_seen(moment, collision) else "hidden by another obstacle"
        after = moment
    return "unexplained"


def _is_seen(moment: Moment, collision: Collision) -> bool:
    shape = _obstacle(moment.solids, collision)
    near = shapely.dwithin(shape, shapely.points(moment.points), SEEN_M)
    return int(near.sum()) >= MIN_POINTS


def _obstacle(solids: Solids, collision: Collision) -> shapely.Polygon:
    if collision.kind == "disc":
        x, y, radius = solids.discs[collision.index].tolist()
        return shapely.Point(x, y).buffer(radius, quad_segs=32)
    return shapely.Polygon(solids.polygon(collision.index))


def _can_stop(scene: SafetyScene, seen: Moment, command: Twist2D, collision: Collision, moments: list[Moment]) -> bool:
    """True if a robot that stops as soon as it sees the obstacle does not touch it on its way, which it moves on meanwhile."""
    at = {round(m.time / PERIOD_S): _obstacle(m.solids, collision) for m in moments}
    newest = max(at)
    for t, body in _braking(scene, seen, command):
        there = at[min(int((seen.time + t) / PERIOD_S + 1e-9), newest)]
        if body.intersects(there):
            return False
    return True


def _touches(scene: SafetyScene, moment: Moment, command: Twist2D, obstacle: shapely.Polygon) -> bool:
    return any(body.intersects(obstacle) for _, body in _braking(scene, moment, command))


def is_worse_than_stop(scene: SafetyScene, moment: Moment, obstacle: shapely.Polygon) -> bool:
    """Return True if a stop would have touched the obstacle later or not at all, or would have overlapped it less."""
    if moment.sent == Twist2D():
        return False
    sent, stop = (list(_braking(scene, moment, command)) for command in (moment.sent, Twist2D()))
    first = [next((t for t, body in way if body.intersects(obstacle)), math.inf) for way in (sent, stop)]
    if first[0] > 0.0:
        return first[0] < first[1] - 1e-9
    # the next check can change what comes after it
    k = round((DEAD_TIME_S + PERIOD_S) / _STEP_S)
    overlaps = [way[min(k, len(way) - 1)][1].intersection(obstacle).area for way in (sent, stop)]
    return overlaps[0] > overlaps[1] + _OVERLAP_ROUNDING_M2


def _braking(scene: SafetyScene, moment: Moment, command: Twist2D) -> Iterator[tuple[float, shapely.Polygon]]:
    """Yield time and outline of the robot that follows `command` until the next check and then brakes."""
    x, y, yaw = moment.pose
    velocity = np.array(moment.velocity, np.float64)
    decel = np.array(scene.robot.max_decel)
    sent, wanted = np.array(moment.sent_before, np.float64), np.array(command, np.float64)
    if not scene.robot.holonomic:
        sent[1] = wanted[1] = 0.0
    fixed = scene.robot.name == "round"
    t = 0.0
    while True:
        outline = affinity.rotate(scene.robot.footprint.polygon, 0.0 if fixed else yaw, (0.0, 0.0), use_radians=True)
        yield t, affinity.translate(outline, x, y)
        target = sent if t < DEAD_TIME_S - 1e-9 else wanted if t < DEAD_TIME_S + PERIOD_S - 1e-9 else np.zeros(3)
        if t >= DEAD_TIME_S + PERIOD_S - 1e-9 and not velocity.any():
            return
        change = np.clip(target - velocity, -decel * _STEP_S, decel * _STEP_S)
        vx, vy, w = (velocity + 0.5 * change).tolist()
        velocity = velocity + change
        c, s = math.cos(yaw + 0.5 * w * _STEP_S), math.sin(yaw + 0.5 * w * _STEP_S)
        x, y, yaw = x + _STEP_S * (c * vx - s * vy), y + _STEP_S * (s * vx + c * vy), yaw + _STEP_S * w
        t += _STEP_S


def _map_points(scan: LaserScan | None, pose: Pose2D) -> NDArray[np.float64]:
    if scan is None:
        return np.empty((0, 2))
    ranges = np.asarray(scan.ranges, np.float64)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    hit = np.isfinite(ranges) & (ranges <= scan.range_max)
    points = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))[hit]
    return Transform2D(*pose).apply_points(points)
