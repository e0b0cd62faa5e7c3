"""Tracking controllers of a base that cannot move sideways: from the error to the reference to a velocity.

The error (x, y, yaw) is the reference pose in the robot's frame: x along, y to the left.

- `kanayama`: v = vr cos yaw + k_x x, w = wr + vr (k_y y + k_theta sin yaw). Kanayama, Kimura, Miyazaki, Noguchi, A stable
  tracking control method for an autonomous mobile robot, ICRA 1990.
- `samson`: v = vr cos yaw + k1 x, w = wr + b vr sinc(yaw) y + k1 yaw with k1 = 2 damping sqrt(wr² + b vr²), b the stiffness.
  Samson, Time-varying feedback stabilization of car-like wheeled mobile robots, 1993, with the gains of De Luca, Oriolo,
  Vendittelli, Control of wheeled mobile robots: an experimental overview, 2001.

Kanayama's is the default: on curves driven at 0.4 m/s by a base with a lag of 0.1 s its errors are smaller (its gain along the
path does not fall with the speed), with slip and noise they are the same (docs/tutorials/motions.md has the figures). Both have
the same damping at every speed, k_theta / (2 sqrt(k_y)) and `damping`. Samson's corrects the heading also on a turn without
speed, and converges from a heading error of pi, where Kanayama's sine is 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from navstack.core import Pose2D, normalize_angle
from navstack.parameters.models.motion import MotionParams


class TrackingError(NamedTuple):
    """The reference in the robot's frame."""

    x: float
    """m ahead."""
    y: float
    """m to the left."""
    yaw: float
    """rad."""

    @property
    def distance(self) -> float:
        """Distance to the reference (m)."""
        return math.hypot(self.x, self.y)


def tracking_error(pose: Pose2D, reference: Pose2D) -> TrackingError:
    """Return the error of a robot at `pose`; both in one frame."""
    dx, dy = reference.x - pose.x, reference.y - pose.y
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return TrackingError(c * dx + s * dy, c * dy - s * dx, normalize_angle(reference.yaw - pose.yaw))


def track(error: TrackingError, speed: float, turn_rate: float, params: MotionParams) -> tuple[float, float]:
    """Return the speed (m/s) and turn rate (rad/s) for an error and the reference's own speed and turn rate.

    A negative speed drives backwards; the reference's heading is always that of the robot's front.
    """
    if params.tracking == "kanayama":
        v = speed * math.cos(error.yaw) + params.k_x * error.x
        # driving backwards, the sign of the heading's gain changes with the direction
        w = turn_rate + speed * params.k_y * error.y + abs(speed) * params.k_theta * math.sin(error.yaw)
        return v, w
    gain = 2.0 * params.damping * math.sqrt(turn_rate * turn_rate + params.stiffness * speed * speed)
    sinc = math.sin(error.yaw) / error.yaw if abs(error.yaw) > 1e-6 else 1.0
    return (
        speed * math.cos(error.yaw) + gain * error.x,
        turn_rate + params.stiffness * speed * sinc * error.y + gain * error.yaw,
    )
