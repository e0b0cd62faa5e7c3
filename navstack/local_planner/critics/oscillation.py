"""Forbids going back on a change of direction (base_local_planner/src/oscillation_cost_function.cpp)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Twist2D
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.plugins import CRITICS

AXES = ("forward", "strafe", "rot")


class OscillationParams(ParamModel):
    """When a forbidden direction is allowed again."""

    oscillation_reset_dist: float = param(0.05, "motion that allows every direction again", unit="m", ge=0.0)
    oscillation_reset_angle: float = param(0.2, "turn that allows every direction again", unit="rad", ge=0.0)


@CRITICS.register("oscillation", aliases=("base_local_planner/OscillationCostFunction",))
class OscillationCritic(Critic):
    """Rejects trajectories into a direction that was given up a moment ago.

    Once the chosen vx changes its sign, the former sign is forbidden until the robot has moved or turned far enough.
    The same for vy and wz, looked at only while |vx| is at most min_vel_trans.
    """

    Params: ClassVar[type[ParamModel]] = OscillationParams
    CODES: ClassVar[dict[int, str]] = {-5: "turns back to a direction it has just left"}

    def __init__(self, name: str, params: OscillationParams) -> None:
        super().__init__(name, params)
        self._last_sign = [0, 0, 0]
        self._only = [0, 0, 0]
        self._since = Pose2D(0.0, 0.0)

    def prepare(self, context: ScoringContext) -> None:
        """Nothing: the flags change with the command chosen."""

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) 0, or -5 for what goes against a flag."""
        out = np.zeros(len(rollouts.counts))
        for axis, only in enumerate(self._only):
            if only > 0:
                out[rollouts.samples[:, axis] < 0.0] = -5.0
            elif only < 0:
                out[rollouts.samples[:, axis] > 0.0] = -5.0
        return out

    def chosen(self, command: Twist2D, pose: Pose2D, min_vel_trans: float) -> None:
        """Takes note of the command of this cycle, given at `pose`."""
        axes = (0, 1, 2) if abs(command.vx) <= min_vel_trans else (0,)
        changed = False
        for axis in axes:
            sign = (command[axis] > 0.0) - (command[axis] < 0.0)
            if sign:
                if self._last_sign[axis] == -sign:
                    self._only[axis] = sign
                    changed = True
                self._last_sign[axis] = sign
        if changed:
            self._since = pose
        if any(self._only):
            turned = abs(pose.yaw - self._since.yaw)
            p = self.params
            if pose.distance_to(self._since) > p.oscillation_reset_dist or turned > p.oscillation_reset_angle:
                self.reset()

    def reset(self) -> None:
        """Allows every direction."""
        self._last_sign = [0, 0, 0]
        self._only = [0, 0, 0]

    @property
    def only(self) -> tuple[int, int, int]:
        """Per axis (vx, vy, wz) the sign that alone is allowed, 0 for both."""
        forward, strafe, rot = self._only
        return forward, strafe, rot

    @property
    def flags(self) -> dict[str, bool]:
        """Which directions alone are allowed, by C++'s names: `rot_pos_only`.."""
        named: dict[str, bool] = {}
        for axis, only in zip(AXES, self._only):
            named[f"{axis}_pos_only"] = only > 0
            named[f"{axis}_neg_only"] = only < 0
        return named
