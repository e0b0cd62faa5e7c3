"""How trajectory rollout gets out of places where C++'s would stay for ever: circles in place, and backing out.

What it is worth: docs/parity/trajectory_rollout.md.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core import Pose2D, angle_between
from navstack.interfaces import Rollouts, ScoringContext
from navstack.local_planner._footprint_kernels import perimeter_cost

OUTLINES = tuple(round(1.0 - 0.05 * i, 2) for i in range(6))
"""How much of the outline must be free where the robot stands for it to back out: padding is no more than the rest."""


class FullTurnDetector:
    """Knows when the robot has turned a whole circle in place.

    ROS differs: where driving on costs more than it is worth, C++ turns in place for ever. All there is to see was seen in one
    circle: from then on, until the robot has come as far as its samples look, the best sample ahead is taken.
    """

    def __init__(self, farthest: float) -> None:
        """`farthest` (m): as far as samples look."""
        self._farthest = farthest
        self._turning: tuple[Pose2D, float] | None = None  # pose of the last cycle, angle turned up to then
        self._circled: Pose2D | None = None  # where a whole circle led nowhere

    def begin(self, pose: Pose2D) -> None:
        """A turn in place was chosen at `pose`."""
        if self._turning is None:
            self._turning = pose, 0.0

    def complete(self, pose: Pose2D, *, moved: bool) -> bool:
        """True from a whole circle in place on. `moved`: the robot has left the place where it began to turn."""
        if self._circled is not None and pose.distance_to(self._circled) > self._farthest:
            self._circled = None
        if self._turning is not None:
            before, turned = self._turning
            if moved:
                self._turning = None
            else:
                turned += abs(angle_between(before.yaw, pose.yaw))
                self._turning = pose, turned
                if turned > 2.0 * math.pi:
                    self._turning, self._circled = None, pose
        return self._circled is not None

    def forget(self) -> None:
        """Another goal: what was turned for the last one counts no more."""
        self._turning = self._circled = None


class Escape:
    """How far the robot backs out.

    ROS differs: C++ always goes back escape_reset_dist, and often for ever between two poses that differ by that. Here each
    escape from one place goes back twice as far as the one before.
    """

    def __init__(self, distance: float, angle: float, farthest: float) -> None:
        """Ends after `distance` (m), at most `farthest` when it is repeated, or after a turn of `angle` (rad)."""
        self._shortest = distance
        self._angle = angle
        self._farthest = max(farthest, distance)
        self._distance = distance
        self._begun: Pose2D | None = None
        self._before: Pose2D | None = None  # where the last one began

    @property
    def active(self) -> bool:
        """True while it lasts."""
        return self._begun is not None

    def begin(self, pose: Pose2D) -> None:
        """Backing out was chosen at `pose`; nothing where that goes on already."""
        if self._begun is not None:
            return
        repeated = self._before is not None and pose.distance_to(self._before) <= self._farthest
        self._distance = min(2.0 * self._distance, self._farthest) if repeated else self._shortest
        self._begun = self._before = pose

    def stop(self) -> None:
        """It cannot go on."""
        self._begun = None

    def end_when_done(self, pose: Pose2D) -> None:
        """Ends it where the robot is far enough from, or has turned far enough since, where it began."""
        if self._begun is not None and (
            pose.distance_to(self._begun) > self._distance
            or abs(angle_between(self._begun.yaw, pose.yaw)) > self._angle
        ):
            self._begun = None

    def forget(self) -> None:
        """Another goal: the next one is a first one."""
        self._before = None


def backup_points(context: ScoringContext, rollouts: Rollouts, distance: float) -> int:
    """Points of the last trajectory, backing out, that come no nearer to anything than the robot already is; 0: it does.

    ROS differs: C++ backs up whatever is behind it. Here the outline may stand on lethal cells (it is padded, and cells are
    coarse), but, shrunk until it is free where it stands, it must stay free for `distance` (m) and the way to brake, give or
    take half a cell.
    """
    g, acceleration = context.costmap.geometry, context.limits.acc_lim_x
    speed = abs(float(rollouts.samples[-1, 0]))
    braking = speed * speed / (2.0 * acceleration) if acceleration > 0.0 else 0.0
    way = rollouts.poses[-1, : rollouts.counts[-1]]
    along = np.hypot(way[:, 0] - way[0, 0], way[:, 1] - way[0, 1])
    way = way[along <= distance + braking + g.resolution].tolist()

    def is_free(pose: list[float], scale: float) -> bool:
        x, y, yaw = pose
        if g.world_to_cell(x, y) is None:
            return False
        vertices = context.footprint.vertices
        cost = perimeter_cost(context.costmap.data, g.origin_x, g.origin_y, g.resolution, vertices, x, y, yaw, scale)
        return bool(cost >= 0)

    scale = next((scale for scale in OUTLINES if is_free(way[0], scale)), None)
    if scale is None:
        return 0
    # what slides along the outline falls into one cell or the next
    scale -= 0.5 * g.resolution / max(context.footprint.inscribed_radius, g.resolution)
    return len(way) if all(is_free(pose, scale) for pose in way) else 0
