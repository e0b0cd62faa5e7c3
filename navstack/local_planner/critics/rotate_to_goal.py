"""At the goal's position: slow down, then only turn (RotateToGoalCritic of Nav2's dwb_critics).

The planners of ROS 1 brake and turn at the goal themselves; DWB needs this critic.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D
from navstack.plugins import CRITICS, Critic, ParamModel, Rollouts, ScoringContext, param

NOT_SLOWER, NOT_TURNING = -7.0, -8.0


class RotateToGoalParams(ParamModel):
    """Weight, distance from the goal at which the critic starts, and how it slows the robot down."""

    RENAMED: ClassVar[Mapping[str, str]] = {"trans_stopped_vel": "trans_stopped_velocity"}

    scale: float = param(1.0, "weight of this critic", ge=0.0)
    xy_goal_tolerance: float = param(0.25, "distance from the goal at which this critic starts", unit="m", ge=0.0)
    path_length_tolerance: float = param(
        1.0,
        "this critic does not start while more of the local path is left",
        unit="m",
        ge=0.0,
        ros_differs="cannot be set there: its name lacks a dot",
    )
    trans_stopped_velocity: float = param(
        0.25, "speed up to which the robot counts as stopped; from then on it only turns", unit="m/s", ge=0.0
    )
    slowing_factor: float = param(5.0, "cost of the squared speed (m²/s²) until stopped", ge=0.0)
    lookahead_time: float = param(
        -1.0,
        "time along the trajectory at which the heading is compared; negative: at its end",
        unit="s",
        ros_differs="reads beyond the end of the trajectory there",
    )


@CRITICS.register("rotate_to_goal", aliases=("dwb_critics/RotateToGoalCritic", "RotateToGoal"))
class RotateToGoalCritic(Critic[RotateToGoalParams]):
    """Zero until the robot is within `xy_goal_tolerance` of the goal; then allows only slower commands, then only turns.

    A legal rollout costs its heading error at the goal (rad) and, until the robot has stopped, the squared speed times
    `slowing_factor`. Both phases last until the next plan. DWA brakes and turns at its own xy_goal_tolerance without
    critics: with a larger tolerance here the robot would stop in between. Use this critic with planners that have no such
    phase, and for lists of critics taken from Nav2.
    """

    Params: ClassVar[type[ParamModel]] = RotateToGoalParams
    CODES: ClassVar[dict[int, str]] = {
        int(NOT_SLOWER): "Not slowing down near goal.",
        int(NOT_TURNING): "Nonrotation command near goal.",
    }

    def __init__(self, name: str, params: RotateToGoalParams) -> None:
        super().__init__(name, params)
        self.near, self.rotating = False, False
        self._squared_speed = 0.0
        self._goal: Pose2D | None = None

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

    def reset(self) -> None:
        """Begin again: the robot is on its way."""
        self.near = self.rotating = False

    def prepare(self, context: ScoringContext) -> None:
        """Update the phase."""
        p, pose, velocity = self.params, context.state.pose, context.state.velocity
        goal = self._goal = context.goal
        self._squared_speed = velocity.vx * velocity.vx + velocity.vy * velocity.vy
        dx, dy = pose.x - goal.x, pose.y - goal.y
        if not self.near and dx * dx + dy * dy <= p.xy_goal_tolerance * p.xy_goal_tolerance:
            steps = np.diff(context.plan[:, :2], axis=0)
            self.near = float(np.hypot(steps[:, 0], steps[:, 1]).sum()) <= p.path_length_tolerance
        stopped = self._squared_speed <= p.trans_stopped_velocity * p.trans_stopped_velocity
        self.rotating = self.rotating or (self.near and stopped)

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) 0 far from the goal; near it the cost, -7 or -8."""
        k = len(rollouts.counts)
        if self._goal is None or not self.near or rollouts.poses.shape[1] == 0:
            return np.zeros(k)
        vx, vy = rollouts.commands[:, 0], rollouts.commands[:, 1]
        heading = heading_errors(rollouts, self._goal.yaw, self.params.lookahead_time)
        if self.rotating:
            return np.where((vx != 0.0) | (vy != 0.0), NOT_TURNING, heading)
        squared = vx * vx + vy * vy
        return np.where(squared >= self._squared_speed, NOT_SLOWER, squared * self.params.slowing_factor + heading)

    def state(self) -> dict[str, Any]:
        """The phase."""
        return {"in_window": self.near, "rotating": self.rotating}


def heading_errors(rollouts: Rollouts, goal_yaw: float, lookahead_time: float) -> NDArray[np.float64]:
    """(K,) angle between `goal_yaw` and the heading of each rollout, at its end or after `lookahead_time` (s).

    Between two points the heading is interpolated. Rollouts that do not say how long a step takes (`Rollouts.seconds`) turn at
    the speed of their commands.
    """
    rows, last = np.arange(len(rollouts.counts)), np.maximum(rollouts.counts - 1, 0)
    yaws = rollouts.poses[rows, last, 2]
    if lookahead_time >= 0.0 and rollouts.seconds is not None:
        steps = np.minimum(lookahead_time / rollouts.seconds, last)
        before = steps.astype(np.int64)
        after = np.minimum(before + 1, last)
        yaws = rollouts.poses[rows, before, 2]
        turned = rollouts.poses[rows, after, 2] - yaws
        yaws = yaws + (steps - before) * np.arctan2(np.sin(turned), np.cos(turned))
    elif lookahead_time >= 0.0:
        first = rollouts.poses[:, 0, 2]
        ahead = rollouts.commands[:, 2] * lookahead_time
        turned = np.arctan2(np.sin(yaws - first), np.cos(yaws - first))
        # at most the simulated turn, if that is less than half a turn
        yaws = first + np.where(np.abs(ahead) < np.abs(turned), ahead, turned)
    # the rounding of angles::shortest_angular_distance: totals of equal samples must not differ
    left = np.fmod(goal_yaw - yaws + math.pi, 2.0 * math.pi)
    return np.abs(np.where(left <= 0.0, left + math.pi, left - math.pi))
