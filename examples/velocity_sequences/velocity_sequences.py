"""Rollouts of sequences of velocities: for samplers as MPPI's, whose trajectories are more than one velocity held.

Critics and scoring take them as they take DWA's: a trajectory is its poses, and the velocity that would be commanded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from _velocity_sequence_kernels import constrain, follow
from numpy.typing import NDArray

from navstack.core import RobotState
from navstack.core.errors import InputError
from navstack.interfaces import Rollouts, VelocityLimits
from navstack.local_planner.rollouts import check_points


@dataclass(frozen=True, slots=True)
class MotionModel:
    """What a base can do at all, whatever is asked of it."""

    sideways: bool = False
    """Omnidirectional."""
    min_turning_radius: float = 0.0
    """The smallest circle (m) it can drive (Ackermann); 0: it turns in place."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.min_turning_radius) and self.min_turning_radius >= 0.0):
            raise InputError(
                f"min_turning_radius must be a length of at least 0, not {self.min_turning_radius}",
                min_turning_radius=self.min_turning_radius,
            )


DIFFERENTIAL = MotionModel()
OMNIDIRECTIONAL = MotionModel(sideways=True)


def ackermann(min_turning_radius: float) -> MotionModel:
    """A car: it cannot turn tighter than on a circle of this radius (m)."""
    return MotionModel(min_turning_radius=min_turning_radius)


def roll_out(
    velocities: NDArray[np.float64],
    state: RobotState,
    limits: VelocityLimits,
    period: float,
    model: MotionModel = DIFFERENTIAL,
) -> tuple[NDArray[np.float64], Rollouts]:
    """What a base makes of `velocities` (K, T, 3), one each `period` (s): (those it can drive, their trajectories).

    The velocities are held within the limits, the accelerations from the present velocity on, and the motion model. Raises
    InputError for an array of another shape, for what is not finite, and for more points than memory should hold.
    """
    if velocities.ndim != 3 or velocities.shape[2] != 3 or 0 in velocities.shape[:2]:
        raise InputError(
            f"velocities must be (K, T, 3), K sequences of T velocities vx, vy, wz, not {velocities.shape}",
            shape=list(velocities.shape),
        )
    k, t = velocities.shape[:2]
    check_points(k, t)
    if not np.isfinite(velocities).all():
        raise InputError("velocities must be finite")
    if not (math.isfinite(period) and period > 0.0):
        raise InputError(f"period must be a time above 0 s, not {period}", period=period)
    driven = np.array(velocities, np.float64, order="C")
    side = 1.0 if model.sideways else 0.0
    constrain(
        driven,
        np.array(state.velocity),
        np.array((limits.min_vel_x, side * limits.min_vel_y, -limits.max_vel_theta)),
        np.array((limits.max_vel_x, side * limits.max_vel_y, limits.max_vel_theta)),
        np.array((limits.acc_lim_x, limits.acc_lim_y, limits.acc_lim_theta)),
        period,
        model.min_turning_radius,
    )
    poses = np.empty((k, t, 3))
    follow(driven, np.array(state.pose), period, poses)
    return driven, Rollouts(np.ascontiguousarray(driven[:, 0]), poses, np.full(k, t, np.int64))
