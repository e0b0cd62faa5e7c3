"""Following a given path with the local planner alone, as Nav2's controller server: no global planner, no recoveries."""

from __future__ import annotations

import numpy as np

from navstack.core import Path, RobotState, Twist2D
from navstack.core.errors import InvalidPathError, NavError
from navstack.interfaces import ControlInput, Plan, RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.move_base import MoveBase, plugin_calls
from navstack.move_base.errors import NoProgressError
from navstack.move_base.progress import OscillationChecker, Progress
from navstack.move_base.schedule import EPSILON_S
from navstack.move_base.speed_limiter import SpeedLimiter


class FollowPath(RecoveryBehavior):
    """Follows `path` to its last pose.

    Fails with the error of the local planner after `controller_patience` without a command, and with NoProgressError after
    `oscillation_timeout` without a motion of `oscillation_distance`.
    """

    def __init__(self, move_base: MoveBase, path: Path) -> None:
        """Raises InvalidPathError for a path that is empty or not finite."""
        super().__init__("follow_path", None)
        if not len(path) or not np.isfinite(path.poses).all():
            raise InvalidPathError("the path to follow needs at least one pose, and finite ones")
        self._move_base = move_base
        self._plan = Plan(path, 0.0, path[-1])
        self._limiter = SpeedLimiter((move_base.local_costmap, move_base.global_costmap), move_base.local_planner)
        self._progress = OscillationChecker(move_base.params.oscillation_distance)
        self._last_command = 0.0
        self._last_progress = 0.0

    def start(self, context: RecoveryContext, now: float) -> None:
        """Pass the path to the local planner. Raises its error if it rejects the path."""
        plugin_calls.call(context.local_planner, context.local_planner.reset)
        plugin_calls.set_plan(context.local_planner, self._plan)
        self._last_command = self._last_progress = now

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return the command of the local planner. Raises a ControlError, or FrameError for an unknown frame of the path."""
        params = self._move_base.params
        planner = self._move_base.local_planner
        inputs = self._move_base.control_input(self._plan, now)
        data = {"left_m": self._remaining(inputs)}
        if plugin_calls.goal_reached(planner, inputs):
            return RecoveryStep(RecoveryStatus.DONE, data=data)
        if self._progress.update(state.pose) is not Progress.NONE:
            self._last_progress = now
        elif 0.0 < params.oscillation_timeout <= now - self._last_progress + EPSILON_S:
            distance, timeout = params.oscillation_distance, params.oscillation_timeout
            raise NoProgressError(f"the robot moved less than {distance:g} m in {timeout:g} s", pose=state.pose)
        try:
            if self._limiter.is_needed:
                self._limiter.apply(now, slowed=False)
            command = plugin_calls.compute_command(planner, inputs).command
        except NavError:
            if now - self._last_command >= params.controller_patience - EPSILON_S:
                raise
            return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(), data=data)
        self._last_command = now
        return RecoveryStep(RecoveryStatus.RUNNING, command, data=data)

    def _remaining(self, inputs: ControlInput) -> float:
        """Length of the path from its point nearest to the robot (m)."""
        points = inputs.plan_to_costmap.apply_poses(self._plan.path.poses)[:, :2]
        nearest = int(np.hypot(*(points - inputs.state.pose[:2]).T).argmin())
        return float(np.hypot(*np.diff(points[nearest:], axis=0).T).sum())
