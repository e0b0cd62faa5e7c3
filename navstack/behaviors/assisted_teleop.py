"""assisted_teleop of Nav2: a person drives, and the speed falls before obstacles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors.base import TimedBehavior, first_obstacle
from navstack.behaviors.errors import AssistedTeleopTimeoutError
from navstack.core import Pose2D, RobotState, Transform2D, Twist2D
from navstack.plugins import (
    RECOVERY_BEHAVIORS,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    LocalPlan,
    ParamModel,
    param,
)

HELD_S: Final = 0.5
"""A command of the person counts for so long (s), as in the default command multiplexer."""
MAX_STEPS: Final = 1000
"""Largest number of poses of a projection."""


class AssistedTeleopParams(ParamModel):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "cmd_vel_teleop": "the commands are those of teleop in scenarios, or of motions.drive in Python",
    }

    time_allowance: float = param(10.0, "time after which it ends as a failure", unit="s", gt=0.0)
    cycle_frequency: float = param(10.0, "rate of the commands", unit="Hz", gt=0.0)
    projection_time: float = param(1.0, "time ahead to check for collisions", unit="s", gt=0.0)
    simulation_time_step: float = param(0.1, "time between two poses that are checked", unit="s", gt=0.0)


@RECOVERY_BEHAVIORS.register(
    "assisted_teleop", aliases=("nav2_behaviors/AssistedTeleop", "nav2_recoveries/AssistedTeleop")
)
class AssistedTeleop(TimedBehavior[AssistedTeleopParams]):
    """Lets a person drive for at most `time_allowance`, slower before obstacles.

    The footprint is projected along the person's command. If it is not free after the time t, the command is multiplied by
    t / projection_time; if it is not free in the first step, the robot stops. While this behavior runs, `MoveBase.motions.drive`
    (and teleop in scenarios) gives it the commands instead of the robot. Source: Nav2 (nav2_behaviors/AssistedTeleop).

    # Nav2 differs: there, the last command holds until the next one; here for 0.5 s.
    """

    Params = AssistedTeleopParams
    timeout = AssistedTeleopTimeoutError

    def __init__(self, name: str, params: AssistedTeleopParams) -> None:
        super().__init__(name, params)
        self._asked = Twist2D()
        self._asked_at = -math.inf
        self._released = False

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.cycle_frequency

    def take(self, twist: Twist2D, now: float) -> None:
        """Take a command of the person at `now` (s)."""
        self._asked, self._asked_at = twist, now

    def preempt(self) -> None:
        """End successfully in the next step, as Nav2 does on a message on `preempt_teleop`."""
        self._released = True

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start without a command."""
        super().start(context, now)
        self._asked, self._asked_at, self._released = Twist2D(), -math.inf, False

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Return the time allowance of the parameters."""
        del pose, state, now
        return self.params.time_allowance

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the person's command, at most at the limits of the local planner."""
        del pose, state
        if self._released:
            return BehaviorStep(BehaviorStatus.DONE, text=f"{self.name}: the person ended it")
        limits = self.context.local_planner.limits
        asked = self._asked if now - self._asked_at <= HELD_S else Twist2D()
        wanted = (math.hypot(asked.vx, asked.vy), limits.max_vel_trans), (abs(asked.wz), limits.max_vel_theta)
        factor = min((limit / value for value, limit in wanted if value > limit), default=1.0)
        left = self.started_at + self.allowance - now
        text = "" if self.has_begun else f"{self.name}: a person drives, for at most {self.allowance:g} s"
        return BehaviorStep(BehaviorStatus.RUNNING, _scaled(asked, factor), text, {"left_s": max(0.0, left)})

    def checked(self, step: BehaviorStep, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the step with its command multiplied by the free share of the projection."""
        del state
        factor, twist = 1.0, step.twist
        if tuple(twist) != (0.0, 0.0, 0.0):
            ahead = self.projected(twist)
            obstacle = first_obstacle(self.context, pose, now, ahead, known=False)
            if obstacle is not None:
                free = obstacle.index * self.params.simulation_time_step
                factor = (
                    min(1.0, (free + self.params.simulation_time_step) / self.params.projection_time) if free else 0.0
                )
            notes = () if obstacle is None else (f"{factor:.0%} of the command: {obstacle} ahead",)
            seen = Transform2D(*pose).apply_poses(ahead)
            self.local_plan = LocalPlan(_scaled(twist, factor), self.name, trajectory=seen, notes=notes)
        return BehaviorStep(step.status, _scaled(twist, factor), step.text, {**step.data, "factor": factor})

    def projected(self, twist: Twist2D) -> NDArray[np.float64]:
        """Return the poses (n, 3) in the base frame after each `simulation_time_step`, up to `projection_time`."""
        p = self.params
        count = min(max(1, math.ceil(p.projection_time / p.simulation_time_step - 1e-9)), MAX_STEPS)
        poses, at = np.empty((count, 3)), Transform2D()
        step = Transform2D(*(value * p.simulation_time_step for value in twist))
        for k in range(count):
            # as in Nav2, each step is straight along the heading at its beginning
            at = at @ step
            poses[k] = at.x, at.y, at.yaw
        return poses

    def summary(self) -> str:
        """Return that the person did not end it."""
        return f"{self.name}: the person did not end it"


def _scaled(twist: Twist2D, factor: float) -> Twist2D:
    return Twist2D(*(factor * value for value in twist)) if factor else Twist2D()
