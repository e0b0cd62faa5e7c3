"""A batch of sampled trajectories, the path that they are compared with, and the context of their critics."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Pose2D
from navstack.interfaces import Inflation, Rollouts, ScoringContext
from navstack.local_planner.mppi._critic_kernels import furthest_pose, travelled
from navstack.local_planner.mppi._sine_kernels import LANES

Floats = NDArray[np.float32]

PLACE = np.dtype([("origin_x", "f8"), ("origin_y", "f8"), ("resolution", "f8"), ("mppi", "f8")])
"""Geometry of a grid relative to the anchor of a batch (m). The last field only distinguishes it from other records."""


class Motion(NamedTuple):
    """What the robot can do, as far as critics need it: limits in force (m/s, rad/s), and its kind of base."""

    vx_max: float
    vx_min: float
    vy_max: float
    wz_max: float
    omni: bool = False
    min_turning_r: float = 0.0
    """Smallest turning radius (m); 0 for a robot that turns in place."""


@dataclass(slots=True, eq=False)
class Batch:
    """K trajectories of T points, padded to whole groups of LANES; float32, a row for each time step.

    Positions are relative to the anchor, so that they are as accurate far from the frame's origin as near to it.
    """

    number: int
    """K, without the padding."""
    speeds: Floats
    """(3, T, K) vx, vy, wz during each step."""
    points: Floats
    """(3, T, K) x, y, yaw after each step."""
    anchor: tuple[float, float]
    """Position (m) in the costmap's frame."""
    dt: float
    """Length of a step (s)."""
    collided: NDArray[np.bool_]
    """(K,) trajectories that a critic found in collision."""
    all_collided: bool = False
    """True if a critic found all in collision."""

    @classmethod
    def empty(cls, number: int, steps: int, dt: float) -> Batch:
        """Memory for `number` trajectories."""
        lanes = padded(number)
        speeds, points = np.zeros((3, steps, lanes), np.float32), np.zeros((3, steps, lanes), np.float32)
        return cls(number, speeds, points, (0.0, 0.0), dt, np.zeros(lanes, np.bool_))

    @classmethod
    def of_rollouts(cls, rollouts: Rollouts, anchor: tuple[float, float], dt: float) -> Batch:
        """Rollouts of other planners, with the command as the speed of every step; short ones stay at their last point."""
        k, points = rollouts.poses.shape[:2]
        batch = cls.empty(k, max(1, points), dt)
        batch.anchor = anchor
        last = np.clip(rollouts.counts - 1, 0, max(points - 1, 0))
        at = np.minimum(np.arange(points)[None, :], last[:, None])
        poses = np.where(
            (rollouts.counts > 0)[:, None, None], rollouts.poses[np.arange(k)[:, None], at], 0.0
        ) - np.array([*anchor, 0.0])
        batch.points[:, :, :k] = poses.transpose(2, 1, 0)
        batch.speeds[:, :, :k] = rollouts.commands.T[:, None, :]
        return batch

    def pose(self, row: int, step: int) -> Pose2D:
        """A point in the costmap's frame."""
        x, y, yaw = self.points[:, step, row].tolist()
        return Pose2D(x + self.anchor[0], y + self.anchor[1], yaw)

    def place(self, costmap: Costmap) -> NDArray[Any]:
        """(1,) of PLACE, for kernels."""
        record = np.zeros(1, PLACE)
        g = costmap.geometry
        record[0] = (g.origin_x - self.anchor[0], g.origin_y - self.anchor[1], g.resolution, 0.0)
        return record


def padded(number: int) -> int:
    """The number of trajectories rounded up to whole groups of LANES, an even number of groups."""
    return math.ceil(number / (2 * LANES)) * 2 * LANES


@dataclass(slots=True, eq=False)
class TrajectoryContext(ScoringContext):
    """Input of the critics of trajectories; `plan` is the local path."""

    length: float = 0.0
    """What the thresholds of critics are compared with: length of the path that is left (m)."""
    target: Pose2D = Pose2D(0.0, 0.0)
    """The pose that the goal critics head for."""
    motion: Motion = Motion(0.5, -0.35, 0.5, 1.9)
    inflation: Inflation | None = None
    track_unknown_space: bool = False
    xy_tolerance: float = 0.25
    """The goal checker's (m)."""
    exact: bool = True
    """Footprints are checked exactly, and without inflation everywhere; False: as in Nav2."""
    path: Floats = field(default_factory=lambda: np.empty((4, 0), np.float32))
    """(4, n) x and y relative to the anchor, yaw, and arc length of the local path; filled by `begin`."""
    valid: NDArray[np.bool_] | None = None
    """(n,) poses of the path that are free, filled on request."""
    furthest: int = -1
    """Largest index of the path that a trajectory reaches; -1 until a critic asks."""
    scratch: Floats = field(default_factory=lambda: np.empty(0, np.float32))

    @classmethod
    def of(cls, context: ScoringContext) -> TrajectoryContext:
        """A context of another planner, with what its limits and its plan say."""
        if isinstance(context, TrajectoryContext):
            return context
        limits, plan = context.limits, context.plan
        segments = np.hypot(np.diff(plan[:, 0]), np.diff(plan[:, 1]))
        last = Pose2D(*plan[-1].tolist()) if len(plan) else context.goal
        motion = Motion(limits.max_vel_x, limits.min_vel_x, limits.max_vel_y, limits.max_vel_theta, True)
        return cls(
            context.state,
            context.costmap,
            context.footprint,
            plan,
            context.goal,
            limits,
            context.notes,
            length=float(segments.sum()),
            target=last,
            motion=motion,
        )

    def begin(self, anchor: tuple[float, float]) -> None:
        """Express the path relative to the anchor of the batch."""
        path = np.zeros((4, len(self.plan)), np.float32)
        path[0] = self.plan[:, 0] - anchor[0]
        path[1] = self.plan[:, 1] - anchor[1]
        path[2] = self.plan[:, 2]
        steps = np.sqrt(np.diff(path[0]) ** 2 + np.diff(path[1]) ** 2)
        np.cumsum(steps, out=path[3, 1:])
        self.path = path
        self.valid = None
        self.furthest = -1

    def valid_poses(self) -> NDArray[np.bool_]:
        """(n,) poses of the path whose cell is inside the costmap and free for the robot's centre."""
        valid = self.valid
        if valid is None:
            g, data = self.costmap.geometry, self.costmap.data
            ix = np.floor((self.plan[:, 0] - g.origin_x) / g.resolution).astype(np.int64)
            iy = np.floor((self.plan[:, 1] - g.origin_y) / g.resolution).astype(np.int64)
            inside = (ix >= 0) & (iy >= 0) & (ix < g.nx) & (iy < g.ny)
            costs = data[np.where(inside, iy, 0), np.where(inside, ix, 0)]
            valid = self.valid = inside & (costs != 253) & (costs != 254) & ((costs != 255) | self.track_unknown_space)
        return valid

    def furthest_reached(self, batch: Batch) -> int:
        """Largest index of the path that is the nearest to the end of a trajectory; computed once per batch."""
        if self.furthest < 0:
            lanes = batch.points.shape[2]
            length, scratch = np.empty(lanes, np.float32), np.empty(lanes, np.float32)
            travelled(batch.points, 0, length)
            nearest = np.empty(lanes, np.int32)
            self.furthest = int(furthest_pose(batch.points, batch.number, self.path, length, nearest, scratch))
        return self.furthest
