"""The collision check of the arc that a command drives, and headings from which it is free."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, Twist2D
from navstack.core.overlap import is_nearly_round
from navstack.interfaces import ControlInput
from navstack.local_planner import _carrot_kernels as kernels
from navstack.local_planner.path_follower import Following
from navstack.local_planner.regulated_pure_pursuit.params import RegulatedPurePursuitParams
from navstack.local_planner.regulated_pure_pursuit.regulation import curvature_to

MOST_POSES = 2000
"""Poses of an arc that are checked at most."""
TURN_STEP = math.radians(5.0)
MOST_TURN = 0.5 * math.pi
"""Headings up to this angle away are searched (rad)."""
BEGIN = 4
"""Poses of the begin of an arc."""


class Scene(NamedTuple):
    """What is checked: where the robot is, and what is around it."""

    pose: Pose2D
    costmap: Costmap
    footprint: Footprint
    track_unknown_space: bool

    @classmethod
    def of(cls, now: Following | ControlInput) -> Scene:
        """That of a cycle."""
        return cls(now.state.pose, now.costmap, now.footprint, now.track_unknown_space)


class ArcCheck:
    """Checks arcs, with buffers of its own.

    ROS differs: Nav2 checks edges of the footprint at Euler steps of a cell that end before the duration, so that of a robot
    slower than a cell per duration only the present pose is checked, and corners of a long robot that turns skip cells. Here
    overlapped cells count, on the arc itself, up to its end, and no corner moves by more than a cell per step; the turn of
    a round robot covers nothing else.
    """

    def __init__(self) -> None:
        self._poses = np.empty((MOST_POSES, 3))
        self._grid, self._start = np.empty(3), np.empty(3)
        self._twist, self._reach = np.empty(3), np.empty(3)

    def first_collision(
        self, scene: Scene, command: Twist2D, duration: float, reach: float, *, as_nav2: bool
    ) -> tuple[int, NDArray[np.float64]]:
        """Index of the first pose that collides, -1 without one, and the poses (n, 3) on the way of a command.

        The way ends after a duration (s), or at a distance (m) from the robot.
        """
        geometry = scene.costmap.geometry
        self._grid[:] = geometry.origin_x, geometry.origin_y, geometry.resolution
        self._start[:] = scene.pose
        self._twist[:] = command.vx, command.wz, scene.footprint.circumscribed_radius
        self._reach[:] = duration, reach, 0.0 if as_nav2 else 1.0
        hit, count = kernels.arc_collision(
            scene.costmap.data,
            self._grid,
            scene.footprint.vertices,
            not scene.track_unknown_space,
            not as_nav2,
            not (as_nav2 or is_nearly_round(scene.footprint)),
            self._start,
            self._twist,
            self._reach,
            self._poses,
        )
        return int(hit), self._poses[:count].copy()


def extent_of_check(
    p: RegulatedPurePursuitParams, now: Following, command: Twist2D, carrot: float
) -> tuple[float, float]:
    """Duration (s) and distance (m) of the check of a command to a carrot at some distance (m)."""
    duration, reach = p.max_allowed_time_to_collision_up_to_carrot, carrot
    least = p.min_distance_to_obstacle
    if least > 0.0:
        duration = max(duration, least / max(abs(command.vx), p.min_approach_linear_velocity))
        if p.use_velocity_scaled_lookahead_dist:
            if not p.allow_obstacle_checking_beyond_goal:
                least = min(least, now.path.length)
            reach = min(max(reach, least), p.max_lookahead_dist)
    return duration, reach


def free_arc(
    check: ArcCheck, scene: Scene, carrot: tuple[float, float], reach: float, turned: float = 0.0
) -> NDArray[np.float64] | None:
    """The poses (n, 3) of the arc to a carrot after a turn in place (rad); None if it collides.

    `carrot` is in the robot's frame before the turn (m), `reach` the distance at which the arc ends (m).
    """
    c, s = math.cos(turned), math.sin(turned)
    curvature = curvature_to(c * carrot[0] + s * carrot[1], c * carrot[1] - s * carrot[0])
    x, y, yaw = scene.pose
    at = scene._replace(pose=Pose2D(x, y, yaw + turned))
    hit, way = check.first_collision(at, Twist2D(1.0, 0.0, curvature), math.inf, reach, as_nav2=False)
    return way if hit < 0 else None


def nearest_free_heading(
    check: ArcCheck, scene: Scene, carrot: tuple[float, float], reach: float, most: float
) -> float | None:
    """Angle (rad) to the nearest other heading from which the arc to a carrot is free, None without one.

    The carrot is then at most `most` (rad) off the heading. The begin of the arc comes no nearer to an obstacle: the cost under
    the robot's centre does not rise.
    """
    cost_at, bearing = scene.costmap.cost_at, math.atan2(carrot[1], carrot[0])
    here = cost_at(scene.pose.x, scene.pose.y)
    for k in range(1, math.floor(MOST_TURN / TURN_STEP) + 1):
        for turned in (k * TURN_STEP, -k * TURN_STEP):
            way = free_arc(check, scene, carrot, reach, turned) if abs(bearing - turned) <= most else None
            if way is None or here is None:
                continue
            costs = [cost_at(*point) for point in way[1:BEGIN, :2].tolist()]
            if all(cost is not None and cost <= here for cost in costs):
                return turned
    return None
