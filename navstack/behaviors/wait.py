"""wait: stand still for some time, so that people or robots can leave the path."""

from __future__ import annotations

import math
from typing import Any

from navstack.behaviors.base import TimedBehavior
from navstack.behaviors.errors import InvalidMotionError
from navstack.core import Pose2D, RobotState
from navstack.parameters import MotionParams
from navstack.plugins import RECOVERY_BEHAVIORS, BehaviorStatus, BehaviorStep, ParamModel, param


class WaitParams(ParamModel):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    wait_duration: float = param(1.0, "time to stand still", unit="s", ge=0.0)


@RECOVERY_BEHAVIORS.register("wait", aliases=("nav2_behaviors/Wait", "nav2_recoveries/Wait"))
class Wait(TimedBehavior[WaitParams]):
    """Commands zero velocity for `wait_duration`. It cannot fail.

    Source of behavior and names: Nav2 (nav2_behaviors/Wait, nav2_behavior_tree's Wait node). move_base has none.
    """

    Params = WaitParams

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return zero velocity."""
        del pose, state
        duration = self.params.wait_duration
        left = self.started_at + duration - now
        if left <= 1e-6:
            return BehaviorStep(BehaviorStatus.DONE, text=f"{self.name}: waited {duration:g} s", data={"left_s": 0.0})
        text = f"{self.name}: waiting for {duration:g} s" if now == self.started_at else ""
        return BehaviorStep(BehaviorStatus.RUNNING, text=text, data={"left_s": left})


class Pause(Wait):
    """A wait of `duration` (s) among motions, at the rate of motions."""

    def __init__(self, duration: float, params: MotionParams | None = None, name: str = "wait") -> None:
        """Raise InvalidMotionError for a negative duration, or one that is not finite."""
        if not (math.isfinite(duration) and duration >= 0.0):
            raise InvalidMotionError(f"{name} takes a time of 0 s or more, not {duration}", duration=duration)
        super().__init__(name, WaitParams(wait_duration=duration))
        self._frequency = (params or MotionParams()).frequency

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self._frequency

    def describe(self) -> dict[str, Any]:
        """Return the duration (s)."""
        return {"wait": self.params.wait_duration}

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return zero velocity; the text and the data are those of motions."""
        step = super().command(pose, state, now)
        if step.status is BehaviorStatus.DONE:
            return BehaviorStep(step.status, text=f"{self.name} waited {self.params.wait_duration:g} s")
        return BehaviorStep(step.status, data=step.data)
