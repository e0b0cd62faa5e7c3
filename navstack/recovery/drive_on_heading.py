"""drive_on_heading: drive straight forwards or backwards for a distance.

Source of behavior and names: Nav2 (nav2_behaviors/DriveOnHeading, nav2_behavior_tree's node). move_base has none.
"""

from __future__ import annotations

from navstack.core.parameters import param
from navstack.interfaces import RecoveryContext
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.errors import (
    DriveOnHeadingCollisionError,
    DriveOnHeadingInputError,
    DriveOnHeadingTimeoutError,
)
from navstack.recovery.motion import MotionParams
from navstack.recovery.straight import StraightMotion, StraightRecovery


class DriveOnHeadingParams(MotionParams):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    dist_to_travel: float = param(0.15, "distance to drive, backwards if negative", unit="m")
    speed: float = param(0.025, "speed with the sign of the distance, limited by the local planner's", unit="m/s")


@RECOVERY_BEHAVIORS.register(
    "drive_on_heading", aliases=("nav2_behaviors/DriveOnHeading", "nav2_recoveries/DriveOnHeading")
)
class DriveOnHeading(StraightRecovery):
    """Drives `dist_to_travel` straight. Before each command the whole footprint is checked along the path."""

    Params = DriveOnHeadingParams
    params: DriveOnHeadingParams

    def check(self, context: RecoveryContext) -> None:
        """Raise DriveOnHeadingInputError if distance and speed have opposite signs."""
        del context
        p = self.params
        if p.dist_to_travel * p.speed < 0.0:
            raise DriveOnHeadingInputError(
                f"{self.name}: dist_to_travel {p.dist_to_travel:g} m and speed {p.speed:g} m/s point in opposite "
                "directions; give both the same sign",
                parameter=f"{self.name}/speed",
            )

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start from the pose of the first step. Raises as `check` does."""
        self.check(context)
        p = self.params
        motion = StraightMotion(
            p.dist_to_travel, abs(p.speed), DriveOnHeadingTimeoutError, DriveOnHeadingCollisionError
        )
        self.begin(context, now, motion)
