"""At the goal's position: slow down, then only turn (RotateToGoalCritic of Nav2's dwb_critics).

move_base needs no such critic: its planners brake and turn at the goal themselves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D
from navstack.plugins import CRITICS, Critic, ParamModel, Rollouts, ScoringContext, param

NOT_SLOWER, NOT_TURNING = -7.0, -8.0


class RotateToGoalParams(ParamModel):
    """Weight, distance from the goal at which the critic starts, and how it slows the robot down."""

    RENAMED: ClassVar[Mapping[str, str]] = {"trans_stopped_velocity": "trans_stopped_vel"}

    scale: float = param(1.0, "weight of this critic", ge=0.0)
    xy_goal_tolerance: float = param(0.25, "distance from the goal at which this critic starts", unit="m", ge=0.0)
    trans_stopped_vel: float = param(
        0.25, "speed below which the robot counts as stopped; from then on it only turns", unit="m/s", ge=0.0
    )
    slowing_factor: float = param(5.0, "cost of the squared speed (m²/s²) until stopped", ge=0.0)
    lookahead_time: float = param(
        -1.0, "time along the trajectory at which the heading is compared; negative: at its end", unit="s"
    )


@CRITICS.register("rotate_to_goal", aliases=("dwb_critics/RotateToGoalCritic", "RotateToGoal"))
class RotateToGoalCritic(Critic[RotateToGoalParams]):
    """Zero until the robot is within `xy_goal_tolerance` of the goal; then allows only slower commands, then only turns.

    A legal rollout costs its heading error at the goal (rad) and, until the robot has stopped, the squared speed times
    `slowing_factor`. Both phases last until the goal changes. DWA brakes and turns at its own xy_goal_tolerance without
    critics: with a larger tolerance here the robot would stop in between. Use this critic with planners that have no such
    phase, and for lists of critics taken from Nav2.
    """

    Params: ClassVar[type[ParamModel]] = RotateToGoalParams
    CODES: ClassVar[dict[int, str]] = {-7: "does not slow down near the goal", -8: "does more than turn at the goal"}

    def __init__(self, name: str, params: RotateToGoalParams) -> None:
        super().__init__(name, params)
        self._near, self._stopped = False, False
        self._speed = 0.0
        self._goal: Pose2D | None = None

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

    def prepare(self, context: ScoringContext) -> None:
        """Update the phase."""
        p = self.params
        if context.goal != self._goal:
            self._near = self._stopped = False
            self._goal = context.goal
        self._speed = context.state.velocity.speed
        self._near = self._near or context.state.pose.distance_to(context.goal) <= p.xy_goal_tolerance
        self._stopped = self._stopped or (self._near and self._speed <= p.trans_stopped_vel)

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) 0 far from the goal; near it the cost, -7 or -8."""
        k = len(rollouts.counts)
        if self._goal is None or not self._near or rollouts.poses.shape[1] == 0:
            return np.zeros(k)
        p, commands = self.params, rollouts.commands
        speed = np.hypot(commands[:, 0], commands[:, 1])
        heading = self._heading_errors(rollouts, self._goal.yaw)
        if self._stopped:
            return np.where(speed > 0.0, NOT_TURNING, heading)
        return np.where(speed >= self._speed, NOT_SLOWER, speed * speed * p.slowing_factor + heading)

    def _heading_errors(self, rollouts: Rollouts, goal_yaw: float) -> NDArray[np.float64]:
        """(K,) angle between the goal's heading and that of each rollout, at its end or after `lookahead_time`."""
        rows = np.arange(len(rollouts.counts))
        first, last = rollouts.poses[:, 0, 2], rollouts.poses[rows, np.maximum(rollouts.counts - 1, 0), 2]
        if self.params.lookahead_time >= 0.0:
            ahead = rollouts.commands[:, 2] * self.params.lookahead_time
            turned = np.arctan2(np.sin(last - first), np.cos(last - first))
            # at most the simulated turn, if that is less than half a turn
            last = first + np.where(np.abs(ahead) < np.abs(turned), ahead, turned)
        left = (last - goal_yaw + math.pi) % (2.0 * math.pi) - math.pi
        return np.abs(left)
