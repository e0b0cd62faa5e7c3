"""drive_on_heading: straight on, or straight back, for a distance.

Source of behaviour and names: Nav2 (nav2_behaviors/DriveOnHeading, nav2_behavior_tree's node). move_base has none.
"""

from __future__ import annotations

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import RecoveryContext
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.errors import (
    DriveOnHeadingCollisionError,
    DriveOnHeadingInputError,
    DriveOnHeadingTimeoutError,
)
from navstack.recovery.straight import StraightRecovery


class DriveOnHeadingParams(ParamModel):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    dist_to_travel: float = param(0.15, "how far, backwards when negative", unit="m")
    speed: float = param(0.025, "same sign as the distance; the local planner's limit permitting", unit="m/s")
    time_allowance: float = param(10.0, "how long it may take", unit="s", gt=0.0)
    simulate_ahead_time: float = param(2.0, "how far ahead to look for a collision, in time", unit="s", ge=0.0)
    cycle_frequency: float = param(10.0, "commands per second", unit="Hz", gt=0.0)
    disable_collision_checks: bool = param(False, "drive without looking")


@RECOVERY_BEHAVIORS.register(
    "drive_on_heading", aliases=("nav2_behaviors/DriveOnHeading", "nav2_recoveries/DriveOnHeading")
)
class DriveOnHeading(StraightRecovery):
    """Drives `dist_to_travel` straight; before each command the whole outline is checked, as far as it will go."""

    Params = DriveOnHeadingParams
    params: DriveOnHeadingParams

    def check(self, context: RecoveryContext) -> None:
        """Raises DriveOnHeadingInputError when distance and speed point in opposite directions."""
        del context
        p = self.params
        if p.dist_to_travel * p.speed < 0.0:
            raise DriveOnHeadingInputError(
                f"{self.name}: dist_to_travel {p.dist_to_travel:g} m and speed {p.speed:g} m/s point in opposite "
                "directions; give both the same sign",
                parameter=f"{self.name}/speed",
            )

    def start(self, context: RecoveryContext, now: float) -> None:
        """Measured from the pose at the first step; raises as `check` does."""
        self.check(context)
        p = self.params
        self.drive(
            context,
            now,
            distance=p.dist_to_travel,
            speed=p.speed,
            timeout=DriveOnHeadingTimeoutError,
            collision=DriveOnHeadingCollisionError,
        )
