"""A recovery behavior: turn a little to one side, then back to the other."""

from __future__ import annotations

import math

from navstack.plugins import (
    LETHAL,
    ParamModel,
    RecoveryBehavior,
    RecoveryContext,
    RecoveryStatus,
    RecoveryStep,
    RobotState,
    Twist2D,
    param,
    turn_cost,
)


class NudgeParams(ParamModel):
    """Namespace: the name of the instance."""

    angle: float = param(0.35, "turn to each side", unit="rad", gt=0.0, le=3.0)
    duration: float = param(1.0, "time per side", unit="s", gt=0.0, le=10.0)


class NudgeRecovery(RecoveryBehavior):
    """Turns left and right in place. Fails before it moves if the footprint would collide."""

    Params = NudgeParams

    def start(self, context: RecoveryContext, now: float) -> None:
        """Called once before the first step."""
        self.context = context
        self.began = now

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """One command per control cycle: left for `duration`, then right for twice as long, then left."""
        phase = (now - self.began) / self.params.duration
        if phase >= 4.0:
            return RecoveryStep(RecoveryStatus.DONE, text=f"{self.name}: turned to both sides")
        sign = 1.0 if phase < 1.0 or phase >= 3.0 else -1.0
        costmap = self.context.local_costmap
        cost, _ = turn_cost(costmap.master, costmap.footprint, state.pose, sign * self.params.angle)
        if cost is None or cost >= LETHAL:
            return RecoveryStep(RecoveryStatus.FAILED, text=f"{self.name}: no room to turn")
        speed = min(self.params.angle / self.params.duration, self.context.local_planner.limits.max_vel_theta)
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(0.0, 0.0, math.copysign(speed, sign)))
