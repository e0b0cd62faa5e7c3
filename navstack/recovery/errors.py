"""Why a behaviour that moves or waits gave up, with the numbers of Nav2's actions (nav2_msgs: Spin, BackUp, DriveOnHeading)."""

from __future__ import annotations

from navstack.core.errors import CollisionAheadError, ParameterError, RecoveryError


class SpinTimeoutError(RecoveryError):
    """The turn took longer than its time_allowance."""

    code = 701
    name = "TIMEOUT"


class BackUpTimeoutError(RecoveryError):
    """Backing up took longer than its time_allowance."""

    code = 711
    name = "TIMEOUT"


class BackUpCollisionError(CollisionAheadError):
    """Something is behind the robot."""

    code = 714
    name = "COLLISION_AHEAD"


class DriveOnHeadingTimeoutError(RecoveryError):
    """The drive took longer than its time_allowance."""

    code = 721
    name = "TIMEOUT"


class DriveOnHeadingCollisionError(CollisionAheadError):
    """Something is in the robot's way."""

    code = 723
    name = "COLLISION_AHEAD"


class DriveOnHeadingInputError(ParameterError):
    """Distance and speed point in opposite directions."""

    code = 724
    name = "INVALID_INPUT"
