"""Rollouts of velocity sequences, as MPPI samples them, for navstack's critics.

Critics score any rollouts, given their poses and the velocities to command:

    driven, rollouts = simulate_sequences(velocities, state, limits, period)
    table = score(critics, context, rollouts)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from _velocity_sequence_kernels import constrain, integrate
from numpy.typing import NDArray

from navstack.core import InputError, RobotState
from navstack.local_planner.rollouts import check_points
from navstack.plugins import Rollouts, VelocityLimits


@dataclass(frozen=True, slots=True)
class MotionModel:
    """Motion constraints of a base."""

    sideways: bool = False
    """True for an omnidirectional base."""
    min_turning_radius: float = 0.0
    """Smallest turning radius (m) of an Ackermann base; 0 for a base that turns in place."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.min_turning_radius) and self.min_turning_radius >= 0.0):
            raise InputError(
                f"min_turning_radius must be a length of at least 0, not {self.min_turning_radius}",
                min_turning_radius=self.min_turning_radius,
            )


DIFFERENTIAL = MotionModel()
OMNIDIRECTIONAL = MotionModel(sideways=True)


def ackermann(min_turning_radius: float) -> MotionModel:
    """An Ackermann base with this turning radius (m)."""
    return MotionModel(min_turning_radius=min_turning_radius)


def simulate_sequences(
    velocities: NDArray[np.float64],
    state: RobotState,
    limits: VelocityLimits,
    period: float,
    model: MotionModel = DIFFERENTIAL,
) -> tuple[NDArray[np.float64], Rollouts]:
    """Simulate `velocities` (K, T, 3), one per `period` (s). Returns the drivable velocities and their rollouts.

    The velocities are clamped to the limits, the accelerations and the motion model. Raises InputError for arrays of another
    shape, values that are not finite, and more than MAX_POINTS points.
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
    integrate(driven, np.array(state.pose), period, poses)
    return driven, Rollouts(np.ascontiguousarray(driven[:, 0]), poses, np.full(k, t, np.int64))
