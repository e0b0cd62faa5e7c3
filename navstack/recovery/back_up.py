"""back_up: reverse a little, to get away from what is in front.

Source of behaviour and names: Nav2 (nav2_behaviors/BackUp, nav2_behavior_tree's BackUp node). move_base has none.
"""

from __future__ import annotations

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import RecoveryContext
from navstack.plugins import RECOVERY_BEHAVIORS
from navstack.recovery.errors import BackUpCollisionError, BackUpTimeoutError
from navstack.recovery.straight import StraightRecovery


class BackUpParams(ParamModel):
    """Namespace: the instance's name. Names and defaults as in Nav2; the signs of distance and speed do not matter."""

    backup_dist: float = param(0.15, "how far to reverse", unit="m")
    backup_speed: float = param(0.025, "at which speed, the local planner's limit permitting", unit="m/s")
    time_allowance: float = param(10.0, "how long it may take", unit="s", gt=0.0)
    simulate_ahead_time: float = param(2.0, "how far ahead to look for a collision, in time", unit="s", ge=0.0)
    cycle_frequency: float = param(10.0, "commands per second", unit="Hz", gt=0.0)
    disable_collision_checks: bool = param(False, "reverse without looking")


@RECOVERY_BEHAVIORS.register("back_up", aliases=("nav2_behaviors/BackUp", "nav2_recoveries/BackUp"))
class BackUp(StraightRecovery):
    """Reverses `backup_dist`; before each command the whole outline is checked on the local costmap, as far as it will go."""

    Params = BackUpParams
    params: BackUpParams

    def start(self, context: RecoveryContext, now: float) -> None:
        """Measured from the pose at the first step."""
        p = self.params
        self.drive(
            context,
            now,
            distance=-abs(p.backup_dist),
            speed=p.backup_speed,
            timeout=BackUpTimeoutError,
            collision=BackUpCollisionError,
        )
