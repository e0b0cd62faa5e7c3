"""back_up: reverse a little, away from an obstacle in front.

Source of behavior and names: Nav2 (nav2_behaviors/BackUp, nav2_behavior_tree's BackUp node). move_base has none.
"""

from __future__ import annotations

from navstack.core.parameters import param
from navstack.interfaces import RecoveryContext
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.errors import BackUpCollisionError, BackUpTimeoutError
from navstack.recovery.motion import MotionParams
from navstack.recovery.straight import StraightMotion, StraightRecovery


class BackUpParams(MotionParams):
    """Namespace: the instance's name. Names and defaults as in Nav2; the signs of distance and speed are ignored."""

    backup_dist: float = param(0.15, "distance to reverse", unit="m")
    backup_speed: float = param(0.025, "speed, limited by the local planner's", unit="m/s")


@RECOVERY_BEHAVIORS.register("back_up", aliases=("nav2_behaviors/BackUp", "nav2_recoveries/BackUp"))
class BackUp(StraightRecovery):
    """Reverses `backup_dist`. Before each command the whole footprint is checked along the path on the local costmap."""

    Params = BackUpParams
    params: BackUpParams

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start from the pose of the first step."""
        p = self.params
        motion = StraightMotion(-abs(p.backup_dist), abs(p.backup_speed), BackUpTimeoutError, BackUpCollisionError)
        self.begin(context, now, motion)
