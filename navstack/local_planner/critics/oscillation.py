# pyright: basic
"""Rejects reversals of direction (base_local_planner/src/oscillation_cost_function.cpp)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Twist2D, plain_kernel
from navstack.plugins import CRITICS, Critic, ParamModel, Rollouts, ScoringContext, param

REVERSAL = -5.0
AXES = ("forward", "strafe", "rot")


class OscillationParams(ParamModel):
    """Motion after which a forbidden direction is allowed again."""

    oscillation_reset_dist: float = param(0.05, "motion that allows every direction again", unit="m", ge=0.0)
    oscillation_reset_angle: float = param(0.2, "turn that allows every direction again", unit="rad", ge=0.0)


@CRITICS.register("oscillation", aliases=("base_local_planner/OscillationCostFunction",))
class OscillationCritic(Critic[OscillationParams]):
    """Rejects rollouts in a direction that the robot has just left.

    When the selected vx changes its sign, the previous sign is forbidden until the robot has moved or turned far enough.
    The same holds for vy and wz, which are considered only while |vx| is at most min_vel_trans.
    """

    Params: ClassVar[type[ParamModel]] = OscillationParams
    CODES: ClassVar[dict[int, str]] = {int(REVERSAL): "turns back to a direction it has just left"}

    def __init__(self, name: str, params: OscillationParams) -> None:
        super().__init__(name, params)
        self._last_sign = [0, 0, 0]
        self._since = Pose2D(0.0, 0.0)
        self._min_vel_trans = 0.0
        self._out = np.empty(0)
        self.allowed_signs = [0, 0, 0]
        """Per axis (vx, vy, wz) the only allowed sign, 0 if both are allowed."""

    def reset(self) -> None:
        """Allow every direction."""
        self._last_sign = [0, 0, 0]
        self.allowed_signs = [0, 0, 0]

    def prepare(self, context: ScoringContext) -> None:
        """Store the lowest speed of this cycle."""
        self._min_vel_trans = context.limits.min_vel_trans

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) 0, or -5 for a forbidden direction."""
        k = len(rollouts.counts)
        if len(self._out) != k:
            self._out = np.empty(k)
        forward, strafe, rotation = self.allowed_signs
        oscillation_scores(rollouts.commands, forward, strafe, rotation, self._out)
        return self._out

    def debrief(self, command: Twist2D, pose: Pose2D) -> None:
        """Update the flags with the selected command."""
        axes = (0, 1, 2) if abs(command.vx) <= self._min_vel_trans else (0,)
        changed = False
        for axis in axes:
            sign = (command[axis] > 0.0) - (command[axis] < 0.0)
            if sign:
                if self._last_sign[axis] == -sign:
                    self.allowed_signs[axis] = sign
                    changed = True
                self._last_sign[axis] = sign
        if changed:
            self._since = pose
        if any(self.allowed_signs):
            # poses and their difference are float32 in C++, the rest is double
            along, across, turned = (np.array(pose, np.float32) - np.array(self._since, np.float32)).tolist()
            p = self.params
            farthest = p.oscillation_reset_dist * p.oscillation_reset_dist
            if along * along + across * across > farthest or abs(turned) > p.oscillation_reset_angle:
                self.reset()

    def state(self) -> dict[str, Any]:
        """The flags by their C++ names: `rot_pos_only` is true if only positive turning speeds are allowed."""
        flags: dict[str, Any] = {}
        for axis, sign in zip(AXES, self.allowed_signs):
            flags[f"{axis}_pos_only"] = sign > 0
            flags[f"{axis}_neg_only"] = sign < 0
        return flags


@plain_kernel
def oscillation_scores(commands, sign_x, sign_y, sign_theta, out):
    """Write REVERSAL for each command against the only allowed sign of an axis, else 0, to `out` (K,).

    Signs: 1, -1, or 0 to allow both.
    """
    for k in range(len(commands)):
        reversal = commands[k, 0] * sign_x < 0.0 or commands[k, 1] * sign_y < 0.0 or commands[k, 2] * sign_theta < 0.0
        out[k] = REVERSAL if reversal else 0.0
