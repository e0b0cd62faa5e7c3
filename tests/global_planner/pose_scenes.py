"""Parking and narrow scenes with known solutions, for planners over poses; and the same scenes made unsolvable.

A scene is built around a drive of arcs and lines: what its sweep needs, with a margin, is free. The referee confirms that the
drive is a solution. Everything is turned by a random angle, so that nothing is aligned with the cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from navstack.core import Costmap, Footprint, Path, Pose2D
from navstack.plugins import Plan
from tests.global_planner.pose_referee import Referee, inflated

RESOLUTION: Final = 0.05
KINDS: Final = (
    "bay ahead",
    "bay behind",
    "parallel slot",
    "door",
    "S bend",
    "U turn",
    "dead end",
    "three-point turn",
    "tunnel",
    "tunnel with cusps",
)
UNSOLVABLE: Final = ("narrow door", "goal in a wall", "sharp bend", "walled in")
Drive = list[tuple[float, float]]
"""Lengths (m, signed) and curvatures (1/m) of the pieces of a drive."""


@dataclass(frozen=True)
class Scene:
    """A query on a small map."""

    name: str
    lethal: NDArray[np.bool_]
    footprint: Footprint
    radius: float
    reverse: bool
    start: Pose2D
    goal: Pose2D
    drive: NDArray[np.float64]
    """(n, 3) the known solution; empty for a scene without one."""
    place: tuple[float, float]
    """Where an unsolvable scene is too narrow (m)."""

    @property
    def costmap(self) -> Costmap:
        """The map with inflation."""
        return inflated(self.lethal, RESOLUTION, self.footprint.inscribed_radius)

    def referee(self) -> Referee:
        """The referee of plans in this scene."""
        return Referee(self.costmap, self.footprint, False, self.radius, self.reverse)

    def faults_of_drive(self) -> list[str]:
        """What is wrong with the known solution."""
        plan = Plan(Path(self.drive, "map"), 0.0, self.goal, 0.0, 0)
        return self.referee().faults(plan, self.start, self.goal)


def box(front: float, rear: float, width: float) -> Footprint:
    """A rectangle, with the base frame between front and rear."""
    half = 0.5 * width
    return Footprint(np.array([[front, half], [front, -half], [-rear, -half], [-rear, half]]))


def poses_along(start: Pose2D, drive: Drive, step: float = 0.02) -> NDArray[np.float64]:
    """Poses (n, 3) along a drive."""
    poses = [np.array(start, np.float64)]
    for length, curvature in drive:
        x, y, yaw = poses[-1]
        count = max(1, math.ceil(abs(length) / step))
        for k in range(1, count + 1):
            s = length * k / count
            if curvature == 0.0:
                poses.append(np.array((x + s * math.cos(yaw), y + s * math.sin(yaw), yaw)))
            else:
                end = yaw + s * curvature
                dx, dy = math.sin(end) - math.sin(yaw), math.cos(yaw) - math.cos(end)
                poses.append(np.array((x + dx / curvature, y + dy / curvature, end)))
    return np.stack(poses)


def sweep(poses: NDArray[np.float64], footprint: Footprint, margin: float) -> BaseGeometry:
    """The area that a footprint covers along poses, with a margin (m)."""
    areas = [shapely.Polygon(footprint.at(Pose2D(*p))) for p in poses[::2].tolist() + poses[-1:].tolist()]
    return shapely.union_all(areas).buffer(margin)


def rectangle(pose: NDArray[np.float64], rear: float, front: float, right: float, left: float) -> BaseGeometry:
    """A rectangle in the frame of a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    corners = [(-rear, -right), (front, -right), (front, left), (-rear, left)]
    return shapely.Polygon([(pose[0] + c * x - s * y, pose[1] + s * x + c * y) for x, y in corners])


def drive_of(kind: str, rng: np.random.Generator, radius: float) -> Drive:
    """The pieces of the known solution of a scene."""
    k = float(rng.choice([-1.0, 1.0])) / (radius * float(rng.uniform(1.0, 1.3)))
    r, quarter = 1.0 / abs(k), 0.5 * math.pi
    some = float(rng.uniform(0.3, 1.2))
    angle = float(rng.uniform(0.5, 1.0))
    if kind == "bay ahead":
        return [(some, 0.0), (r * quarter, k), (1.0 + some, 0.0)]
    if kind == "bay behind":
        return [(1.0 + some, 0.0), (-r * quarter, k), (-1.0 - some, 0.0)]
    if kind == "parallel slot":
        return [(some + 0.5, 0.0), (-r * angle, -k), (-r * angle, k), (0.1, 0.0)]
    if kind == "door":
        return [(r * angle, k), (1.5, 0.0), (some, 0.0), (r * angle, -k)]
    if kind == "S bend":
        return [(some, 0.0), (r * 1.2, k), (some, 0.0), (r * 1.2, -k), (some, 0.0)]
    if kind == "U turn":
        return [(some, 0.0), (r * math.pi, k), (some, 0.0)]
    if kind == "dead end":
        return [(-1.5 - some, 0.0), (-r * quarter, k), (some, 0.0), (r * angle, -k)]
    if kind == "three-point turn":
        third = math.pi / 3.0
        return [(some, 0.0), (r * third, k), (-r * third, -k), (r * third, k), (some, 0.0)]
    pieces: Drive = []
    for _ in range(int(rng.integers(3, 7))):
        sign = float(rng.choice([-1.0, 1.0])) if kind == "tunnel with cusps" else 1.0
        bend = float(rng.choice([-1.0, 0.0, 1.0])) / (radius * float(rng.uniform(1.0, 2.0)))
        pieces.append((sign * float(rng.uniform(0.4, 1.6)), bend))
    return pieces


def rooms_around(
    kind: str, poses: NDArray[np.float64], footprint: Footprint, rng: np.random.Generator
) -> list[BaseGeometry]:
    """Free areas next to the sweep of the drive."""
    front, side = float(footprint.vertices[:, 0].max()), float(footprint.vertices[:, 1].max())
    rear = -float(footprint.vertices[:, 0].min())
    wide = side + float(rng.uniform(0.1, 0.5))
    start, goal = poses[0], poses[-1]
    if kind in ("bay ahead", "bay behind", "parallel slot"):
        return [rectangle(start, rear + 0.5, front + 3.0, wide, wide)]
    if kind == "door":
        return [rectangle(p, 1.2 + rear, 1.2 + front, 1.2, 1.2) for p in (start, goal)]
    if kind == "dead end":
        return [rectangle(goal, rear + 1.0, front + 0.5, wide, wide)]
    return []


def solvable(kind: str, number: int) -> Scene:
    """Scene `number` of a kind, with its known solution."""
    rng = np.random.default_rng((KINDS.index(kind), number))
    footprint = box(float(rng.uniform(0.3, 0.9)), float(rng.uniform(0.2, 0.4)), float(rng.uniform(0.4, 0.8)))
    radius = float(rng.uniform(0.5, 1.2))
    start = Pose2D(0.0, 0.0, float(rng.uniform(-math.pi, math.pi)))
    drive = drive_of(kind, rng, radius)
    poses = poses_along(start, drive)
    margin = float(rng.uniform(1.2, 2.0)) * RESOLUTION
    free = shapely.union_all([sweep(poses, footprint, margin), *rooms_around(kind, poses, footprint, rng)])
    lethal, offset = drawn(free)
    poses[:, :2] += offset
    poses[:, 2] = np.remainder(poses[:, 2] + math.pi, 2.0 * math.pi) - math.pi
    ends = [Pose2D(*(float(v) for v in poses[i])) for i in (0, -1)]
    reverse = any(length < 0.0 for length, _ in drive)
    return Scene(f"{kind} {number}", lethal, footprint, radius, reverse, ends[0], ends[1], poses, (0.0, 0.0))


def drawn(free: BaseGeometry) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Cells whose center is outside an area, and the position of the area's zero in them (m)."""
    left, low, right, high = free.bounds
    nx, ny = (math.ceil(v / RESOLUTION) + 6 for v in (right - left, high - low))
    x = left + (np.arange(nx) - 2.5) * RESOLUTION
    y = low + (np.arange(ny) - 2.5) * RESOLUTION
    lethal = ~shapely.contains_xy(free, *np.meshgrid(x, y))
    return lethal, np.array((3.0 * RESOLUTION - left, 3.0 * RESOLUTION - low))


def unsolvable(kind: str, number: int) -> Scene:
    """A scene without a solution; its name says why."""
    rng = np.random.default_rng((100 + UNSOLVABLE.index(kind), number))
    footprint = box(float(rng.uniform(0.4, 0.7)), 0.2, float(rng.uniform(0.5, 0.7)))
    half = float(footprint.vertices[:, 1].max())
    start = Pose2D(0.0, 0.0, float(rng.uniform(-math.pi, math.pi)))
    bend = 0.6 * math.pi if kind == "sharp bend" else 0.3
    corner = 0.35 if kind == "sharp bend" else 1.0
    poses = poses_along(start, [(2.0, 0.0), (corner * bend, 1.0 / corner), (2.5, 0.0)])
    width = half + 0.12
    way = shapely.LineString(poses[:, :2]).buffer(width if kind == "sharp bend" else half + 0.4)
    ends = [poses[0], poses[-1]]
    rooms = [rectangle(p, 1.0, 1.0, 0.9, 0.9) for p in ends]
    free = shapely.union_all([way, *rooms])
    place = poses[len(poses) // 2]
    if kind == "narrow door":
        gap = half - float(rng.uniform(0.05, 0.15))
        across = rectangle(place, 0.15, 0.15, 2.0, 2.0)
        free = free.difference(across.difference(rectangle(place, 0.4, 0.4, gap, gap)))
    elif kind == "goal in a wall":
        place = ends[1]
        free = free.difference(rectangle(place, -0.2, 0.4, 0.1, 0.3))
    elif kind == "walled in":
        free = free.difference(rectangle(place, 0.15, 0.15, 2.0, 2.0))
    lethal, offset = drawn(free)
    goal, at = poses[-1].copy(), place[:2] + offset
    goal[:2] += offset
    return Scene(
        f"{kind} {number}",
        lethal,
        footprint,
        1.0,
        False,
        Pose2D(float(offset[0]), float(offset[1]), start.yaw),
        Pose2D(float(goal[0]), float(goal[1]), math.remainder(float(goal[2]), 2.0 * math.pi)),
        np.zeros((0, 3)),
        (float(at[0]), float(at[1])),
    )
