# pyright: basic
"""How trajectory rollout avoids getting stuck: direction flags, a limit of one full turn in place, and escapes backward.

The flags are those of base_local_planner's TrajectoryPlanner (rotating_left, stuck_left, ..). The others are additions, with
their effect in docs/parity/trajectory_rollout.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Pose2D,
    angle_between,
    edge_cost,
    kernel,
    line_next,
    line_start,
)
from navstack.plugins import Rollouts, ScoringContext

FOOTPRINT_SCALES = tuple(round(1.0 - 0.05 * i, 2) for i in range(6))
"""Scales of the footprint, one of which must be free at the current pose for an escape; padding accounts for the rest."""


@dataclass(slots=True)
class Additions:
    """ROS differs: the rules that C++ does not have; without all of them, the planner selects as C++ does."""

    full_turns: bool = True
    """After a full turn in place, turns in place are not considered until the robot has moved."""
    check: bool = True
    """Back up only where the path backward is free."""
    longer: bool = True
    """Each escape from the same place leads farther than the one before."""
    unreachable: bool = True
    """Back up even if the local goal cannot be reached in the costmap; C++ stops."""
    nearer_goal: bool = True
    """A local goal in an obstacle is moved back along the plan; in C++ every sample is rejected."""

    @classmethod
    def none(cls) -> Additions:
        """As C++."""
        return cls(full_turns=False, check=False, longer=False, unreachable=False, nearer_goal=False)


class AxisFlags:
    """Flags of one axis: a sign that was selected twice (`reversal`: after the other one) excludes the other sign."""

    def __init__(self, *, reversal: bool) -> None:
        self._reversal = reversal
        self._selected = [False, False]
        self._only = [False, False]

    def update(self, speed: float) -> None:
        """Record that `speed`, not 0, was selected."""
        side = 0 if speed > 0.0 else 1
        self._only[side] = self._only[side] or self._selected[1 - side if self._reversal else side]
        self._selected[side] = True

    def allows(self, speed: float) -> bool:
        """False if only the other sign is allowed."""
        return not self._only[0 if speed < 0.0 else 1]

    def clear(self) -> None:
        """Allow both signs."""
        self._selected, self._only = [False, False], [False, False]


class OscillationFlags:
    """Flags for turns in place and strafing, until the robot has moved.

    A turn in place that was selected twice excludes the other direction; strafing excludes the direction before the last.
    """

    def __init__(self) -> None:
        self.turn = AxisFlags(reversal=False)
        self.strafe = AxisFlags(reversal=True)
        self._since = Pose2D(0.0, 0.0)

    def update(self, sample: NDArray[np.float64], pose: Pose2D) -> None:
        """Record that `sample` (3,), which does not drive forward, was selected at `pose`."""
        if sample[2] != 0.0:
            self.turn.update(float(sample[2]))
        elif sample[1] != 0.0:
            self.strafe.update(float(sample[1]))
        self._since = pose

    def moved(self, pose: Pose2D, distance: float) -> bool:
        """True if the robot is farther than `distance` (m) from where such a sample was last selected."""
        return math.hypot(pose.x - self._since.x, pose.y - self._since.y) > distance

    def clear(self) -> None:
        """Allow every direction."""
        self.turn.clear()
        self.strafe.clear()

    @property
    def forbidden_turns(self) -> list[str]:
        """Forbidden directions of turns in place."""
        return [direction for direction, speed in (("left", 1.0), ("right", -1.0)) if not self.turn.allows(speed)]


class FullTurnDetector:
    """Detects that the robot has turned a full circle in place.

    ROS differs: if driving forward costs more than its gain, C++ turns in place forever. One full turn shows all there is to
    see. From then on, until the robot has moved as far as its rollouts reach, turns in place are not considered.
    """

    def __init__(self, reach: float) -> None:
        """`reach` (m): the longest distance of a rollout."""
        self._reach = reach
        self._turning: tuple[Pose2D, float] | None = None  # pose of the last cycle, angle turned so far
        self._completed: Pose2D | None = None  # where a full turn was completed

    def begin(self, pose: Pose2D) -> None:
        """Record that a turn in place was selected at `pose`."""
        if self._turning is None:
            self._turning = pose, 0.0

    def complete(self, pose: Pose2D, *, moved: bool) -> bool:
        """True after a full turn in place. `moved`: the robot has left the place where it began to turn."""
        if self._completed is not None and pose.distance_to(self._completed) > self._reach:
            self._completed = None
        if self._turning is not None:
            before, turned = self._turning
            if moved:
                self._turning = None
            else:
                turned += abs(angle_between(before.yaw, pose.yaw))
                self._turning = pose, turned
                if turned > 2.0 * math.pi:
                    self._turning, self._completed = None, pose
        return self._completed is not None

    def reset(self) -> None:
        """Reset the turns made for the last goal."""
        self._turning = self._completed = None


class Escape:
    """An escape backward, and how far it leads.

    ROS differs: every escape of C++ ends after escape_reset_dist, so the robot often moves forever between two poses that
    far apart. Here each escape from the same place leads twice as far as the one before.
    """

    def __init__(self, distance: float, angle: float, farthest: float) -> None:
        """An escape ends after `distance` (m), when repeated at most `farthest`, or after a turn of `angle` (rad)."""
        self.longer = True
        self._shortest = distance
        self._angle = angle
        self._farthest = max(farthest, distance)
        self._distance = distance
        self._start: Pose2D | None = None
        self._last_start: Pose2D | None = None
        self.scale = 0.0
        """Largest scale of the footprint that was free since the robot began to overlap obstacles: no smaller one will do."""

    @property
    def active(self) -> bool:
        """True during an escape."""
        return self._start is not None

    def begin(self, pose: Pose2D) -> None:
        """Begin an escape at `pose`, unless one is active."""
        if self._start is not None:
            return
        repeated = self._last_start is not None and pose.distance_to(self._last_start) <= self._farthest
        grows = repeated and self.longer
        self._distance = min(2.0 * self._distance, self._farthest) if grows else self._shortest
        self._start = self._last_start = pose

    def stop(self) -> None:
        """End the escape: it cannot continue."""
        self._start = None

    def end_when_done(self, pose: Pose2D) -> None:
        """End the escape if the robot has moved or turned far enough since its start."""
        if self._start is not None and (
            pose.distance_to(self._start) > self._distance
            or abs(angle_between(self._start.yaw, pose.yaw)) > self._angle
        ):
            self._start = None

    def reset(self) -> None:
        """Reset the last escape: the next one leads the shortest distance."""
        self._last_start = None
        self.scale = 0.0


def free_backup_points(
    context: ScoringContext, rollouts: Rollouts, distance: float, smallest: float = 0.0
) -> tuple[int, float]:
    """Points of the last rollout, which backs up, that come no nearer to an obstacle than the robot is, and the free scale.

    No points if they do come nearer, or if only a scale below `smallest` is free: a scale chosen anew in each cycle would let
    the robot creep into the obstacle.

    ROS differs: C++ backs up without a check. Here the footprint may overlap lethal cells (it is padded, and cells are
    coarse), but scaled down until its outline is free at the current pose, the outline must stay free for `distance` (m) and
    the braking distance, to half a cell. What enters the footprint crosses its outline; what is inside of it already must not
    keep the robot from leaving, so enclosed cells do not count here.
    """
    g, acceleration = context.costmap.geometry, context.limits.acc_lim_x
    speed = abs(float(rollouts.commands[-1, 0]))
    braking = speed * speed / (2.0 * acceleration) if acceleration > 0.0 else 0.0
    points = rollouts.poses[-1, : rollouts.counts[-1]]
    travelled = np.hypot(points[:, 0] - points[0, 0], points[:, 1] - points[0, 1])
    poses = points[travelled <= distance + braking + g.resolution].tolist()

    def is_free(pose: list[float], scale: float) -> bool:
        x, y, yaw = pose
        if g.world_to_cell(x, y) is None:
            return False
        vertices = context.footprint.vertices
        cost = perimeter_cost(context.costmap.data, g.origin_x, g.origin_y, g.resolution, vertices, x, y, yaw, scale)
        return bool(cost >= 0)

    # a point that slides along the footprint's edge may fall into either of two cells
    half = 0.5 * g.resolution / max(context.footprint.inscribed_radius, g.resolution)
    tried = (scale for scale in FOOTPRINT_SCALES if scale >= smallest - half)
    scale = next((scale for scale in tried if is_free(poses[0], scale)), None)
    if scale is None:
        return 0, smallest
    reached = max(scale, smallest)
    return len(poses) if all(is_free(pose, reached - half) for pose in poses) else 0, reached


# --- kernels --------------------------------------------------------------------------------------------------------

ON_LETHAL, ON_UNKNOWN, OFF_MAP = -1, -2, -3
"""Results of `perimeter_cost`."""


@kernel
def perimeter_cost(costs, origin_x, origin_y, resolution, vertices, x, y, yaw, scale):
    """Highest cost along the edges of the footprint `vertices` (n, 2), scaled by `scale`; ON_LETHAL, ON_UNKNOWN or OFF_MAP.

    That is base_local_planner's CostmapModel::footprintCost: cells inside of the edges do not count.
    """
    number = len(vertices)
    corners = np.empty((2, number))
    for j in range(number):
        corners[0, j] = scale * vertices[j, 0]
        corners[1, j] = scale * vertices[j, 1]
    cells = np.empty((2, number), np.int32)
    highest = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, cells)
    if highest < 254:
        return highest
    return collision_reason(costs, origin_x, origin_y, resolution, corners, x, y, yaw)


@kernel
def collision_reason(costs, origin_x, origin_y, resolution, corners, x, y, yaw):
    """The first of ON_LETHAL, ON_UNKNOWN and OFF_MAP along the edges of a footprint that is in collision."""
    ny, nx = costs.shape
    flat = costs.ravel()
    c, s = math.cos(yaw), math.sin(yaw)
    number = corners.shape[1]
    x0, y0 = 0, 0
    for i in range(number + 1):
        j = 0 if i == number else i
        vx, vy = corners[0, j], corners[1, j]
        fx = ((x + (vx * c - vy * s)) - origin_x) / resolution
        fy = ((y + (vx * s + vy * c)) - origin_y) / resolution
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            return OFF_MAP
        x1, y1 = int(fx), int(fy)
        if i > 0:
            line = line_start(x0, y0, x1, y1, nx)
            cell, error = y0 * nx + x0, line[0] // 2
            for _ in range(line[0] + 1):
                if flat[cell] == 254:
                    return ON_LETHAL
                if flat[cell] == 255:
                    return ON_UNKNOWN
                cell, error = line_next(cell, error, line)
        x0, y0 = x1, y1
    return OFF_MAP
