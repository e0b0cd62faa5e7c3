"""Errors of the recovery behaviors, with the codes of Nav2's actions (nav2_msgs: Spin, BackUp, DriveOnHeading)."""

from __future__ import annotations

from navstack.core.errors import CollisionAheadError, ParameterError, RecoveryError


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
