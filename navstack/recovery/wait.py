"""wait: stand still for some time, so that people or robots can leave the path.

Source of behavior and names: Nav2 (nav2_behaviors/Wait, nav2_behavior_tree's Wait node). move_base has none.
"""

from __future__ import annotations

from navstack.core import RobotState
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.plugins import RECOVERY_BEHAVIORS


class WaitParams(ParamModel):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    wait_duration: float = param(1.0, "time to stand still", unit="s", ge=0.0)


@RECOVERY_BEHAVIORS.register("wait", aliases=("nav2_behaviors/Wait", "nav2_recoveries/Wait"))
class Wait(RecoveryBehavior):
    """Commands zero velocity for `wait_duration`. It cannot fail."""

    Params = WaitParams
    params: WaitParams

    def __init__(self, name: str, params: WaitParams) -> None:
        super().__init__(name, params)
        self._started_at = 0.0

    def start(self, context: RecoveryContext, now: float) -> None:
        """Start the wait at `now` (s)."""
        del context
        self._started_at = now

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return zero velocity."""
        del state
        duration = self.params.wait_duration
        left = self._started_at + duration - now
        if left <= 1e-6:
            return RecoveryStep(RecoveryStatus.DONE, text=f"{self.name}: waited {duration:g} s", data={"left_s": 0.0})
        text = f"{self.name}: waiting for {duration:g} s" if now == self._started_at else ""
        return RecoveryStep(RecoveryStatus.RUNNING, text=text, data={"left_s": left})
