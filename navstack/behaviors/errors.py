"""Errors of behaviors and trajectories.

Codes of 90xx are navstack's own; the others are those of Nav2's actions (nav2_msgs: Spin, BackUp, DriveOnHeading).
"""

from __future__ import annotations

from navstack.core import CollisionAheadError, InputError, ParameterError, RecoveryError


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


class SpinTimeoutError(RecoveryError):
    """The turn took longer than its time_allowance."""

    code = 701
    name = "TIMEOUT"


class CannotTurnError(RecoveryError):
    """The base has a turning radius, so that it cannot turn in place."""

    code = 9024
    name = "CANNOT_TURN_IN_PLACE"


class BackUpTimeoutError(RecoveryError):
    """Backing up took longer than its time_allowance."""

    code = 711
    name = "TIMEOUT"


class BackUpCollisionError(CollisionAheadError):
    """The robot would collide while backing up."""

    code = 714
    name = "COLLISION_AHEAD"


class DriveOnHeadingTimeoutError(RecoveryError):
    """The drive took longer than its time_allowance."""

    code = 721
    name = "TIMEOUT"


class DriveOnHeadingCollisionError(CollisionAheadError):
    """The robot would collide on its straight path."""

    code = 723
    name = "COLLISION_AHEAD"


class DriveOnHeadingInputError(ParameterError):
    """Distance and speed have opposite signs."""

    code = 724
    name = "INVALID_INPUT"


class AssistedTeleopTimeoutError(RecoveryError):
    """The person did not end assisted_teleop within its time_allowance."""

    code = 731
    name = "TIMEOUT"
