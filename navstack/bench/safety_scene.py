"""Scenes for the search for contacts: people who walk, boxes that appear, and a source of hostile commands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
import shapely

from navstack.core import Footprint, GridGeometry, OccupancyGrid, Pose2D, Twist2D
from navstack.parameters.models.sim import LidarParams, SimParams
from navstack.sim import Shape
from navstack.sim.shapes import DoorMotion, OnTrack, PedestrianMotion

ROOM_M: Final = 8.0
"""Side of the square room."""
DURATION_S: Final = 10.0
PERIOD_S: Final = 0.05
"""Time between two commands, two scans and two checks."""
DEAD_TIME_S: Final = 0.05
"""Time between a command and its effect on the simulated base."""
MARGIN_M: Final = 0.06
"""Distance of the monitor's zone from the footprint."""
_AWAY: Final = -60.0
"""Where boxes are before they appear (m): beyond the walls and the range of the lidar."""


@dataclass(frozen=True, slots=True)
class RobotKind:
    """A robot of the search."""

    name: str
    footprint: Footprint
    holonomic: bool
    max_velocity: tuple[float, float, float]
    """m/s, rad/s."""
    max_decel: tuple[float, float, float]
    """m/s², rad/s²."""


def robot_kinds() -> tuple[RobotKind, ...]:
    """Return the three robots: a small round one, a rectangular one that moves sideways, a long one that turns about its tail."""
    rectangle = np.array([[0.35, 0.25], [-0.35, 0.25], [-0.35, -0.25], [0.35, -0.25]])
    # a fork-lift: its base is between the rear wheels, and the forks leave a notch in front
    long = np.array(
        [[0.9, 0.28], [0.5, 0.28], [0.5, 0.3], [-0.2, 0.3], [-0.2, -0.3], [0.5, -0.3], [0.5, -0.28], [0.9, -0.28]]
    )
    return (
        RobotKind("round", Footprint.from_radius(0.2), False, (0.7, 0.0, 2.0), (1.0, 1.0, 2.5)),
        RobotKind("rectangle", Footprint(rectangle), True, (0.8, 0.5, 1.5), (0.8, 0.8, 2.0)),
        RobotKind("long", Footprint(long), False, (1.0, 0.0, 1.0), (0.7, 0.7, 1.5)),
    )


@dataclass(frozen=True, slots=True)
class SafetyScene:
    """One scene, a function of its number."""

    number: int
    robot: RobotKind
    shapes: tuple[Shape, ...]

    @property
    def start(self) -> Pose2D:
        """The middle of the room, in one of eight headings."""
        return Pose2D(0.0, 0.0, (self.number // 3) % 8 * math.pi / 4.0 - math.pi)

    @property
    def sim(self) -> SimParams:
        """The simulated robot: limited accelerations, a dead time, and a lidar all around with noise."""
        x, y, w = self.robot.max_decel
        lidar = LidarParams(
            fov=2.0 * math.pi,
            beams=360,
            frequency=1.0 / PERIOD_S,
            range_min=0.02,
            range_max=12.0,
            range_noise=0.005,
            x=0.0,
        )
        return SimParams(
            kinematics="holonomic" if self.robot.holonomic else "differential",
            physics_frequency=2.0 / PERIOD_S,
            acc_lim_x=x,
            acc_lim_y=y,
            acc_lim_theta=w,
            command_delay=DEAD_TIME_S,
            bumpers=[],
            sensors={"laser": lidar},
        )

    def zone(self) -> shapely.Polygon:
        """Return the footprint with the margin."""
        return self.robot.footprint.polygon.buffer(MARGIN_M, join_style="mitre")


@cache
def room() -> OccupancyGrid:
    """Return an empty room with walls."""
    cells = round(ROOM_M / 0.05)
    data = np.zeros((cells, cells), np.int8)
    data[[0, -1], :] = 100
    data[:, [0, -1]] = 100
    half = -0.5 * ROOM_M
    return OccupancyGrid(data, GridGeometry(cells, cells, 0.05, half, half))


def safety_scene(number: int) -> SafetyScene:
    """Return scene `number`: four people, two of whom ignore everything, and six boxes that appear at random times."""
    rng = np.random.default_rng([number, 20])
    kind = robot_kinds()[number % 3]
    shapes: list[Shape] = []
    for k in range(2):
        ends = _points(rng, 2, kind)
        speed = float(rng.uniform(0.3, 1.2))
        motion = OnTrack(points=ends, speed=speed, start_offset=0.0)
        shapes.append(Shape(name=f"walker {k + 1}", radius=0.25, motion=motion))
    for k in range(2):
        goals = _points(rng, 3, kind)
        motion = PedestrianMotion(goals=goals, notices_robot=bool(rng.random() < 0.5))
        shapes.append(Shape(name=f"pedestrian {k + 1}", radius=0.25, pose=[*goals[0], 0.0], motion=motion))
    for k in range(6):
        (x, y), t = rng.uniform(-3.5, 3.5, 2), float(rng.uniform(0.5, 0.8 * DURATION_S))
        box = [float(rng.uniform(0.15, 1.0)), float(rng.uniform(0.15, 1.0))]
        motion = DoorMotion(style="sliding", slide=[float(x) - _AWAY, float(y)], open=[[t, 1e6]], moving_time=0.0)
        pose = [_AWAY, 0.0, float(rng.uniform(-math.pi, math.pi))]
        shapes.append(Shape(name=f"box {k + 1}", box=box, pose=pose, motion=motion))
    return SafetyScene(number, kind, tuple(shapes))


def _points(rng: np.random.Generator, count: int, kind: RobotKind) -> list[list[float]]:
    """Random points in the room; the first one is away from the start of the robot."""
    out: list[list[float]] = []
    while len(out) < count:
        x, y = rng.uniform(-3.5, 3.5, 2).tolist()
        if out or math.hypot(x, y) > kind.footprint.circumscribed_radius + 0.5:
            out.append([x, y])
    return out


class HostileSource:
    """Random velocities up to the limits of the robot, each held for a random time; half of them straight ahead or back."""

    def __init__(self, scene: SafetyScene) -> None:
        self._rng = np.random.default_rng([scene.number, 21])
        self._limit = np.array(scene.robot.max_velocity)
        self._until = -1.0
        self._command = Twist2D()

    def command(self, now: float) -> Twist2D:
        """Return the command at `now` (s)."""
        rng = self._rng
        if now >= self._until:
            self._until = now + float(rng.choice((PERIOD_S, 0.2, 1.0, 3.0)))
            values = rng.uniform(-1.0, 1.0, 3) * self._limit
            if rng.random() < 0.5:
                values = np.sign(values) * self._limit
                values[2] *= float(rng.random() < 0.2)
            self._command = Twist2D(*values.tolist())
        return self._command
