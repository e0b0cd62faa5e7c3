# pyright: basic
"""A batch of sampled trajectories, the path that they are compared with, and the context of their critics."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Pose2D, kernel
from navstack.plugins import Inflation, Rollouts, ScoringContext

# ----------------------------------------------------------------------------------------------------------------------
# Sine and cosine in float32, without branches, so that loops over lanes are vectorized. Accurate to 1e-7.


# pyright: basic


f32 = np.float32
LANES = 64
"""Trajectories that a kernel works on at a time: a constant, so that the compiler knows that its buffers do not overlap."""


@kernel
def quadrant_sine(angle, quadrant):
    """Return sine and cosine of `angle`, within pi / 4 of zero, plus `quadrant` quarter turns.

    Polynomials of the least maximum error on the quarter turn, of degree 7 and 8.
    """
    z = angle * angle
    s = ((f32(-1.9515296e-4) * z + f32(8.3321609e-3)) * z - f32(1.6666655e-1)) * z * angle + angle
    c = ((f32(2.4433157e-5) * z - f32(1.3887316e-3)) * z + f32(4.1666646e-2)) * z * z - f32(0.5) * z + f32(1.0)
    swap = (quadrant & np.int32(1)) != 0
    sine = c if swap else s
    cosine = s if swap else c
    sine = -sine if (quadrant & np.int32(2)) != 0 else sine
    cosine = -cosine if ((quadrant + np.int32(1)) & np.int32(2)) != 0 else cosine
    return sine, cosine


@kernel
def sine_cosine(angle):
    """Return sine and cosine of an angle (rad)."""
    quarters = np.floor(angle * f32(0.63661977) + f32(0.5))
    # pi / 2 in three parts, so that the product with a small integer is exact (Cody and Waite)
    rest = ((angle - quarters * f32(1.5703125)) - quarters * f32(4.8375130e-4)) - quarters * f32(7.5497899e-8)
    return quadrant_sine(rest, np.int32(quarters))


@kernel
def turn_sine(turns):
    """Return sine and cosine of an angle in whole turns."""
    quarters = np.floor(turns * f32(4.0) + f32(0.5))
    return quadrant_sine((turns - quarters * f32(0.25)) * f32(6.2831855), np.int32(quarters))


# pyright: basic


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
        """(n,) poses of the path whose cell is inside the costmap and free for the robot's center."""
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


# --- kernels --------------------------------------------------------------------------------------------------------


@kernel
def travelled(points, begin, out):
    """Length of the trajectories from point `begin` on (m)."""
    out[:] = f32(0.0)
    for t in range(begin + 1, points.shape[1]):
        x, y = points[0, t], points[1, t]
        before_x, before_y = points[0, t - 1], points[1, t - 1]
        for k in range(len(out)):
            dx, dy = x[k] - before_x[k], y[k] - before_y[k]
            out[k] += np.sqrt(dx * dx + dy * dy)


@kernel
def furthest_pose(points, number, path, length, nearest, scratch):
    """Return the largest index of the pose of `path` (4, n) that is the nearest to the last point of a trajectory.

    For each of the first `number` trajectories the poses up to the first one with an arc length (row 3) of at least its own
    `length` (K,) are considered. `nearest` (K,) int32 and `scratch` (K,) are work space.
    """
    last = points.shape[1] - 1
    px, py = points[0, last], points[1, last]
    for k in range(len(nearest)):
        nearest[k] = 0
        scratch[k] = f32(np.inf)
    for i in range(path.shape[1]):
        x, y = path[0, i], path[1, i]
        before = path[3, i - 1] if i > 0 else f32(-1.0)
        at = np.int32(i)
        for k in range(len(nearest)):
            dx, dy = px[k] - x, py[k] - y
            distance = dx * dx + dy * dy
            distance = distance if before < length[k] else f32(np.inf)
            nearer = distance < scratch[k]
            nearest[k] = at if nearer else nearest[k]
            scratch[k] = distance if nearer else scratch[k]
    furthest = np.int32(0)
    for k in range(number):
        furthest = max(furthest, nearest[k])
    return np.int64(furthest)


# ----------------------------------------------------------------------------------------------------------------------
# Reachable velocities and trajectories of a batch. Arrays are (.., T, K) float32: a row is one time step of all trajectories.


# pyright: basic


@kernel
def envelope(speed, up, down, turnover, as_nav2):
    """Return the lowest and the highest speed that is reachable from `speed` within a step.

    `up` and `down` (both positive): change of the speed by speeding up and slowing down. `turnover` is up / down: what is left
    of a step after slowing down to 0 is used for speeding up. ROS differs: Nav2 uses one limit for both parts, and from a speed
    of 0 speeds up by `down`.
    """
    slowed, raised = speed - down, speed + down
    if as_nav2:
        forward = speed > f32(0.0)
        return (slowed if forward else speed - up), (speed + up if forward else raised)
    below = slowed if slowed >= f32(0.0) else slowed * turnover
    above = raised if raised <= f32(0.0) else raised * turnover
    return (below if speed >= f32(0.0) else speed - up), (above if speed < f32(0.0) else speed + up)


@kernel
def reach_axis(noise, controls, start, rates, first, offset, as_nav2, out):
    """Write the velocities that an axis reaches on its way to the sampled controls `controls` (T,) + `noise` (T, K) to `out`.

    `start` is the speed before the first step. `rates` (3,): see `envelope`. Steps before `first` keep `start`; step t follows
    control t - `offset`.
    """
    steps, number = noise.shape
    up, down, turnover = rates[0], rates[1], rates[2]
    speed = np.empty(LANES, np.float32)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            speed[i] = start
        for t in range(steps):
            if t >= first:
                control = controls[t - offset]
                sampled = noise[t - offset, begin : begin + LANES]
                for i in range(LANES):
                    low, high = envelope(speed[i], up, down, turnover, as_nav2)
                    target = control + sampled[i]
                    target = target if target > low else low
                    speed[i] = target if target < high else high
            row = out[t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = speed[i]


@kernel
def integrate(speeds, start, dt, omni, points):
    """Write the points (3, T, K) x, y, yaw of velocities (3, T, K) from the pose `start` (3,) on; the first is `dt` later.

    A step is driven in the direction before it (Euler), as in Nav2.
    """
    steps, number = speeds.shape[1], speeds.shape[2]
    x = np.empty(LANES, np.float32)
    y = np.empty(LANES, np.float32)
    yaw = np.empty(LANES, np.float32)
    cosine = np.empty(LANES, np.float32)
    sine = np.empty(LANES, np.float32)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            x[i] = start[0]
            y[i] = start[1]
            yaw[i] = start[2]
        for t in range(steps):
            forward = speeds[0, t, begin : begin + LANES]
            turning = speeds[2, t, begin : begin + LANES]
            for i in range(LANES):
                sine[i], cosine[i] = sine_cosine(yaw[i])
            for i in range(LANES):
                x[i] += forward[i] * cosine[i] * dt
                y[i] += forward[i] * sine[i] * dt
            if omni:
                sideways = speeds[1, t, begin : begin + LANES]
                for i in range(LANES):
                    x[i] -= sideways[i] * sine[i] * dt
                    y[i] += sideways[i] * cosine[i] * dt
            for i in range(LANES):
                yaw[i] += turning[i] * dt
            row = points[0, t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = x[i]
            row = points[1, t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = y[i]
            row = points[2, t, begin : begin + LANES]
            for i in range(LANES):
                row[i] = yaw[i]


@kernel
def integrate_one(controls, start, dt, points):
    """Write the trajectory (T, 3) of velocities (T, 3), as `integrate` does."""
    x, y, yaw = start[0], start[1], start[2]
    for t in range(len(controls)):
        sine, cosine = sine_cosine(yaw)
        x += (controls[t, 0] * cosine - controls[t, 1] * sine) * dt
        y += (controls[t, 0] * sine + controls[t, 1] * cosine) * dt
        yaw += controls[t, 2] * dt
        points[t, 0] = x
        points[t, 1] = y
        points[t, 2] = yaw
