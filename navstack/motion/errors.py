"""Errors of motions and trajectories. The codes are navstack's own: Nav2 has no such actions."""

from __future__ import annotations

from navstack.core.errors import CollisionAheadError, InputError, RecoveryError


class InvalidTrajectoryError(InputError):
    """A trajectory is empty, not finite, or its times do not increase."""

    code = 9050
    name = "INVALID_TRAJECTORY"


class InfeasibleTrajectoryError(InputError):
    """The robot cannot follow a trajectory; `data` has the limits that it breaks, and when."""

    code = 9051
    name = "INFEASIBLE_TRAJECTORY"


class InvalidMotionError(InputError):
    """A motion cannot be executed by this robot, or its arguments are invalid."""

    code = 9052
    name = "INVALID_MOTION"


class MotionTimeoutError(RecoveryError):
    """A motion took longer than its time allowance."""

    code = 9053
    name = "TIMEOUT"


class MotionCollisionError(CollisionAheadError):
    """A motion stopped before an obstacle."""

    code = 9054
    name = "COLLISION_AHEAD"


class TrackingLostError(RecoveryError):
    """The robot is too far from the trajectory that it follows."""

    code = 9055
    name = "TRACKING_LOST"
